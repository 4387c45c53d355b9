"""What a benchmark found, as JSON: read back for comparisons, plots and the page of results."""

import json
import statistics
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError

from taichisoft.scenes.scene import Number, Table
from taichisoft.scenes.validation_errors import first_problem
from taichisoft_benchmarks.errors import BenchmarkError


class Figure(Table):
    """One metric of a case: a value per repetition and what is said of them."""

    values: Annotated[list[Number], Field(min_length=1)]
    minimum: Number
    median: Number
    spread: Number
    """Largest less smallest value."""

    @classmethod
    def of(cls, values: Sequence[float]) -> "Figure":
        """The figure of these repetitions."""
        rounded = [float(f"{value:.6g}") for value in values]
        return cls(
            values=rounded,
            minimum=min(rounded),
            median=statistics.median(rounded),
            spread=float(f"{max(rounded) - min(rounded):.6g}"),
        )


class CaseResult(Table):
    """One case."""

    group: str
    parameter: dict[str, Any] = Field(default_factory=dict)
    """What distinguishes it in its group."""
    title: str
    kind: str
    threads: int
    """0 is all cores."""
    figures: dict[str, Figure] = Field(default_factory=dict)
    """By metric; the end of its name is the unit (_ms, _s, _mb), ratios have none."""
    facts: dict[str, Any] = Field(default_factory=dict)
    """What the case turned out to be: nodes, contacts, sweeps."""
    phases: dict[str, dict[str, Number]] = Field(default_factory=dict)
    """[ms] by phase of the step, at the `end` of cases of many steps."""
    calibration_ms: list[Number] = Field(default_factory=list)
    """Of each repetition, beside it."""
    does_not: str = ""
    """What another program leaves out of the job."""
    skipped: str = ""
    """Why nothing was measured."""
    problem: str = ""
    """How it failed."""


class Results(Table):
    """One run of the suite."""

    format: Literal[1] = 1
    started: str
    meshes: Literal["shipped", "tutorial"]
    quick: bool = False
    interrupted: bool = False
    """Whether cases are missing because it was stopped."""
    machine: dict[str, str]
    versions: dict[str, str]
    load: dict[str, Number]
    """At the start and at the end."""
    cases: dict[str, CaseResult] = Field(default_factory=dict)
    derived: dict[str, Number] = Field(default_factory=dict)
    """Figures of a whole group: gains by threads, memory per finger."""


def read_results(path: Path) -> Results:
    """Read a file of `taichisoft bench --json`.

    Raises:
        BenchmarkError: it is missing, no JSON, or not of this kind.
    """
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise BenchmarkError(f"{path}: not readable as JSON: {error}") from error
    try:
        return Results.model_validate(document)
    except ValidationError as error:
        raise BenchmarkError(f"{path}: no results of taichisoft bench: {first_problem(error, Results)}") from error


def require_writable(path: Path) -> None:
    """Make the folder of a file that is to be written, and an empty file where there is none.

    Raises:
        BenchmarkError: it cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.open("a").close()
    except OSError as error:
        raise BenchmarkError(f"--json {path}: cannot be written: {error.strerror or error}") from error


def write_results(results: Results, path: Path) -> None:
    """Write what `read_results` reads.

    Raises:
        BenchmarkError: the file cannot be written.
    """
    require_writable(path)
    path.write_text(json.dumps(results.model_dump(), indent=1) + "\n", encoding="utf-8")
