"""One mesh: the request for it, made in a process of its own, kept in a cache, and the mesh with its figures."""

import functools
import hashlib
import inspect
import json
import logging
import os
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import taichisoft
from taichisoft.base import (
    WorkerLost,
    WorkerSlow,
    call_apart,
    checksum_file,
    is_as_kept,
    keep_checksum,
    warn_caller,
)
from taichisoft.base import cache_folder as users_cache_folder
from taichisoft.errors import MeshError, TaichisoftError, nearest
from taichisoft.mesh import VolumeMesh
from taichisoft.running import FILE_OPTION, Geometry, load_requested, plugin_registry, provided_by_plugin
from taichisoft_meshing.body_tables import size_for_nodes
from taichisoft_meshing.cad_body import CadBody
from taichisoft_meshing.geometry_file import find_kind, make_geometry, mesh_geometry, quality_limits, read_tables
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

LOGGER = logging.getLogger("taichisoft.meshing")

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
            is_file = path.is_file()
        except (OSError, ValueError):  # text that can be no path
            is_file = False
        if is_file:
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
        request: `size` [mm], `preset` or `nodes`; empty for the geometry's own size.
    """

    kind: Any
    tables: Mapping[str, Any]
    file: Path
    request: Mapping[str, Any]

    def fingerprint(self) -> str:
        """A hash of all inputs of the mesh."""
        kind = find_kind(self.kind, self.file)
        return fingerprint(kind, {**self.tables, "kind": self.kind}, self.file.parent, self.request)


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
        mesh = requested_mesh(geometry, job.file, **job.request)
        seconds = time.perf_counter() - start
    stage("measuring")
    quality = measure(mesh)
    given = dict.fromkeys(" ".join(str(warning.message).split()) for warning in warned)
    limits = quality_limits(job.tables, job.file)
    return MadeMesh(job, geometry, mesh, quality, limits, (*given, *cautions(quality)), seconds)


def require_fit(made: MadeMesh, remedy: str) -> None:
    """Raise MeshError when there is a problem; the message names the first one, and `remedy` ends it."""
    if made.problems:
        raise MeshError(f"{made.job.file}: {summary(made.problems)}; try another size, or {remedy}")


def requested_mesh(
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


TIME_LIMIT = 3600.0
"""Longest time that a mesh may take [s]."""
BETWEEN_LINES = 30.0
"""Time between two lines that say how long a mesh has taken so far [s]."""


def make_mesh_apart(
    job: MeshJob, stage: Callable[[str], None] = lambda name: None, time_limit: float = TIME_LIMIT
) -> MadeMesh:
    """Make a mesh as `make_mesh` does, in a process of its own.

    A kind of geometry that only this process knows, an object of somebody's code, is meshed in this one.

    Args:
        job: the request for the mesh.
        stage: called with the name of the stage that begins.
        time_limit: longest time [s].
    """
    if not _known_elsewhere(job):
        return make_mesh(job, stage)
    stage("meshing")
    made: MadeMesh = call_with_plugins(make_mesh, job, time_limit=time_limit)
    return made


def call_with_plugins(
    function: Callable[..., Any], job: MeshJob, *arguments: Any, time_limit: float = TIME_LIMIT
) -> Any:
    """Call a function in another process that has the plug-ins of this one.

    For a kind of geometry that only this process knows, an object of somebody's code, it is called in this one.
    """
    if not _known_elsewhere(job):
        return function(job, *arguments)
    files = [origin.place for origin in plugin_registry().origins.values() if origin.kind == "file"]
    started = time.monotonic()

    def report() -> None:
        LOGGER.info("meshing %s: %.0f s so far", job.file, time.monotonic() - started)

    try:
        return call_apart(
            "taichisoft_meshing.mesh_job:call_here",
            *(files, function, job, *arguments),
            time_limit=time_limit,
            meanwhile=report,
            every=BETWEEN_LINES,
        )
    except WorkerLost as lost:
        slow = isinstance(lost, WorkerSlow)
        problem = f"it took more than {time_limit:g} s; take larger elements" if slow else lost
        raise MeshError(f"{job.file}: the process that meshes it ended without a mesh: {problem}") from lost


def read_step_apart(path: Path, defeature: float = 0.0) -> CadBody:
    """Read a STEP file as `read_step` does, in a process of its own."""
    try:
        body: CadBody = call_apart("taichisoft_meshing.cad_body:read_step", path, defeature, time_limit=TIME_LIMIT)
    except WorkerLost as lost:
        raise MeshError(f"{path}: the process that reads it ended: {lost}") from lost
    return body


def call_here(files: Sequence[str], function: Callable[..., Any], *arguments: Any) -> Any:
    """What the process does: it loads the plug-ins of `files` and calls a function, without printing warnings."""
    warnings.simplefilter("ignore")
    load_requested([word for file in files for word in (FILE_OPTION, file)])
    return function(*arguments)


def _known_elsewhere(job: MeshJob) -> bool:
    """Whether another process finds the plug-in that knows the kind."""
    for plugin, by_name in provided_by_plugin("geometry kind"):
        if job.kind in by_name:
            origin = plugin_registry().origins[plugin]
            return origin.kind == "file" or bool(origin.distribution)
    return False


FOLDER_VARIABLE = "TAICHISOFT_CACHE"


def cache_folder() -> Path:
    """The folder of kept meshes: `meshes` in the folder that TAICHISOFT_CACHE names, or in the user's cache folder."""
    own = os.environ.get(FOLDER_VARIABLE)
    return (Path(own).expanduser() if own else users_cache_folder()) / "meshes"


def kept_mesh(path: Path | None) -> "VolumeMesh | None":
    """Read the mesh that was kept at a path.

    None if it is absent, or, with a warning, if it cannot be read or has changed.
    """
    from taichisoft.mesh import read_volume_mesh

    if path is None or not path.is_file():
        return None
    if not is_as_kept(path):
        if checksum_file(path).exists():  # otherwise another process is writing it, or was stopped while it did
            warn_caller(f"{path}: has changed since it was written, by its checksum; it is made again")
        return None
    try:
        return read_volume_mesh(path)
    except MeshError as error:
        warn_caller(f"{error}; it is made again")
        return None


def keep_mesh(mesh: "VolumeMesh", path: Path | None) -> "VolumeMesh":
    """Keep a mesh, whole or not at all, so that several processes may keep the same one at a time.

    A folder that cannot be written costs no more than a warning, and without a path nothing is kept.

    Returns:
        The mesh as it is read from a file, in which triangles may stand in another order: so a run gives the same
        bits whether its mesh was made in it or before.
    """
    if path is not None:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            kept = _through_file(mesh, path)
            keep_checksum(path)
            return kept
        except (OSError, TaichisoftError) as error:
            why = error.strerror if isinstance(error, OSError) and error.strerror else error
            warn_caller(
                f"the mesh cannot be kept in {path.parent} ({why}) and is made again every time; "
                f"{FOLDER_VARIABLE} can name another folder"
            )
    with tempfile.TemporaryDirectory() as folder:
        return _through_file(mesh, Path(folder) / "mesh.msh")


def _through_file(mesh: "VolumeMesh", path: Path) -> "VolumeMesh":
    from taichisoft.mesh import read_volume_mesh, write_volume_mesh

    write_volume_mesh(mesh, path)
    return read_volume_mesh(path)


DIGITS = 16  # of the hash, in the file name of a kept mesh


def mesh_for_scene(
    file: Path,
    size: float | None = None,
    preset: str | None = None,
    nodes: int | None = None,
    order: int | None = None,
    set: Mapping[str, Any] | None = None,
) -> VolumeMesh:
    """The mesh for a scene; the same request gives the same mesh, whether it is made now or was made before.

    Args:
        file: the geometry file.
        size: length of the largest element [mm].
        preset: name of one of the geometry's sizes.
        nodes: approximate number of nodes.
        order: 1 or 2, instead of the geometry's `mesh.order`.
        set: tables that replace the file's, key by key.
    """
    kind, tables = read_tables(file)
    possible = {"size": size, "preset": preset, "nodes": nodes}
    request: dict[str, Any] = {key: value for key, value in possible.items() if value is not None}
    wish = "".join(f", {key} {value}" for key, value in request.items())
    tables = merge_tables(tables, set or {})
    if order is not None:
        tables = merge_tables(tables, {"mesh": {"order": order}})
    job = MeshJob(kind, tables, file, request)
    path = _cache_path(job)
    mesh = kept_mesh(path)
    if mesh is not None:
        LOGGER.info("mesh of %s%s: %d nodes, made before (%s)", file, wish, len(mesh.nodes), path)
    else:
        LOGGER.info("meshing %s%s", file, wish)
        start = time.perf_counter()
        made = make_mesh_apart(job)
        require_fit(made, "other limits in its [quality]")
        for remark in made.remarks:
            warn_caller(f"mesh of {file}: {remark}")
        mesh = keep_mesh(made.mesh, path)
        LOGGER.info("meshed %s%s: %d nodes in %.1f s", file, wish, len(mesh.nodes), time.perf_counter() - start)
    return replace(mesh, source=str(file))


def merge_tables(tables: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """The tables with all values of `changes` in their places, in tables within tables, too."""
    merged = dict(tables)
    for key, value in changes.items():
        below = merged.get(key)
        merged[key] = merge_tables(below, value) if isinstance(below, Mapping) and isinstance(value, Mapping) else value
    return merged


def _cache_path(job: MeshJob) -> Path | None:
    """The path of the kept mesh; None, with a warning, when its inputs cannot all be read."""
    try:
        return cache_folder() / f"{job.file.stem}-{job.fingerprint()[:DIGITS]}.msh"
    except OSError as error:
        warn_caller(f"{job.file}: the mesh is made again every time: {error}")
        return None
