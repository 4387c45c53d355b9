"""What plug-ins add to a step is measured by part, and nothing of the measurement stays."""

from pathlib import Path

import pytest

from taichisoft.running import plugin_registry
from taichisoft_benchmarks.case_scenes import Meshes, scene_of
from taichisoft_benchmarks.cases import PluginsCase, cases_from_dict, read_cases
from taichisoft_benchmarks.measures.steps import measure_plugins


def test_hooks_and_observation_are_measured_together_and_by_part(tmp_path: Path) -> None:
    table = {"title": "", "kind": "plugins", "scene": "finger-inflated", "finger": "finger", "steps": 4}
    (named,) = cases_from_dict({"plugins": {**table, "windows": {"hooks_and_observation_ms": [3, 4]}}})
    assert isinstance(named.case, PluginsCase)
    before = list(plugin_registry().origins)
    measured = measure_plugins(named.case, scene_of(named.case, Meshes(None, tmp_path)))
    figures = measured.figures
    parts = [figures[f"{part}_ms"] for part in ("observation", "hook")]
    assert min(parts) > 0.0
    assert figures["hooks_and_observation_ms"] == pytest.approx(sum(parts))  # of the one step of the window
    assert figures["hook_nobody_ms"] > 0.0
    assert list(plugin_registry().origins) == before


def test_the_case_that_has_the_target_is_shipped() -> None:
    (case,) = [named.case for named in read_cases() if named.name == "plugins"]
    assert "hooks_and_observation_ms" in case.windows  # type: ignore[attr-defined]
