"""`python -m taichisoft_benchmarks` from cases to results, and results against those of an earlier run."""

import json
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from made_results import case_of, results_of

from taichisoft_benchmarks import runner
from taichisoft_benchmarks.__main__ import bench as measure
from taichisoft_benchmarks.case_scenes import Meshes
from taichisoft_benchmarks.cases import cases_from_dict
from taichisoft_benchmarks.errors import BenchmarkError
from taichisoft_benchmarks.measures import Measured
from taichisoft_benchmarks.pages import run_program
from taichisoft_benchmarks.results import compare, derive, read_results, write_results
from taichisoft_benchmarks.runner import Answer, environment_of

CASES = """
[tiny]
kind = "steps"
title = "a few steps"
scene = "finger-inflated"
finger = "finger"
steps = 4
windows = { step_ms = [1, 4] }
threads = 1

[matrix]
kind = "factorisation"
title = "a matrix"
scene = "finger-inflated"
finger = "finger"
rounds = 2

[absent]
kind = "steps"
title = "a scene that there is not"
scene = "fingr-inflated"
finger = "finger"
steps = 4
windows = { step_ms = [1, 4] }
"""

Command = Callable[..., tuple[int, list[str], str]]


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], tmp_path: Path) -> Command:
    """Runs the command in a folder of its own; returns exit code, lines of output, and errors."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "cases.toml").write_text(CASES)

    def run(*arguments: str) -> tuple[int, list[str], str]:
        monkeypatch.setattr(sys, "argv", ["bench", "--cases", "cases.toml", *arguments])
        with pytest.raises(SystemExit) as left:
            run_program(measure, "taichisoft_benchmarks")
        shown = capfd.readouterr()
        return int(left.value.code or 0), shown.out.splitlines(), shown.err

    return run


def test_case_gives_lines_json_and_comparison(bench, tmp_path):
    code, lines, errors = bench("--case", "tiny", "--repeat", "2", "--output", "out")
    assert (code, errors) == (0, "")
    figures = dict(line.split()[:2] for line in lines if not line.startswith("#"))
    assert figures["tiny.nodes"] == "626"
    assert float(figures["tiny.step_ms"]) > 0.0
    assert 0.0 < float(figures["tiny.python_ms"]) < float(figures["tiny.phases.step_ms"])
    document = json.loads((tmp_path / "out/results.json").read_text())
    case = document["cases"]["tiny"]
    assert len(case["figures"]["step_ms"]["values"]) == len(case["calibration_ms"]) == 2
    assert case["threads"] == 1
    assert case["figures"]["peak_mb"]["minimum"] > 50.0
    assert {"processor", "cores", "python"} <= document["machine"].keys()
    assert document["versions"]["taichi"] == "1.7.4"
    assert {"start", "end"} == document["load"].keys()

    # All of it a thousand times faster: the median alone would leave a spread, and with it a noise, beyond any change.
    step_ms = case["figures"]["step_ms"]
    case["figures"]["step_ms"] = {
        key: [1e-3 * time for time in value] if key == "values" else 1e-3 * value for key, value in step_ms.items()
    }
    (tmp_path / "faster.json").write_text(json.dumps(document))
    code, lines, _ = bench("--case", "tiny", "--quick", "--compare", "faster.json", "--fail-on-regression")
    assert code == 1
    (line,) = (line for line in lines if line.startswith("# tiny.step_ms x"))
    assert line.endswith("<- worse")


def test_failed_case_is_named_and_others_run(bench):
    code, lines, errors = bench("--case", "absent", "--case", "matrix", "--quick")
    assert code == 1
    (failure,) = (line for line in lines if "failed" in line)
    assert failure.startswith("# absent: failed: fingr-inflated: no such file, and none of the shipped scenes")
    assert {"matrix.factorise_ms", "matrix.ratio_to_superlu"} <= {line.split()[0] for line in lines}
    assert errors == "taichisoft: 1 of 2 cases failed: absent\n"


def test_list_starts_nothing(bench):
    code, lines, _ = bench("--list")
    assert code == 0
    assert [line.split()[:2] for line in lines] == [["tiny", "steps"], ["matrix", "factorisation"], ["absent", "steps"]]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--case", "tny"], "--case tny: fits no case; did you mean 'tiny'?"),
        (["--tutorial-meshes", "nowhere"], "--tutorial-meshes nowhere: no such folder"),
        (["--compare", "nothing.json"], "nothing.json: not readable as JSON: "),
        (["--output", "cases.toml/new"], "--output cases.toml/new: cannot be written: "),
        (["--fail-on-regression"], "--fail-on-regression: needs --compare OLD"),
        (["--cases", "none.toml"], "none.toml: not readable as TOML: "),
    ],
)
def test_wrong_argument_is_one_line_before_work(bench, arguments, message):
    code, lines, errors = bench(*arguments)
    assert (code, lines) == (2, [])
    (line,) = errors.splitlines()
    assert line.startswith(f"taichisoft: {message}")


def start_case(**changes):
    (named,) = cases_from_dict({"case": {"kind": "start", "title": "", "scene": "gripper", "finger": "f", **changes}})
    return named.case


def test_environment_has_threads_and_empty_cache(tmp_path):
    assert environment_of(start_case(), tmp_path) == {}
    given = environment_of(start_case(threads=2), tmp_path)
    assert given["TAICHISOFT_THREADS"] == given["OPENBLAS_NUM_THREADS"] == "2"
    folder = Path(environment_of(start_case(cold=True), tmp_path)["XDG_CACHE_HOME"])
    assert folder.parent == tmp_path and not folder.exists()


@pytest.fixture
def rounds(monkeypatch):
    """Runs two cases in three rounds with the given answers, then Ctrl+C; returns results, lines of progress, names."""

    def run(*answers: Answer):
        remaining, progress, concluded = iter(answers), [], []

        def answer(*_):
            try:
                return next(remaining)
            except StopIteration:
                raise KeyboardInterrupt from None

        monkeypatch.setattr(runner.machine, "calibrate", lambda: 1.5)
        monkeypatch.setattr(runner, "measure_in_process", answer)
        sweep = {"a": {"preset": "coarse"}, "b": {"preset": "fine"}}
        cases = cases_from_dict({"mesh": {"kind": "meshing", "title": "", "sweep": sweep}})
        results = runner.run_cases(
            cases, Meshes(None, Path()), 3, False, progress.append, lambda name, _: concluded.append(name)
        )
        return results, progress, concluded

    return run


def measured(*seconds: float) -> list[Answer]:
    return [Answer(Measured({"mesh_s": value})) for value in seconds]


def test_repetitions_are_measured_beside_calibrations(rounds):
    results, progress, _ = rounds(*measured(1.0, 5.0, 3.0, 5.0, 2.0, 5.0))
    assert results.cases["mesh_a"].figures["mesh_s"].values == [1.0, 3.0, 2.0]
    assert results.cases["mesh_a"].calibration_ms == [1.5, 1.5, 1.5]
    assert results.cases["mesh_b"].parameter == {"preset": "fine"}
    assert progress[1:3] == ["round 1 of 3, case 2 of 2: mesh_b", "round 2 of 3, case 1 of 2: mesh_a"]
    assert not results.interrupted


def test_stopped_run_keeps_its_results(rounds):
    results, _, concluded = rounds(*measured(1.0, 5.0, 3.0))  # stopped in the second round, at the second case
    assert results.interrupted
    values = {name: case.figures["mesh_s"].values for name, case in results.cases.items()}
    assert values == {"mesh_a": [1.0, 3.0], "mesh_b": [5.0]}
    assert concluded == ["mesh_a", "mesh_b"]


def test_results_survive_their_file(tmp_path):
    results = results_of({"finger": case_of({"step_ms": [1.0, 2.0]}), "failed": case_of({}, problem="burst")})
    path = write_results(results, tmp_path / "new")
    assert read_results(path) == read_results(tmp_path / "new") == results


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "old.json: not readable as JSON: "),
        ("{", "old.json: not readable as JSON"),
        ("{}", "not results of the benchmarks: started: this key is missing"),
        ("[]", "not results of the benchmarks"),
    ],
)
def test_files_without_results_are_refused(tmp_path, text, message):
    if text is not None:
        (tmp_path / "old.json").write_text(text)
    with pytest.raises(BenchmarkError, match=message):
        read_results(tmp_path / "old.json")


def test_gains_and_ratios_come_from_several_cases():
    cases = {
        "factor_1": case_of({"factorise_ms": [9.0], "cholmod_ms": [5.0]}, group="factor", parameter={"threads": 1}),
        "factor_2": case_of({"factorise_ms": [5.0], "cholmod_ms": [5.0]}, group="factor", parameter={"threads": 2}),
        "finger": case_of({"step_ms": [2.0, 1.0, 3.0], "python_ms": [1.0]}),
        "finger_mujoco": case_of({"step_ms": [4.0, 5.0, 4.0]}, group="finger_mujoco", does_not="no air"),
        "failed": case_of({}, group="factor", parameter={"threads": 4}, problem="no such thread"),
    }
    assert derive(cases) == {"factor.factorise_gain": 1.8, "finger_mujoco.step_ms_ratio": 0.5}


CALM, RESTLESS = [1.0, 1.01, 1.02], [1.1, 1.3, 1.5]


@pytest.mark.parametrize(
    ("metric", "old", "new", "calibration", "verdict"),
    [
        ("step_ms", CALM, [1.3, 1.31, 1.32], 1.0, "worse"),
        ("step_ms", CALM, [0.7, 0.71, 0.72], 1.0, "better"),
        ("step_ms", CALM, RESTLESS, 1.0, ""),  # within the scatter of either run
        ("step_ms", RESTLESS, CALM, 1.0, ""),
        ("step_ms", [1.0], [1.04], 1.0, ""),  # single runs need 5 %
        ("step_ms", [1.0], [1.06], 1.0, "worse"),
        ("step_ms", [1.0], [2.0], 2.0, ""),  # a machine of half the speed
        ("peak_mb", [200.0], [200.0], 2.0, ""),
        ("peak_mb", [200.0], [260.0], 2.0, "worse"),
    ],
)
def test_change_is_judged_against_noise_and_machine(metric, old, new, calibration, verdict):
    now = results_of({"finger": case_of({metric: new}, calibration_ms=3 * [calibration])})
    (change,) = compare(now, results_of({"finger": case_of({metric: old})}))
    assert (change.name, change.verdict) == (f"finger.{metric}", verdict)


def test_only_times_and_memory_are_compared():
    results = results_of({"finger": case_of({"step_ms": [1.0], "ratio_to_cholmod": [1.5]})})
    (change,) = compare(results, results)
    assert change.name == "finger.step_ms"
    slower = results_of({"finger": case_of({"step_ms": [1.5]})})
    assert str(compare(slower, results)[0]) == "# finger.step_ms x 1.500 (noise 0.050)  <- worse"


@pytest.mark.parametrize(
    ("about", "case", "message"),
    [
        ({"meshes": "tutorial"}, {}, "different meshes: tutorial now, shipped in the old one"),
        ({}, {"facts": {"nodes": 700}}, "finger: has 700 nodes now and had 626"),
        ({}, {"problem": "burst"}, "no measured case in common"),
    ],
)
def test_unlike_runs_are_not_compared(about, case, message):
    old = results_of({"finger": case_of({"step_ms": [1.0]})})
    figures = {} if "problem" in case else {"step_ms": [1.0]}
    with pytest.raises(BenchmarkError, match=message):
        compare(results_of({"finger": case_of(figures, **case)}, **about), old)
