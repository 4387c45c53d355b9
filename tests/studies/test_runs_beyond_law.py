"""Runs beyond the law of a body in studies: a status of their own, and left out of searches unless asked for."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from studies import PLUGIN, Here

from taichisoft import load_plugin
from taichisoft_studies.optimiser import Optimisation, best_trials, open_study
from taichisoft_studies.results_table import result_row
from taichisoft_studies.study_file import Sweep, check_study
from taichisoft_studies.sweep_runs import make_missing, sweep_jobs
from taichisoft_studies.trials import run_trials, trial_rows

PRESSURE = "controller.settings.pressure"
PRESSURES = [20.0, 60.0]
"""[kPa]: the walls of the block hold the first, and explode under the second."""

SCENE = """
gravity = [0.0, 0.0, 0.0]
[soft_bodies.block]
mesh = '{mesh}'
density = 1e-6
young_modulus = 100.0
poisson_ratio = 0.3
law = "neo-hookean"
element = "smoothed"
rayleigh_stiffness = 0.1
cavities = {{ air = {{ group = "cavity" }} }}
"""


@pytest.fixture
def tables(tmp_path: Path, block: Callable[..., str], taichisoft_plugins: Any) -> dict[str, Any]:
    """A study of a hollow block with thin walls."""
    scene, plugin = tmp_path / "block.toml", tmp_path / "squeeze.py"
    scene.write_text(SCENE.format(mesh=block((4, 4, 4), (20.0, 20.0, 20.0), hollow=True)))
    plugin.write_text(PLUGIN)
    load_plugin(plugin)
    return {"scene": str(scene), "controller": "squeeze", "duration": 0.3, "plugins": [str(plugin)]}


def test_sweep_lists_runs_beyond_the_law(tables: dict[str, Any], tmp_path: Path) -> None:
    study = check_study(Sweep, {**tables, "vary": {PRESSURE: PRESSURES}}, "study")
    records = make_missing(sweep_jobs(study, tmp_path), Here())
    rows = [result_row(record, "runs") for record in records]
    assert [row["status"] for row in rows] == ["completed", "beyond the law"]
    assert "elements are inverted at the end" in rows[1]["message"]
    assert rows[1]["metrics.inverted_elements_at_end"] > 0


@pytest.mark.parametrize(("accepted", "best"), [(False, "20.0"), (True, "60.0")])
def test_search_skips_runs_beyond_the_law(tables: dict[str, Any], tmp_path: Path, accepted: bool, best: str) -> None:
    """The largest stretch is wanted, which the exploded run has."""
    wanted = {"size": {"maximise": "largest_stretch['block']"}}
    search = {"variables": {PRESSURE: PRESSURES}, "objectives": wanted, "trials": 6, "start": {PRESSURE: 60.0}}
    study = check_study(Optimisation, {**tables, **search, "beyond_the_law": accepted}, "study")
    trials = open_study(study, tmp_path)
    trials.set_user_attr("folder", str(tmp_path))
    run_trials(study, tmp_path, trials, Here(), lambda trial, record: None)
    assert best_trials(trials, 1)[0].params[PRESSURE] == best
    assert {row["status"] for row in trial_rows(study, trials)} == {"beyond the law", "completed"}
