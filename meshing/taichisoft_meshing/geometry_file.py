"""Geometry files: TOML whose `kind` says which plug-in knows what it describes."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, TypeVar

from pydantic import BaseModel, ValidationError

from taichisoft.base import read_toml
from taichisoft.errors import MeshError, PluginError, nearest
from taichisoft.mesh import VolumeMesh
from taichisoft.running import Geometry, failures_of, provided
from taichisoft.scene import first_problem
from taichisoft_meshing.mesh_quality import QUALITY, QualityLimits

DEFAULT_KIND = "pneunet_finger"
STEP_SUFFIXES = (".step", ".stp")
# [mm] Sums of decimal fractions may miss by rounding.
ROUNDING = 1e-9

AnyTable = TypeVar("AnyTable", bound=BaseModel)


def is_geometry(file: str) -> bool:
    """Whether a scene's mesh is a geometry to be meshed, not a mesh, by the end of its file's name."""
    return Path(file).suffix.lower() in (".toml", *STEP_SUFFIXES)


class _CommonTables(BaseModel):
    """The part of a geometry file that is the same for every kind."""

    quality: QualityLimits = QualityLimits()


def read_geometry(path: Path) -> Geometry:
    """Read and check what a file describes, without meshing it."""
    return make_geometry(*read_tables(path), path)


def read_tables(path: Path) -> tuple[Any, dict[str, Any]]:
    """The kind and the tables of a file; a STEP file is its own description."""
    if path.suffix.lower() in STEP_SUFFIXES:
        return "step", {"file": path.name}
    try:
        tables = read_toml(path)
    except FileNotFoundError as error:
        raise MeshError(f"{path}: no such file; a geometry file (.toml) is needed") from error
    except (ValueError, OSError) as error:
        raise MeshError(f"{path}: not readable as TOML: {error}") from error
    return tables.pop("kind", DEFAULT_KIND), tables


def make_geometry(kind: Any, tables: Mapping[str, Any], path: Path) -> Geometry:
    """Check tables that `read_tables` gave, perhaps changed since, and make a geometry of their kind.

    The table `quality` is the same for every kind, which does not see it.
    """
    make = find_kind(kind, path)
    quality_limits(tables, path)
    with failures_of(f"{path}: geometry kind '{kind}' failed"):
        made = make({key: table for key, table in tables.items() if key != QUALITY}, path)
    if not isinstance(made, Geometry):
        raise PluginError(f"{path}: geometry kind '{kind}' gave {made!r}; must be a taichisoft.Geometry")
    return made


def find_kind(kind: Any, path: Path) -> Callable[..., Geometry]:
    """The class or function that makes geometries of a kind, which the file at `path` names."""
    kinds = provided("geometry kind")
    if not isinstance(kind, str) or kind not in kinds:
        raise MeshError(f"{path}: kind = {kind!r}: unknown; {nearest(str(kind), sorted(kinds), 'there are')}")
    return kinds[kind]


def quality_limits(tables: Mapping[str, Any], path: Path) -> QualityLimits:
    """The limits in the tables of a geometry file, or the defaults."""
    return checked(_CommonTables, {key: tables[key] for key in (QUALITY,) if key in tables}, path).quality


def checked(table: type[AnyTable], tables: Mapping[str, Any], file: Path) -> AnyTable:
    """The tables of a geometry file, checked.

    Raises:
        MeshError: something in them is not valid; the message begins with the file.
    """
    try:
        return table.model_validate(dict(tables))
    except ValidationError as error:
        raise MeshError(f"{file}: {first_problem(error, table)}") from error


@dataclass(frozen=True)
class CheckedGeometry(Geometry):
    """A geometry that the tables of a file describe, checked as soon as it is made.

    Attributes:
        tables: tables of the geometry file, as TOML gives them.
        file: path of the geometry file; errors begin with it, and names of files in the tables are relative to it.
        table_type: pydantic model of the tables.

    Raises:
        MeshError: something in the tables is not valid.
    """

    tables: Mapping[str, Any]
    file: Path
    table_type: ClassVar[type[BaseModel]]

    def __post_init__(self) -> None:
        _ = self.table

    @cached_property
    def table(self) -> Any:
        """The tables, checked: an instance of `table_type`."""
        return checked(self.table_type, self.tables, self.file)

    @property
    def parameters(self) -> dict[str, Any]:
        """The tables, with the defaults of what they leave open."""
        return self.table.model_dump(mode="json", exclude_none=True)  # type: ignore[no-any-return]

    def sized(self, size: float | None) -> Any:
        """The tables with `size` [mm] as `mesh.largest`, and `mesh.smallest` scaled with it; unchanged for None."""
        if size is None:
            return self.table
        smallest = size * self.table.mesh.smallest / self.table.mesh.largest
        sizes = {**self.tables.get("mesh", {}), "largest": size, "smallest": smallest}
        return checked(self.table_type, {**self.tables, "mesh": sizes}, self.file)


def mesh_geometry(geometry: Geometry, size: float | None, path: Path) -> VolumeMesh:
    """Mesh the geometry that was read from `path`, with largest elements of `size` [mm], and check the result."""
    with failures_of(f"{path}: {type(geometry).__name__} failed in mesh()"):
        mesh = geometry.mesh(size)
    if not isinstance(mesh, VolumeMesh):
        raise PluginError(f"{path}: {type(geometry).__name__}.mesh() gave {mesh!r}; must be a VolumeMesh")
    return mesh.check()


def at_least(key: str, value: float, low: float, why: str) -> None:
    """Raise ValueError, "key = value: must be at least low (why)", for a value below `low`."""
    if value < low - ROUNDING:
        raise ValueError(f"{key} = {value:g}: must be at least {low:g} ({why})")


def at_most(key: str, value: float, high: float, why: str) -> None:
    """Raise ValueError, "key = value: must be at most high (why)", for a value above `high`."""
    if value > high + ROUNDING:
        raise ValueError(f"{key} = {value:g}: must be at most {high:g} ({why})")
