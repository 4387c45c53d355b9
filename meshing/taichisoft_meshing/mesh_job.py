"""The request for one mesh, its fingerprint, and the mesh with its figures."""

import functools
import hashlib
import inspect
import json
import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import taichisoft
from taichisoft.errors import MeshError, nearest
from taichisoft.mesh import VolumeMesh
from taichisoft.running import Geometry
from taichisoft_meshing.geometry_file import find_kind, make_geometry, mesh_geometry, quality_limits
from taichisoft_meshing.gmsh_session import gmsh_version
from taichisoft_meshing.mesh_quality import (
    MeshQuality,
    QualityLimits,
    cautions,
    faults,
    measure,
    missed_limits,
    summary,
)
from taichisoft_meshing.size_search import size_for_nodes

# A hash of all inputs of a mesh: meshes with the same hash are the same.

OWN_CODE = Path(__file__).resolve().parent


def fingerprint(kind: Callable[..., Any], tables: Mapping[str, Any], folder: Path, request: Mapping[str, Any]) -> str:
    """Hash the tables after overrides, the files that they name, the request, and the code that makes the mesh.

    Args:
        kind: class or function that makes the geometry; its whole package counts as code.
        tables: tables of the geometry file, its `kind` included.
        folder: folder of the files that the tables name: any text in them that is the path of a file there.
        request: size, preset or number of nodes.
    """
    parts = [
        json.dumps([tables, request], sort_keys=True, default=str).encode(),
        *(file.read_bytes() for file in named_files(tables, folder)),
        f"taichisoft {taichisoft.__version__}, gmsh {gmsh_version()}".encode(),
        *(_digest_of_code(root) for root in dict.fromkeys((OWN_CODE, _package_of(kind)))),
    ]
    whole = hashlib.sha256()
    for part in parts:
        whole.update(hashlib.sha256(part).digest())
    return whole.hexdigest()


def named_files(value: Any, folder: Path) -> Iterator[Path]:
    """The files that texts in the tables name, by sorted keys."""
    if isinstance(value, Mapping):
        for key in sorted(value):
            yield from named_files(value[key], folder)
    elif isinstance(value, list):
        for item in value:
            yield from named_files(item, folder)
    elif isinstance(value, str) and value:
        path = folder / Path(value).expanduser()
        try:
            found = path.is_file()
        except (OSError, ValueError):  # text that can be no path
            found = False
        if found:
            yield path


def _package_of(kind: Callable[..., Any]) -> Path:
    """The outermost package folder that holds the source of a class or function, or its file where it is in none."""
    try:
        source = inspect.getsourcefile(inspect.unwrap(kind))
    except TypeError as error:
        raise OSError(f"the source of {kind!r} cannot be found") from error
    if source is None:
        raise OSError(f"the source of {kind!r} cannot be found")
    place = Path(source).resolve()
    while (place.parent / "__init__.py").is_file():
        place = place.parent
    return place


@functools.cache  # what runs is what was loaded when the process began
def _digest_of_code(place: Path) -> bytes:
    files = sorted(place.rglob("*.py")) if place.is_dir() else [place]
    digests = [hashlib.sha256(file.read_bytes()).digest() for file in files]
    return b"".join(digests)


# The request for one mesh, and the mesh that was made with its figures.


@dataclass(frozen=True)
class MeshJob:
    """The request for a mesh, as plain data that can be sent to another process.

    Attributes:
        kind: name of the geometry kind.
        tables: tables of the geometry, overridden values included.
        file: path of the geometry file; begins every error, and files that the tables name lie beside it.
        asked: `size` [mm], `preset` or `nodes`; empty for the geometry's own size.
    """

    kind: Any
    tables: Mapping[str, Any]
    file: Path
    asked: Mapping[str, Any]

    def fingerprint(self) -> str:
        """A hash of all inputs of the mesh."""
        kind = find_kind(self.kind, self.file)
        return fingerprint(kind, {**self.tables, "kind": self.kind}, self.file.parent, self.asked)


@dataclass(frozen=True)
class MadeMesh:
    """A mesh with its figures.

    Attributes:
        job: the request for it.
        geometry: the description as its kind understood it.
        mesh: the mesh, which a simulation can read.
        quality: its figures.
        limits: the limits that the geometry file sets to the figures.
        remarks: warnings given while it was made, and cautions about its quality, one line each.
        seconds: time that gmsh took [s].
    """

    job: MeshJob
    geometry: Geometry
    mesh: VolumeMesh
    quality: MeshQuality
    limits: QualityLimits
    remarks: tuple[str, ...]
    seconds: float

    @property
    def problems(self) -> list[str]:
        """Faults and missed limits, one line each."""
        return faults(self.quality) + missed_limits(self.quality, self.limits)


def make_mesh(job: MeshJob, stage: Callable[[str], None] = lambda name: None) -> MadeMesh:
    """Make a mesh and measure it; `stage` is called with the name of each stage that begins."""
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        geometry = make_geometry(job.kind, job.tables, job.file)
        stage("meshing")
        start = time.perf_counter()
        mesh = mesh_as_asked(geometry, job.file, **job.asked)
        seconds = time.perf_counter() - start
    stage("measuring")
    quality = measure(mesh)
    said = dict.fromkeys(" ".join(str(warning.message).split()) for warning in warned)
    limits = quality_limits(job.tables, job.file)
    return MadeMesh(job, geometry, mesh, quality, limits, (*said, *cautions(quality)), seconds)


def require_fit(made: MadeMesh, remedy: str) -> None:
    """Raise MeshError when there is a problem; the message names the first one, and `remedy` ends it."""
    if made.problems:
        raise MeshError(f"{made.job.file}: {summary(made.problems)}; try another size, or {remedy}")


def mesh_as_asked(
    geometry: Geometry, file: Path, size: float | None = None, preset: str | None = None, nodes: int | None = None
) -> VolumeMesh:
    """Mesh a geometry, at its own size unless a size, a preset or a number of nodes is given.

    Args:
        geometry: the body to be meshed.
        file: path of its file; begins every error.
        size: length of the largest element [mm].
        preset: name of one of the geometry's sizes, instead of `size`.
        nodes: approximate number of nodes, instead of `size`.
    """
    if nodes is not None:
        return size_for_nodes(geometry, nodes)[1]
    if preset is not None:
        presets = geometry.presets
        if preset not in presets:
            raise MeshError(f"{file}: preset '{preset}': unknown; {nearest(preset, list(presets), 'there are')}")
        size = presets[preset]
    return mesh_geometry(geometry, size, file)
