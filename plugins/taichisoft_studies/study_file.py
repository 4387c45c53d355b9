"""The tables of a study's file, checked as a scene is: unknown keys and wrong values are errors that name the key."""

import ast
import itertools
import json
import math
import tomllib
from collections.abc import Mapping, Sequence
from copy import deepcopy
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeVar

import numpy as np
from pydantic import Discriminator, Field, Tag, ValidationError, model_validator

from taichisoft import Scene
from taichisoft.base import CANNOT_BE_COMPUTED, ExpressionError, evaluate, read_expression
from taichisoft.errors import nearest
from taichisoft.running import load_scene
from taichisoft.scene import Number, Positive, Table, apply_override, find_file, first_problem
from taichisoft_studies.errors import StudyError

# Expressions in a study's file: numbers computed from the names of a run, a row or a step.


class Expression:
    """An expression that has been read, and can be evaluated many times.

    Attributes:
        text: as it was written.
    """

    def __init__(self, text: str, key: str):
        """Read it; `key` is its place in the study, which begins every error."""
        self.text, self._where = text, f"{key} = {text!r}"
        try:
            self._tree = read_expression(text)
        except ExpressionError as error:
            raise StudyError(f"{self._where}: {error}") from error

    @property
    def names(self) -> set[str]:
        """The names in it, but for functions."""
        parts = list(ast.walk(self._tree))
        functions = {id(part.func) for part in parts if isinstance(part, ast.Call)}
        return {part.id for part in parts if isinstance(part, ast.Name) and id(part) not in functions}

    def __call__(self, names: Mapping[str, Any]) -> float:
        """Its value, with these values of names."""
        number = self._number(self._tree, names)
        if not math.isfinite(number):
            raise StudyError(f"{self._where}: is {number:g}, not a finite number")
        return number

    def violation(self, names: Mapping[str, Any]) -> float:
        """By how much a comparison of two values is missed: not positive where it holds."""
        match self._tree:
            case ast.Compare(left, [ast.Lt() | ast.LtE()], [right]):
                low, high = left, right
            case ast.Compare(left, [ast.Gt() | ast.GtE()], [right]):
                low, high = right, left
            case _:
                raise StudyError(f"{self._where}: must compare two values by <= or >=")
        below, above = self._number(low, names), self._number(high, names)
        if not (math.isfinite(below) and math.isfinite(above)):
            raise StudyError(f"{self._where}: compares {below:g} with {above:g}; both must be finite numbers")
        return below - above

    def _number(self, part: ast.expr, names: Mapping[str, Any]) -> float:
        try:
            return float(evaluate(part, names))
        except (ExpressionError, *CANNOT_BE_COMPUTED) as error:
            raise StudyError(f"{self._where}: {error}") from error


# The keys that a study varies: keys of a scene, or of the geometry that its bodies are meshed from.


def scene_with(name: str, overrides: Mapping[str, Any], controller: str | None) -> Scene:
    """Read a scene with values in place of its own.

    Args:
        name: path of the scene, or name of a shipped one.
        overrides: values by dotted key. A key whose first part a scene does not have ("body.width") belongs to the
            geometry of all soft bodies that are meshed from a geometry file; "NAME:body.width" to that of one body.
        controller: name of a controller instead of the scene's own.
    """
    of_scene = {key: value for key, value in overrides.items() if is_of_scene(key)}
    texts = [f"{key}={toml_value(value)}" for key, value in of_scene.items()]
    if len(of_scene) < len(overrides):
        resolved = load_scene(name, texts, controller)
        of_geometry = {key: value for key, value in overrides.items() if key not in of_scene}
        texts += _geometry_overrides(name, resolved, of_geometry)
    return load_scene(name, texts, controller)


def is_of_scene(key: str) -> bool:
    """Whether a key begins with one of the scene's tables or values."""
    return key.partition(".")[0] in Scene.model_fields


def toml_value(value: Any) -> str:
    """A value as TOML in one line, tables included."""
    if isinstance(value, Mapping):
        inner = ", ".join(f"{json.dumps(key)} = {toml_value(item)}" for key, item in value.items())
        return f"{{ {inner} }}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(toml_value, value))}]"
    if isinstance(value, str):
        return json.dumps(value)
    if isinstance(value, bool):
        return "true" if value else "false"
    return repr(value)


def _geometry_overrides(name: str, scene: Scene, values: Mapping[str, Any]) -> list[str]:
    """Overrides "soft_bodies.NAME.mesh=..." that lay values over the geometry of each body that they are for."""
    from taichisoft_meshing.geometry_file import is_geometry

    meshes = {
        body: deepcopy({"file": table.mesh.file, **table.mesh.request})
        for body, table in scene.soft_bodies.items()
        if is_geometry(table.mesh.file)
    }
    for key, value in values.items():
        body, separator, path = key.rpartition(":")
        if separator and body not in meshes:
            raise StudyError(f"{key}: '{body}' has no geometry file; {nearest(body, list(meshes), 'bodies with one')}")
        if not meshes:
            tables = ", ".join(Scene.model_fields)
            raise StudyError(
                f"{key}: is not a key of a scene ({tables}), and no soft body of {name} is meshed from a geometry file "
                "(.toml, .step)"
            )
        for mesh in [meshes[body]] if separator else meshes.values():
            place = mesh.setdefault("set", {})
            if path == "mesh.largest":  # which a size that the scene asks for would take the place of
                mesh.update(dict.fromkeys(("size", "preset", "nodes")))
            *tables_above, last = path.split(".")
            for table in tables_above:
                place = place.setdefault(table, {})
            place[last] = value
    given = {body: {key: item for key, item in mesh.items() if item is not None} for body, mesh in meshes.items()}
    return [f"soft_bodies.{body}.mesh={toml_value(mesh)}" for body, mesh in given.items()]


Count = Annotated[int, Field(strict=True, ge=1)]
Whole = Annotated[int, Field(strict=True, ge=0)]
AnyStudy = TypeVar("AnyStudy", bound="Study")
MOST = 10_000
"""Runs in a study: more are a slip of the keyboard."""


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
    """Where the runs are made: in processes of this machine, unless there is a `scheduler`."""

    workers: Count | None = None
    """Runs at a time on this machine; as many as CPUs otherwise."""
    scheduler: str | None = None
    """Address of a Dask scheduler whose workers make the runs ("tls://HOST:8786")."""
    retries: Whole = 2
    """How often a run is begun again whose process was killed."""


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
    """The path of a study's file, given by path or as the name of a shipped one."""
    return find_file(name, "studies", (".toml",), error=StudyError)


def read_tables(path: Path) -> dict[str, Any]:
    """The tables of a study's file; scene and plug-ins that lie beside it become absolute paths."""
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
    """The tables of a study, checked; `source` begins every error."""
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


# Values of the keys that vary: read from a command line, and combined for the runs of a sweep.


def varied(texts: Sequence[str]) -> dict[str, Any]:
    """Tables of values, as in a study's file, from "key=a,b,c" (a list) and "key=low:high:count" (evenly spaced)."""
    tables: dict[str, Any] = {}
    for text in texts:
        key, separator, values = text.partition("=")
        key, parts = key.strip(), _split_values(values)
        if not separator or not key or not all(parts):
            raise StudyError(f"--vary {text}: must look like body.width=20,22,25 or contact.friction=0.2:1.0:5")
        if key in tables:
            raise StudyError(f"--vary {key}: is given twice; put its values into one list")
        if len(parts) > MOST:
            raise StudyError(f"--vary {key}: {len(parts)} values are more than the {MOST} runs that a sweep may have")
        is_range = len(parts) == 1 and ":" in values and not values.startswith('"')
        tables[key] = _range(text, values) if is_range else [value_from(part) for part in parts]
    return tables


def value_from(text: str) -> Any:
    """The value that a text stands for: TOML, or the text itself."""
    holder: dict[str, Any] = {}
    apply_override(holder, f"value={text}")
    return holder["value"]


def combinations(varied: Mapping[str, Values], sample: Sample | None, seed: int) -> list[dict[str, Any]]:
    """The values of each run by key; on a grid the last key's values change fastest."""
    if sample is not None:
        if sample.count > MOST:
            raise StudyError(f"sample.count = {sample.count}: more than the {MOST} runs that a sweep may have")
        rows = unit_samples(sample, len(varied), seed).tolist()
        return [{key: _value_at(varied[key], share) for key, share in zip(varied, row, strict=True)} for row in rows]
    count = math.prod(map(_grid_size, varied.values()))
    if count > MOST:
        raise StudyError(f"vary: {count} combinations are more than the {MOST} that a sweep may have")
    return [dict(zip(varied, chosen, strict=True)) for chosen in itertools.product(*map(grid, varied.values()))]


def unit_samples(sample: Sample, dimensions: int, seed: int) -> np.ndarray:
    """Points of the unit cube, shape (sample.count, dimensions); the same seed gives the same ones."""
    from scipy.stats import qmc

    generator = np.random.default_rng(seed)
    if sample.method == "random":
        return generator.random((sample.count, dimensions))
    engine: Any = qmc.LatinHypercube if sample.method == "lhs" else qmc.Sobol
    points: np.ndarray = engine(dimensions, rng=generator).random(sample.count)
    return points


def grid(values: Values) -> list[Any]:
    """The values of one key; `count` of them for a range, whole numbers once each."""
    if not isinstance(values, Range):
        return list(values)
    assert values.count is not None  # the study's table sees to it
    if values.integer and values.count > values.high - values.low:
        return list(range(int(values.low), int(values.high) + 1))
    shares = [0.5] if values.count == 1 else np.linspace(0.0, 1.0, values.count).tolist()
    if not values.integer:
        return [_value_at(values, share) for share in shares]
    return list(dict.fromkeys(round(values.low + share * (values.high - values.low)) for share in shares))


def _grid_size(values: Values) -> int:
    """Number of values that `grid` gives, without making them."""
    if not isinstance(values, Range):
        return len(values)
    assert values.count is not None
    return min(values.count, int(values.high - values.low) + 1) if values.integer else values.count


def _value_at(values: Values, share: float) -> Any:
    """The value at a share, from 0 to 1, of a range or list, rounded to ten digits."""
    if not isinstance(values, Range):
        return values[min(int(share * len(values)), len(values) - 1)]
    low, high = values.low, values.high
    if values.integer:
        return min(int(low + share * (high - low + 1)), int(high))
    value = low * (high / low) ** share if values.log else low + share * (high - low)
    return float(f"{value:.10g}")


def _split_values(values: str) -> list[str]:
    """Split values at commas, but not at commas inside the brackets or quotes of a TOML value."""
    parts, depth, quoted = [""], 0, False
    for letter in values:
        quoted ^= letter == '"'
        depth += (letter in "[{") - (letter in "]}") if not quoted else 0
        if letter == "," and not depth and not quoted:
            parts.append("")
        else:
            parts[-1] += letter
    return [part.strip() for part in parts]


def _range(text: str, values: str) -> Mapping[str, Any]:
    """The table of a range "low:high:count"; `text` is the whole option, for the error."""
    try:
        low, high, *count = values.split(":")
        table = {"low": float(low), "high": float(high)}
        return {**table, "count": int(*count)} if count else table
    except (ValueError, TypeError) as error:
        raise StudyError(f"--vary {text}: a range must look like 0.2:1.0:5, lowest, highest and count") from error
