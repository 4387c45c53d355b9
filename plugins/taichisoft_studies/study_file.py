"""The tables of a study's file, checked as a scene is: unknown keys and wrong values are errors that name the key."""

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeVar

from pydantic import Discriminator, Field, Tag, ValidationError, model_validator

from taichisoft.scenes import Number, Positive, Table, find_file, first_problem
from taichisoft_studies.errors import StudyError

Count = Annotated[int, Field(strict=True, ge=1)]
Whole = Annotated[int, Field(strict=True, ge=0)]
AnyStudy = TypeVar("AnyStudy", bound="Study")
MOST = 10_000
"""Runs in a study: more are a slip of the keyboard."""
DASHBOARD = "127.0.0.1:0"
HIGHEST_PORT = 65535


class Range(Table):
    """Numbers between two bounds, both included."""

    low: Number
    """Smallest value."""
    high: Number
    """Largest value."""
    count: Count | None = None
    """How many values a grid takes, evenly spaced; needed where nothing is sampled."""
    log: bool = False
    """Whether the values are spaced evenly in their logarithm."""
    integer: bool = False
    """Whether the values are whole numbers."""

    @model_validator(mode="after")
    def _check_range(self) -> Self:
        if not self.low < self.high:
            raise ValueError(f"low ({self.low:g}) must be below high ({self.high:g})")
        if self.log and self.low <= 0.0:
            raise ValueError(f"log needs a positive low; it is {self.low:g}")
        if self.integer and (self.low % 1.0 or self.high % 1.0):
            raise ValueError(f"integer needs whole bounds; they are {self.low:g} and {self.high:g}")
        return self


def _kind_of_values(value: Any) -> str:
    return "<range>" if isinstance(value, dict | Range) else "<list>"


# Only the kind that was meant is checked, so that an error is about it.
Values = Annotated[
    Annotated[Range, Tag("<range>")] | Annotated[tuple[Any, ...], Tag("<list>")], Discriminator(_kind_of_values)
]


class Cluster(Table):
    """Where the runs are made. Without `scheduler` and `slurm`: in processes of this machine."""

    workers: Count | None = None
    """Processes that make one run at a time; as many as there are CPUs otherwise. On SLURM: jobs at a time."""
    scheduler: str | None = None
    """Address of a Dask scheduler whose workers make the runs ("tls://HOST:8786")."""
    slurm: dict[str, Any] | None = None
    """Arguments of `dask_jobqueue.SLURMCluster`: queue, account, cores, processes, memory, walltime, ..."""
    retries: Whole = 10
    """How many workers may be lost under one run before it has failed."""
    dashboard: str = DASHBOARD
    """Host and port of Dask's dashboard, which asks for no password; port 0 stands for any that is free."""

    @model_validator(mode="after")
    def _check_one_place(self) -> Self:
        if self.scheduler is not None and self.slurm is not None:
            raise ValueError("scheduler and slurm are two places for the runs; keep one")
        return self

    @model_validator(mode="after")
    def _check_dashboard(self) -> Self:
        if self.scheduler is not None and "dashboard" in self.model_fields_set:
            raise ValueError("dashboard is that of a scheduler of the study's own; leave it out beside scheduler")
        host, _, port = self.dashboard.rpartition(":")
        if not host or ":" in host or not port.isdecimal() or int(port) > HIGHEST_PORT:
            raise ValueError(
                f"dashboard = {self.dashboard!r}: must look like {DASHBOARD}, a host and a port up to {HIGHEST_PORT}"
            )
        return self

    @property
    def dashboard_host(self) -> str:
        """The host on which Dask's dashboard listens."""
        return self.dashboard.rpartition(":")[0]


class Study(Table):
    """Keys of all kinds of studies: the run that is made many times."""

    scene: str
    """Scene file, or the name of a shipped scene."""
    set: tuple[str, ...] = ()
    """Changes of the scene that all runs have ("contact.friction=0.3"); geometry keys ("body.width=20") as well."""
    controller: str | None = None
    """Name of a controller instead of the scene's own."""
    duration: Positive | None = None
    """Simulated time [s]; the scene's when it is not given."""
    outputs: tuple[str, ...] = ("metrics",)
    """Outputs of each run; "metrics" always takes part."""
    plugins: tuple[str, ...] = ()
    """Plug-ins that the runs need: files or folders, beside the study or in the current folder."""
    seed: Whole = 1
    """Start of all random numbers: of sampling, of samplers, and of a run's plug-ins."""
    time_limit: Positive = 3600.0
    """Longest time for one run [s]; its process is then killed. The first run of a worker compiles kernels in it."""
    cluster: Cluster = Cluster()


class Sample(Table):
    """Random combinations instead of all of them."""

    method: Literal["lhs", "sobol", "random"] = "lhs"
    """Latin hypercube, scrambled Sobol' sequence, or independent random numbers."""
    count: Count
    """Number of combinations."""


class Sweep(Study):
    """Runs with all combinations of values, or with samples of them."""

    vary: dict[str, Values]
    """Values by key: a list, or a table with low, high and count."""
    sample: Sample | None = None
    repeats: Count = 1
    """Runs of each combination, with the seeds `seed`, `seed` + 1, and so on."""

    @model_validator(mode="after")
    def _check_values(self) -> Self:
        check_values(self.vary, "vary")
        for key, values in self.vary.items():
            if self.sample is None and isinstance(values, Range) and values.count is None:
                raise ValueError(f"vary.{key}: a range needs count, unless there is a table [sample]")
        return self


def check_values(varied: Mapping[str, Values], table: str) -> None:
    """Raise ValueError for a list of values that is empty or has one twice, or where nothing varies at all."""
    if not varied:
        raise ValueError(f"{table} has no key; name what varies")
    for key, values in varied.items():
        if isinstance(values, tuple):
            if not values:
                raise ValueError(f"{table}.{key}: has no values")
            twice = next((value for index, value in enumerate(values) if value in values[:index]), None)
            if twice is not None:
                raise ValueError(f"{table}.{key}: the value {twice!r} is given twice")


def find_study(name: str | Path) -> Path:
    """The path of a study's file, given by path or as the name of a shipped one.

    Raises:
        StudyError: the file does not exist.
    """
    return find_file(name, "studies", (".toml",), error=StudyError)


def read_tables(path: Path) -> dict[str, Any]:
    """The tables of a study's file; scene and plug-ins that lie beside it become absolute paths.

    Raises:
        StudyError: the file is not valid TOML.
    """
    try:
        tables = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, OSError) as error:
        raise StudyError(f"{path}: not readable as TOML: {error}") from error
    for key in ("vary", "variables", "parameters", "start"):
        if isinstance(tables.get(key), dict):
            tables[key] = dotted(tables[key])
    several = tables.get("scenes")
    for table in (tables, *(several.values() if isinstance(several, dict) else ())):
        if isinstance(table, dict) and isinstance(table.get("scene"), str):
            table["scene"] = _beside(table["scene"], path)
    if isinstance(tables.get("plugins"), list):
        tables["plugins"] = [_beside(name, path) for name in tables["plugins"]]
    return tables


def check_study(kind: type[AnyStudy], tables: Mapping[str, Any], source: str) -> AnyStudy:
    """The tables of a study, checked; `source` begins every error.

    Raises:
        StudyError: something in them is not valid.
    """
    try:
        return kind.model_validate(dict(tables))
    except ValidationError as error:
        raise StudyError(f"{source}: {first_problem(error, kind)}") from error


def dotted(tables: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Tables within tables as one table with dotted keys; a table of values (low, high, ...) stays one."""
    flat: dict[str, Any] = {}
    for key, value in tables.items():
        inner = isinstance(value, dict) and not {"low", "high", "start"} & set(value)
        flat |= dotted(value, f"{prefix}{key}.") if inner else {f"{prefix}{key}": value}
    return flat


def _beside(name: Any, path: Path) -> Any:
    """A path beside the study's file where there is one, otherwise the name itself."""
    if not isinstance(name, str):
        return name
    candidate = path.parent / Path(name).expanduser()
    return str(candidate.resolve()) if candidate.exists() else name
