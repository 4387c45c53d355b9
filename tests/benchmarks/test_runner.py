"""The list of cases: round by round, and what was measured is kept when it is stopped."""

from pathlib import Path

from taichisoft_benchmarks import runner
from taichisoft_benchmarks.case_process import Answer
from taichisoft_benchmarks.case_scenes import Meshes
from taichisoft_benchmarks.cases import cases_from_dict
from taichisoft_benchmarks.measures.measured import Measured

MESHING = {"kind": "meshing", "title": "", "sweep": {"a": {"preset": "coarse"}, "b": {"preset": "fine"}}}
CASES = cases_from_dict({"mesh": MESHING})


def run(**changes):
    nothing = {"on_progress": lambda progress: None, "on_result": lambda name, result: None}
    return runner.run_cases(CASES, Meshes(None, Path()), **{"repeat": 3, "quick": False, **nothing, **changes})


def test_every_repetition_is_measured_beside_a_calibration(monkeypatch):
    answers = iter([1.0, 5.0, 3.0, 5.0, 2.0, 5.0])
    monkeypatch.setattr(runner.machine, "calibrate", lambda: 1.5)
    monkeypatch.setattr(runner, "measure_in_process", lambda case, meshes: Answer(Measured({"mesh_s": next(answers)})))
    seen = []
    results = run(on_progress=seen.append)
    assert results.cases["mesh_a"].figures["mesh_s"].values == [1.0, 3.0, 2.0]
    assert results.cases["mesh_a"].calibration_ms == [1.5, 1.5, 1.5]
    assert results.cases["mesh_b"].parameter == {"preset": "fine"}
    assert seen[1] == "round 1 of 3, case 2 of 2: mesh_b"
    assert seen[2] == "round 2 of 3, case 1 of 2: mesh_a"


def test_a_case_that_fails_is_not_repeated(monkeypatch):
    calls = []
    monkeypatch.setattr(runner.machine, "calibrate", lambda: 1.5)
    monkeypatch.setattr(
        runner, "measure_in_process", lambda case, meshes: calls.append(case) or Answer(problem="gmsh is not there")
    )
    results = run()
    assert [case.problem for case in results.cases.values()] == ["gmsh is not there"] * 2
    assert len(calls) == 2


def test_a_stopped_run_keeps_what_it_has(monkeypatch):
    answers = iter([1.0, 5.0, 3.0])  # stopped in the second round, at the second case
    told = []

    def measure(*_):
        try:
            return Answer(Measured({"mesh_s": next(answers)}))
        except StopIteration:
            raise KeyboardInterrupt from None

    monkeypatch.setattr(runner.machine, "calibrate", lambda: 1.5)
    monkeypatch.setattr(runner, "measure_in_process", measure)
    results = run(on_result=lambda name, result: told.append(name))
    assert results.interrupted
    assert {name: case.figures["mesh_s"].values for name, case in results.cases.items()} == {
        "mesh_a": [1.0, 3.0],
        "mesh_b": [5.0],
    }
    assert told == ["mesh_a", "mesh_b"]
