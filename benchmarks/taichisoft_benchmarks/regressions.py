"""Whether a run is slower than an earlier one, beyond the scatter of both."""

from collections.abc import Iterator
from dataclasses import dataclass
from statistics import median

from taichisoft_benchmarks.case_results import CaseResult, RepeatedMetric, Results
from taichisoft_benchmarks.errors import BenchmarkError

LEAST_NOISE = 0.05
"""Least noise: three repetitions say little about a machine, however alike they are."""

TIMES = ("_ms", "_s")
RATES = ("_per_s",)
"""Ends of the names of figures of which more is better; their inverses, which are times, are compared."""
COMPARED = (*TIMES, "_mb")


@dataclass(frozen=True)
class Change:
    """One figure in two runs.

    Attributes:
        name: "case.metric".
        ratio: new over old [-], times each divided by its calibration; of rates old over new.
        noise: largest difference of the ratio from 1 that is not significant [-].
    """

    name: str
    ratio: float
    noise: float

    @property
    def verdict(self) -> str:
        """The word "worse" or "better", or nothing within the noise."""
        if self.ratio > 1.0 + self.noise:
            return "worse"
        return "better" if self.ratio < 1.0 / (1.0 + self.noise) else ""

    def __str__(self) -> str:
        """The change as one line, marked when it is beyond the noise."""
        mark = f"  <- {self.verdict}" if self.verdict else ""
        return f"# {self.name} x {self.ratio:.3f} (noise {self.noise:.3f}){mark}"


def compare(new: Results, old: Results) -> list[Change]:
    """Every time and every peak of memory that both runs have.

    Raises:
        BenchmarkError: the runs have no case in common, or different meshes.
    """
    if new.meshes != old.meshes:
        raise BenchmarkError(f"the runs have different meshes: {new.meshes} now, {old.meshes} in the old one")
    changes = [change for name in new.cases if name in old.cases for change in _compare_case(name, new, old)]
    if not changes:
        raise BenchmarkError("the runs have no measured case in common")
    return changes


def _compare_case(name: str, new: Results, old: Results) -> Iterator[Change]:
    now, before = new.cases[name], old.cases[name]
    nodes, old_nodes = now.facts.get("nodes"), before.facts.get("nodes")
    if now.figures and before.figures and nodes != old_nodes:
        raise BenchmarkError(f"{name}: has {nodes} nodes now and had {old_nodes}; compare runs of the same meshes")
    for metric, figure in now.figures.items():
        if metric.endswith(COMPARED) and metric in before.figures and figure.median and before.figures[metric].median:
            yield _compare_figure(f"{name}.{metric}", figure, before.figures[metric], now, before)


def _compare_figure(name: str, new: RepeatedMetric, old: RepeatedMetric, now: CaseResult, before: CaseResult) -> Change:
    ratio = old.median / new.median if name.endswith(RATES) else new.median / old.median
    noise = new.spread / new.median + old.spread / old.median
    if name.endswith(TIMES):
        ratio *= median(before.calibration_ms) / median(now.calibration_ms)
        noise += _scatter(now.calibration_ms) + _scatter(before.calibration_ms)
    return Change(name, ratio, max(LEAST_NOISE, noise))


def _scatter(values: list[float]) -> float:
    return (max(values) - min(values)) / median(values)
