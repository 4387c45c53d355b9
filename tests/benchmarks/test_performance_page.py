"""The page of results: tables between markers, plots beside it."""

from pathlib import Path

import pytest
from made_results import case_of, results_of

from taichisoft_benchmarks import performance_page as page
from taichisoft_benchmarks.errors import BenchmarkError
from taichisoft_benchmarks.results import write_results

DOCUMENT = Path(__file__).resolve().parents[2] / "docs" / "notes" / "performance.md"


def growth(group: str, nodes: list[int]):
    facts = {"step_contacts": 0, "step_sweeps": 0}
    return {
        f"{group}_{count}": case_of(
            {"step_ms": [count / 100.0, count / 90.0], "peak_mb": [200.0]}, group=group, facts={"nodes": count, **facts}
        )
        for count in nodes
    }


def test_page_changes_between_marks_only():
    text = "before\n<!-- bench:targets -->\nstale\n<!-- end -->\nafter\n"
    filled = page.fill_page(text, results_of({"finger_coarse": case_of({"step_ms": [1.25, 1.25]})}))
    assert filled.startswith("before\n<!-- bench:targets -->\n| case |")
    assert filled.endswith("<!-- end -->\nafter\n")
    assert "stale" not in filled
    assert "| `finger_coarse.step_ms` | 1.25 | 0.9 | 6 | - | - | - | - | 0.3 |" in filled


def test_filling_twice_changes_nothing():
    results = results_of(growth("growth_nodes", [400, 1000]))
    text = "".join(f"<!-- bench:{name} -->\n<!-- end -->\n" for name in page.SECTIONS)
    once = page.fill_page(text, results)
    assert page.fill_page(once, results) == once
    assert "| 400 | 0 | 0 | 4.22 ± 0.22 | 10.56 | - | 200 |" in once


def test_peer_stands_beside_ours_with_its_omissions():
    cases = {
        "finger_coarse": case_of(
            {"step_ms": [1.5, 1.2, 0.8], "python_ms": [0.2]}, facts={"nodes": 376, "displacement_mm": 12.3}
        ),
        "finger_coarse_mujoco": case_of(
            {"step_ms": [3.0, 3.0, 3.2]},
            group="finger_coarse_mujoco",
            facts={"nodes": 376, "displacement_mm": 10.5, "unsolved": 9},
            does_not="no air",
        ),
        "finger_fine_mujoco": case_of({"step_ms": [9.0]}, group="finger_fine_mujoco", does_not="no air"),
        "finger_coarse_drake": case_of({}, group="finger_coarse_drake", skipped="drake is not installed"),
    }
    tables = page.fill_page("<!-- bench:targets -->\n<!-- end --><!-- bench:peers -->\n<!-- end -->", results_of(cases))
    # The share is the median of the rounds' shares: 0.5, 0.4, 0.25.
    assert "| `finger_coarse.step_ms` | 1.2 ± 0.35 | 0.9 | 6 | 3 ± 0.1 | - | - | 0.40 | 0.3 |" in tables
    assert "| `finger_coarse.python_ms` | 0.2 | 0.15 | - | - | - | - | - | - |" in tables
    assert "| `finger_coarse_mujoco` | 12.3 | 10.5 | 9 | no air |" in tables
    assert "| `finger_fine_mujoco` | - | - | - | as `finger_coarse_mujoco` |" in tables
    assert "| `finger_coarse_drake` | - | - | - | drake is not installed |" in tables


def test_throughput_is_given_in_runs_minute():
    figures = {"ours_per_s": [340.0], "mujoco_per_s": [85.0], "over_mujoco": [4.0]}
    case = case_of(figures, kind="throughput", facts={"processes": 2, "steps": 170})
    table = page.fill_page("<!-- bench:throughput -->\n<!-- end -->", results_of({"throughput": case}))
    assert "| 2 | 170 | 340 | 120 | 85 | 4 |" in table


def test_tuning_is_compared_with_finest_setting():
    cases = {
        f"tuning_tolerance_{name}": case_of(
            {"grasp_ms": [time]}, group="tuning_tolerance", facts={"object_mm": [0.0, place, 0.0], "grasp_sweeps": 7}
        )
        for name, time, place in (("1e-3", 2.0, 1.001), ("1e-7", 3.0, 1.0))
    } | {
        f"tuning_time_step_{name}": case_of(
            {"step_ms": [4.0]}, group="tuning_time_step", facts={"nodes": 626, "displacement_mm": bends}
        )
        for name, bends in (("10ms", 20.0), ("1ms", 21.5))
    }
    text = "<!-- bench:tolerance -->\n<!-- end --><!-- bench:time_step -->\n<!-- end -->"
    tables = page.fill_page(text, results_of(cases))
    assert "| 1e-3 | 7 | 2 | 1.0e-03 |" in tables
    assert "| 10 | 4 | 0.4 | 20.00 | -1.50 |" in tables
    assert "| 1 | 4 | 4 | 21.50 | +0.00 |" in tables


def test_factorisation_stands_beside_dense_product():
    case = case_of(
        {"factorise_ms": [2.0], "cholmod_ms": [1.6], "superlu_ms": [9.0], "ratio_to_cholmod": [1.25]},
        kind="factorisation",
        threads=1,
        facts={"nodes": 376, "mflop": 8.0, "dense_gflops": 40.0},
    )
    table = page.fill_page("<!-- bench:factorisation -->\n<!-- end -->", results_of({"factor_coarse": case}))
    assert "| `factor_coarse` | 1 | 376 | 8 | 2 | 1.6 | 9 | 1.25 | 4.0 | 40.0 |" in table


def test_unknown_marker_is_refused():
    with pytest.raises(BenchmarkError, match="bench:targts: unknown section; did you mean 'targets'"):
        page.fill_page("<!-- bench:targts -->\n<!-- end -->", results_of({}))


def test_document_has_every_section_once():
    marked = [match[1] for match in page.MARKED.finditer(DOCUMENT.read_text(encoding="utf-8"))]
    assert sorted(marked) == sorted(page.SECTIONS)


def test_growth_is_sorted_by_its_count():
    points = page.growth_points(growth("growth_nodes", [1000, 400]), "growth_nodes", "nodes")
    assert [point[0] for point in points] == [400.0, 1000.0]
    assert points[0][1:] == pytest.approx((4.2222, 4.0, 4.4444), rel=1e-4)


def test_plots_are_small_and_reproducible(tmp_path):
    results = results_of({**growth("growth_nodes", [400, 1000, 20000]), **growth("growth_fingers", [626, 1252])})
    (tmp_path / "again").mkdir()
    paths = page.draw_plots(results, tmp_path)
    assert [path.name for path in paths] == ["growth_nodes.svg", "growth_fingers.svg"]
    assert all(path.stat().st_size < 60_000 for path in paths)
    again = page.draw_plots(results, tmp_path / "again")
    assert [path.read_bytes() for path in again] == [path.read_bytes() for path in paths]


def test_single_case_has_no_plot(tmp_path):
    assert page.draw_plots(results_of(growth("growth_nodes", [400])), tmp_path) == []


def test_program_fills_file(tmp_path):
    write_results(results_of(growth("growth_nodes", [400, 1000])), tmp_path)
    written = tmp_path / "page.md"
    written.write_text("<!-- bench:nodes -->\n<!-- end -->\n")
    page.main(tmp_path / "results.json", written)
    assert "| 1000 |" in written.read_text()
    assert (tmp_path / "growth_nodes.svg").exists()
