"""The results of a benchmark, as JSON, read back for comparisons."""

import json
import statistics
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError

from taichisoft.scene import Number, Table, first_problem
from taichisoft_benchmarks.errors import BenchmarkError

FILE = "results.json"


class RepeatedMetric(Table):
    """One metric of a case: a value per repetition, and their minimum, median and spread."""

    values: Annotated[list[Number], Field(min_length=1)]
    minimum: Number
    median: Number
    spread: Number
    """Difference of the largest and the smallest value."""

    @classmethod
    def of(cls, values: Sequence[float]) -> "RepeatedMetric":
        """The figure of these repetitions."""
        rounded = [float(f"{value:.6g}") for value in values]
        return cls(
            values=rounded,
            minimum=min(rounded),
            median=statistics.median(rounded),
            spread=float(f"{max(rounded) - min(rounded):.6g}"),
        )


class CaseResult(Table):
    """The result of one case."""

    group: str
    parameter: dict[str, Any] = Field(default_factory=dict)
    """Keys and values that distinguish the case in its group."""
    title: str
    kind: str
    threads: int
    """Number of threads; 0 is all cores."""
    figures: dict[str, RepeatedMetric] = Field(default_factory=dict)
    """Figures by metric; the end of a metric's name is its unit (_ms, _s, _mb), ratios have none."""
    facts: dict[str, Any] = Field(default_factory=dict)
    """Properties of the case that was measured: nodes, contacts, sweeps."""
    phases: dict[str, Number] = Field(default_factory=dict)
    """Time of each phase of the step at the end of the case [ms]."""
    calibration_ms: list[Number] = Field(default_factory=list)
    """Calibration beside each repetition [ms]."""
    does_not: str = ""
    """Parts of the job that another program leaves out."""
    skipped: str = ""
    """Why nothing was measured."""
    problem: str = ""
    """How the case failed."""


class Results(Table):
    """One run of the suite."""

    format: Literal[1] = 1
    started: str
    meshes: Literal["shipped", "tutorial"]
    quick: bool = False
    interrupted: bool = False
    """Whether cases are missing because the run was stopped."""
    machine: dict[str, str]
    versions: dict[str, str]
    load: dict[str, Number]
    """Load at the start and at the end."""
    cases: dict[str, CaseResult] = Field(default_factory=dict)
    derived: dict[str, Number] = Field(default_factory=dict)
    """Figures of several cases: gains by threads, times over those of other programs."""


def derive(cases: Mapping[str, CaseResult]) -> dict[str, float]:
    """Gains by threads, and our times over those of other programs, where these were measured.

    A ratio to another program is the median over the rounds, in each of which the two ran one after the other.
    """
    found = {}
    for name, case in cases.items():
        for peer, theirs in (
            (other, cases[other]) for other in cases if other.startswith(f"{name}_") and cases[other].does_not
        ):
            for metric in case.figures.keys() & theirs.figures.keys():
                if metric.endswith("_ms"):
                    # A run that was stopped in between has one value more of ours.
                    pairs = zip(case.figures[metric].values, theirs.figures[metric].values, strict=False)
                    found[f"{peer}.{metric}_ratio"] = float(f"{median(ours / other for ours, other in pairs):.4g}")
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
                if metric.endswith("_ms") and not metric.startswith(("cholmod", "superlu", "python")):
                    gain = first.figures[metric].median / last.figures[metric].median
                    found[f"{name}.{metric.removesuffix('_ms')}_gain"] = float(f"{gain:.4g}")
    return found


def read_results(path: Path) -> Results:
    """Read the results in `--output`: a file, or the folder that it is in."""
    path = path / FILE if path.is_dir() else path
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise BenchmarkError(f"{path}: not readable as JSON: {error}") from error
    try:
        return Results.model_validate(document)
    except ValidationError as error:
        raise BenchmarkError(f"{path}: not results of the benchmarks: {first_problem(error, Results)}") from error


def require_writable(folder: Path) -> None:
    """Make the folder of results, before the work."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / FILE).open("a").close()
    except OSError as error:
        raise BenchmarkError(f"--output {folder}: cannot be written: {error.strerror or error}") from error


def write_results(results: Results, folder: Path) -> Path:
    """Write `results.json`, which `read_results` reads."""
    require_writable(folder)
    path = folder / FILE
    path.write_text(json.dumps(results.model_dump(), indent=1) + "\n", encoding="utf-8")
    return path


LEAST_NOISE = 0.05
"""Least noise: three repetitions say little about a machine, however alike they are."""

TIMES = ("_ms", "_s")
COMPARED = (*TIMES, "_mb")


@dataclass(frozen=True)
class Change:
    """One figure in two runs.

    Attributes:
        name: "case.metric".
        ratio: new over old [-], times each divided by its calibration.
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
    """Every time and every peak of memory that both runs have."""
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
    ratio = new.median / old.median
    noise = new.spread / new.median + old.spread / old.median
    if name.endswith(TIMES):
        ratio *= median(before.calibration_ms) / median(now.calibration_ms)
        noise += _scatter(now.calibration_ms) + _scatter(before.calibration_ms)
    return Change(name, ratio, max(LEAST_NOISE, noise))


def _scatter(values: list[float]) -> float:
    return (max(values) - min(values)) / median(values)
