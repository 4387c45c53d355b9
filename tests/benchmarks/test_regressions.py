"""Changes beyond the noise are told from those within it, also between machines."""

import pytest
from made_results import case_of, results_of

from taichisoft_benchmarks.errors import BenchmarkError
from taichisoft_benchmarks.regressions import compare


def verdicts(new, old):
    return {change.name: change.verdict for change in compare(results_of({"finger": new}), results_of({"finger": old}))}


def test_a_change_beyond_the_noise_is_marked():
    old = case_of({"step_ms": [1.0, 1.01, 1.02]})
    assert verdicts(case_of({"step_ms": [1.3, 1.31, 1.32]}), old) == {"finger.step_ms": "worse"}
    assert verdicts(case_of({"step_ms": [0.7, 0.71, 0.72]}), old) == {"finger.step_ms": "better"}


def test_a_change_within_the_scatter_of_either_run_is_not():
    calm, restless = case_of({"step_ms": [1.0, 1.01, 1.02]}), case_of({"step_ms": [1.1, 1.3, 1.5]})
    assert verdicts(restless, calm) == {"finger.step_ms": ""}
    assert verdicts(calm, restless) == {"finger.step_ms": ""}


def test_single_runs_need_five_per_cent():
    old = case_of({"step_ms": [1.0]})
    assert verdicts(case_of({"step_ms": [1.04]}), old) == {"finger.step_ms": ""}
    assert verdicts(case_of({"step_ms": [1.06]}), old) == {"finger.step_ms": "worse"}


def test_a_machine_of_half_the_speed_is_no_regression():
    old = case_of({"step_ms": [1.0, 1.0, 1.0], "peak_mb": [200.0]})
    slow = case_of({"step_ms": [2.0, 2.0, 2.0], "peak_mb": [200.0]}, calibration_ms=[2.0, 2.0, 2.0])
    assert verdicts(slow, old) == {"finger.step_ms": "", "finger.peak_mb": ""}


def test_memory_is_compared_as_it_is():
    old = case_of({"peak_mb": [200.0]})
    assert verdicts(case_of({"peak_mb": [260.0]}, calibration_ms=[2.0]), old) == {"finger.peak_mb": "worse"}


def test_of_rates_more_is_better():
    old = case_of({"steps_per_s": [100.0]})
    assert verdicts(case_of({"steps_per_s": [120.0]}), old) == {"finger.steps_per_s": "better"}
    assert verdicts(case_of({"steps_per_s": [80.0]}), old) == {"finger.steps_per_s": "worse"}
    half = case_of({"steps_per_s": [50.0]}, calibration_ms=[2.0])  # on a machine of half the speed
    assert verdicts(half, old) == {"finger.steps_per_s": ""}


def test_an_unsteady_machine_is_noise():
    old = case_of({"step_ms": [1.0, 1.0, 1.0]})
    unsteady = case_of({"step_ms": [1.3, 1.3, 1.3]}, calibration_ms=[0.8, 1.0, 1.2])
    assert verdicts(unsteady, old) == {"finger.step_ms": ""}


def test_ratios_have_no_worse_side_and_are_left_out():
    case = case_of({"step_ms": [1.0], "ratio_to_cholmod": [1.5]})
    assert verdicts(case, case) == {"finger.step_ms": ""}


def test_other_meshes_are_not_compared():
    case = case_of({"step_ms": [1.0]})
    with pytest.raises(BenchmarkError, match="different meshes: tutorial now, shipped in the old one"):
        compare(results_of({"finger": case}, meshes="tutorial"), results_of({"finger": case}))
    with pytest.raises(BenchmarkError, match="finger: has 700 nodes now and had 626"):
        verdicts(case_of({"step_ms": [1.0]}, facts={"nodes": 700}), case)


def test_runs_with_nothing_in_common_are_not_compared():
    with pytest.raises(BenchmarkError, match="no measured case in common"):
        verdicts(case_of({"step_ms": [1.0]}), case_of({}, problem="burst"))


def test_a_line_says_how_much():
    (change,) = compare(
        results_of({"finger": case_of({"step_ms": [1.5]})}), results_of({"finger": case_of({"step_ms": [1.0]})})
    )
    assert str(change) == "# finger.step_ms x 1.500 (noise 0.050)  <- worse"
