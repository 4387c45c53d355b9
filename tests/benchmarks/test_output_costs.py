"""The cost of recording is measured on the same steps, without and with it."""

from pathlib import Path

import numpy as np
import pytest

from taichisoft import Scene, Simulation
from taichisoft.scene.scene import SceneControllerSettings
from taichisoft_benchmarks.cases import RecordingCase, cases_from_dict, read_cases
from taichisoft_benchmarks.measures import output_costs as outputs


def test_the_cost_is_the_median_of_the_pairs(taichisoft_scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    seconds = iter([0.0, 1.0, 1.5, 3.0, 2.0, 9.0, 9.1])  # of a first run and of three pairs, the second turned round
    starts = []

    def run(simulation: Simulation, scene: Scene, steps: int, folder: Path | None) -> tuple[float, float]:
        starts.append(simulation.state.position)
        if folder is not None:
            (folder / "recording.h5").write_bytes(bytes(40_000))
        return next(seconds), 0.02

    monkeypatch.setattr(outputs, "_recorded_run", run)
    case = RecordingCase(kind="recording", title="", scene="", finger="", steps=10, pairs=3)
    figures = outputs.measure_recording(case, taichisoft_scene).figures
    assert figures["cost_ms"] == pytest.approx(1e3 * 0.5 / 10)  # 0.5, 1.0 and 0.1 s
    assert figures["cost_percent"] == pytest.approx(100.0 * 0.5 / 2.0)
    assert figures["output_ms"] == pytest.approx(1e3 * 0.02 / 10)
    assert figures["kb_per_step"] == 4.0
    assert all(np.array_equal(start, starts[0]) for start in starts)


def test_a_recording_is_written_and_measured(taichisoft_scene: Scene) -> None:
    (named,) = cases_from_dict(
        {"a": {"kind": "recording", "title": "", "scene": "", "finger": "", "steps": 4, "pairs": 1}}
    )
    scene = taichisoft_scene.model_copy(update={"controller": SceneControllerSettings(name="keyboard")})
    assert isinstance(named.case, RecordingCase)
    figures = outputs.measure_recording(named.case, scene).figures
    assert min(figures["step_ms"], figures["output_ms"]) > 0.0 and figures["kb_per_step"] > 1.0


def test_the_case_that_has_the_target_is_shipped() -> None:
    (case,) = [named.case for named in read_cases() if named.name == "recording"]
    assert isinstance(case, RecordingCase) and case.shortened().pairs == 1
