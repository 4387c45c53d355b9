"""Results made by hand for the tests of what is done with them."""

from typing import Any

from taichisoft_benchmarks.results import CaseResult, RepeatedMetric, Results


def case_of(figures: dict[str, list[float]], **about: Any) -> CaseResult:
    """A measured case."""
    table = {"group": "finger", "title": "a finger", "kind": "steps", "threads": 0, "calibration_ms": [1.0, 1.0, 1.0]}
    made = {metric: RepeatedMetric.of(values) for metric, values in figures.items()}
    return CaseResult(**{**table, "facts": {"nodes": 626}, **about}, figures=made)


def results_of(cases: dict[str, CaseResult], **about: Any) -> Results:
    """Results on some machine."""
    table: dict[str, Any] = {
        "started": "2026-01-02T03:04:05+0000",
        "meshes": "shipped",
        "machine": {"system": "s", "processor": "p", "cores": "2", "memory_gb": "8", "python": "3.11"},
        "versions": {"taichi": "1.7.4"},
        "load": {"start": 0.1, "end": 0.2},
    }
    return Results(**{**table, **about}, cases=cases)
