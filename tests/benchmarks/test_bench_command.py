"""`python -m taichisoft_benchmarks`, end to end on cases of a few steps."""

import json
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from taichisoft_benchmarks.__main__ import bench as measure
from taichisoft_benchmarks.program import run_program

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


def test_a_case_gives_figures_as_lines_and_as_json_and_compares_with_itself(bench, tmp_path):
    code, lines, errors = bench("--case", "tiny", "--repeat", "2", "--output", "out")
    assert (code, errors) == (0, "")
    figures = dict(line.split()[:2] for line in lines if not line.startswith("#"))
    assert figures["tiny.nodes"] == "626"
    assert float(figures["tiny.step_ms"]) > 0.0
    assert 0.0 < float(figures["tiny.python_ms"]) < float(figures["tiny.phases.step_ms"])
    document = json.loads((tmp_path / "out/results.json").read_text())
    case = document["cases"]["tiny"]
    assert len(case["figures"]["step_ms"]["values"]) == 2
    assert len(case["calibration_ms"]) == 2
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


def test_a_case_that_fails_is_named_and_the_rest_go_on(bench):
    code, lines, errors = bench("--case", "absent", "--case", "matrix", "--quick")
    assert code == 1
    (failure,) = (line for line in lines if "failed" in line)
    assert failure.startswith("# absent: failed: fingr-inflated: no such file, and none of the shipped scenes")
    assert any(line.startswith("matrix.factorise_ms ") for line in lines)
    assert any(line.startswith("matrix.ratio_to_superlu ") for line in lines)
    assert errors == "taichisoft: 1 of 2 cases failed: absent\n"


def test_the_list_starts_nothing(bench):
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
def test_a_wrong_argument_is_one_line_before_the_work(bench, arguments, message):
    code, lines, errors = bench(*arguments)
    assert (code, lines) == (2, [])
    (line,) = errors.splitlines()
    assert line.startswith(f"taichisoft: {message}")
