"""Figures that take several cases of a group."""

from collections.abc import Mapping

from taichisoft_benchmarks.results import CaseResult


def derive(cases: Mapping[str, CaseResult]) -> dict[str, float]:
    """Gains by threads and memory per finger, as far as their cases were measured."""
    found = {}
    groups: dict[str, list[CaseResult]] = {}
    for case in cases.values():
        if case.figures:
            groups.setdefault(case.group, []).append(case)
    for name, members in groups.items():
        if len(members) < 2:
            continue
        first, last = members[0], members[-1]
        if "threads" in first.parameter:
            for metric in first.figures.keys() & last.figures.keys():
                if metric.endswith("_ms") and not metric.startswith(("cholmod", "superlu")):
                    found[f"{name}.{metric.removesuffix('_ms')}_gain"] = _ratio(first, last, metric)
        if "count" in first.parameter and "peak_mb" in first.figures:
            more = last.parameter["count"] - first.parameter["count"]
            grown = last.figures["peak_mb"].minimum - first.figures["peak_mb"].minimum
            found[f"{name}.mb_per_finger"] = float(f"{grown / more:.4g}")
    return found


def _ratio(first: CaseResult, last: CaseResult, metric: str) -> float:
    return float(f"{first.figures[metric].median / last.figures[metric].median:.4g}")
