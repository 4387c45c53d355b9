"""The page of results: tables between marks, plots beside it."""

from pathlib import Path
from typing import Any

import pytest
from made_results import case_of, results_of

from taichisoft_benchmarks import performance_page as page
from taichisoft_benchmarks.errors import BenchmarkError
from taichisoft_benchmarks.results import write_results

DOCUMENT = Path(__file__).resolve().parents[2] / "docs" / "notes" / "performance.md"


def growth(group: str, nodes: list[int]) -> dict[str, Any]:
    facts = {"step_contacts": 0, "step_sweeps": 0}
    return {
        f"{group}_{count}": case_of(
            {"step_ms": [count / 100.0, count / 90.0], "peak_mb": [200.0]}, group=group, facts={"nodes": count, **facts}
        )
        for count in nodes
    }


def peer(figures: dict[str, list[float]], group: str, displacement: float | None = None, **about: Any) -> Any:
    facts = {} if displacement is None else {"nodes": 376, "displacement_mm": displacement, "unsolved": 9}
    return case_of(figures, group=group, **({"facts": facts} if facts else {}), **about)


FINGER = {"nodes": 376, "displacement_mm": 12.3}
PEERS = {
    "finger_coarse": case_of({"step_ms": [1.5, 1.2, 0.8], "python_ms": [0.2]}, facts=FINGER),
    "finger_coarse_mujoco": peer({"step_ms": [3.0, 3.0, 3.2]}, "finger_coarse_mujoco", 10.5, does_not="no air"),
    "finger_fine_mujoco": peer({"step_ms": [9.0]}, "finger_fine_mujoco", does_not="no air"),
    "finger_coarse_drake": peer({}, "finger_coarse_drake", skipped="drake is not installed"),
}
THROUGHPUT = {"ours_per_s": [340.0], "mujoco_per_s": [85.0], "over_mujoco": [4.0]}
TOLERANCES = {
    f"tuning_tolerance_{name}": case_of(
        {"grasp_ms": [time]}, group="tuning_tolerance", facts={"object_mm": [0.0, place, 0.0], "grasp_sweeps": 7}
    )
    for name, time, place in (("1e-3", 2.0, 1.001), ("1e-7", 3.0, 1.0))
}
TIME_STEPS = {
    f"tuning_time_step_{name}": case_of(
        {"step_ms": [4.0]}, group="tuning_time_step", facts={"nodes": 626, "displacement_mm": bends}
    )
    for name, bends in (("10ms", 20.0), ("1ms", 21.5))
}
FACTORS = {"factorise_ms": [2.0], "cholmod_ms": [1.6], "superlu_ms": [9.0], "ratio_to_cholmod": [1.25]}
MATRIX = {"nodes": 376, "mflop": 8.0, "dense_gflops": 40.0}


@pytest.mark.parametrize(
    ("section", "cases", "rows"),
    [
        (
            "targets",
            PEERS,
            # The share is the median of the rounds' shares: 0.5, 0.4, 0.25.
            [
                "`finger_coarse.step_ms` | 1.2 ± 0.35 | 0.9 | 6 | 3 ± 0.1 | - | - | 0.40 | 0.3",
                "`finger_coarse.python_ms` | 0.2 | 0.15 | - | - | - | - | - | -",
            ],
        ),
        (
            "peers",
            PEERS,
            [
                "`finger_coarse_mujoco` | 12.3 | 10.5 | 9 | no air",
                "`finger_fine_mujoco` | - | - | - | as `finger_coarse_mujoco`",
                "`finger_coarse_drake` | - | - | - | drake is not installed",
            ],
        ),
        ("nodes", growth("growth_nodes", [400, 1000]), ["400 | 0 | 0 | 4.22 ± 0.22 | 10.56 | - | 200"]),
        (
            "throughput",
            {"throughput": case_of(THROUGHPUT, kind="throughput", facts={"processes": 2, "steps": 170})},
            ["2 | 170 | 340 | 120 | 85 | 4"],
        ),
        ("tolerance", TOLERANCES, ["1e-3 | 7 | 2 | 1.0e-03"]),
        ("time_step", TIME_STEPS, ["10 | 4 | 0.4 | 20.00 | -1.50", "1 | 4 | 4 | 21.50 | +0.00"]),
        (
            "factorisation",
            {"factor_coarse": case_of(FACTORS, kind="factorisation", threads=1, facts=MATRIX)},
            ["`factor_coarse` | 1 | 376 | 8 | 2 | 1.6 | 9 | 1.25 | 4.0 | 40.0"],
        ),
        ("start", {}, ["Not measured in this run."]),
    ],
)
def test_sections_have_their_rows(section: str, cases: dict[str, Any], rows: list[str]) -> None:
    """Only what is between the marks changes."""
    text = f"before\n<!-- bench:{section} -->\nstale\n<!-- end -->\nafter\n"
    filled = page.fill_page(text, results_of(cases))
    assert filled.startswith(f"before\n<!-- bench:{section} -->\n") and filled.endswith("<!-- end -->\nafter\n")
    assert "stale" not in filled
    assert all(row in filled for row in rows), filled


def test_filling_twice_changes_nothing() -> None:
    results = results_of(growth("growth_nodes", [400, 1000]))
    once = page.fill_page("".join(f"<!-- bench:{name} -->\n<!-- end -->\n" for name in page.SECTIONS), results)
    assert page.fill_page(once, results) == once


def test_document_has_every_section_once() -> None:
    marked = [match[1] for match in page.MARKED.finditer(DOCUMENT.read_text(encoding="utf-8"))]
    assert sorted(marked) == sorted(page.SECTIONS)
    with pytest.raises(BenchmarkError, match="bench:targts: unknown section; did you mean 'targets'"):
        page.fill_page("<!-- bench:targts -->\n<!-- end -->", results_of({}))


def test_plots_are_small_sorted_and_reproducible(tmp_path: Path) -> None:
    points = page.growth_points(growth("growth_nodes", [1000, 400]), "growth_nodes", "nodes")
    assert [point[0] for point in points] == [400.0, 1000.0]
    assert points[0][1:] == pytest.approx((4.2222, 4.0, 4.4444), rel=1e-4)
    several = growth("growth_nodes", [400, 1000, 20000]) | growth("growth_fingers", [626, 1252])
    results = results_of({**several, **growth("growth_contacts", [400])})  # a single case is no growth
    (tmp_path / "again").mkdir()
    paths = page.draw_plots(results, tmp_path)
    assert [path.name for path in paths] == ["growth_nodes.svg", "growth_fingers.svg"]
    assert all(path.stat().st_size < 60_000 for path in paths)
    again = page.draw_plots(results, tmp_path / "again")
    assert [path.read_bytes() for path in again] == [path.read_bytes() for path in paths]


def test_program_fills_a_file(tmp_path: Path) -> None:
    write_results(results_of(growth("growth_nodes", [400, 1000])), tmp_path)
    written = tmp_path / "page.md"
    written.write_text("<!-- bench:nodes -->\n<!-- end -->\n")
    page.main(tmp_path / "results.json", written)
    assert "| 1000 |" in written.read_text()
    assert (tmp_path / "growth_nodes.svg").exists()
