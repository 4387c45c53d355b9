"""Figures of repetitions, and results as JSON."""

import json

import pytest
from made_results import case_of, results_of

from taichisoft_benchmarks.case_results import RepeatedMetric, derive, read_results, write_results
from taichisoft_benchmarks.errors import BenchmarkError


def test_a_figure_is_the_least_the_middle_and_the_spread_of_its_repetitions():
    figure = RepeatedMetric.of([3.0, 1.0, 1.5, 2.0])
    assert (figure.minimum, figure.median, figure.spread) == (1.0, 1.75, 2.0)
    assert RepeatedMetric.of([0.4]).spread == 0.0


def test_results_survive_the_file(tmp_path):
    results = results_of({"finger": case_of({"step_ms": [1.0, 2.0]}), "failed": case_of({}, problem="burst")})
    path = write_results(results, tmp_path / "new")
    assert read_results(path) == read_results(tmp_path / "new") == results
    assert {"machine", "versions", "load", "cases", "derived"} <= json.loads(path.read_text()).keys()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "not readable as JSON"),
        ("{}", "not results of the benchmarks: started: this key is missing"),
        ("[]", "not results of the benchmarks"),
    ],
)
def test_a_file_that_is_none_is_refused(tmp_path, text, message):
    path = tmp_path / "old.json"
    path.write_text(text)
    with pytest.raises(BenchmarkError, match=message):
        read_results(path)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(BenchmarkError, match=r"none\.json: not readable as JSON: "):
        read_results(tmp_path / "none.json")


def test_the_gain_of_threads_and_the_memory_of_a_finger_take_the_whole_group():
    cases = {
        "factor_1": case_of({"factorise_ms": [9.0], "cholmod_ms": [5.0]}, group="factor", parameter={"threads": 1}),
        "factor_2": case_of({"factorise_ms": [5.0], "cholmod_ms": [5.0]}, group="factor", parameter={"threads": 2}),
        "fingers_1": case_of({"peak_mb": [200.0]}, group="fingers", parameter={"count": 1}),
        "fingers_12": case_of({"peak_mb": [310.0, 300.0]}, group="fingers", parameter={"count": 11}),
        "failed": case_of({}, group="factor", parameter={"threads": 4}, problem="no such thread"),
    }
    assert derive(cases) == {"factor.factorise_gain": 1.8, "fingers.mb_per_finger": 10.0}
