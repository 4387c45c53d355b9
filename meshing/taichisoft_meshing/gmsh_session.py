"""gmsh for one mesh: silent, the same every time, closed again whatever happens; and the mesh that it gives."""

import ctypes
import os
import re
import signal
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np

from taichisoft.base import require, warn_caller
from taichisoft.errors import MeshError
from taichisoft.mesh import (
    SIDES,
    VolumeMesh,
    boundary_triangles,
    cavity_names,
    element_volumes,
    enclosed_volume,
    least_volumes,
    tetrahedron_volumes,
    with_middle_nodes,
)
from taichisoft_meshing.closed_shells import find_crossings, undirected_sides

Way = TypeVar("Way")
Made = TypeVar("Made")

TRIANGLE, TETRAHEDRON = 2, 4  # gmsh's numbers for the linear ones

FRONTAL, MESH_ADAPT, DELAUNAY = 6, 1, 5
SURFACE_ALGORITHMS = (FRONTAL, MESH_ADAPT, DELAUNAY)
"""gmsh's numbers: the first gives the best triangles, the others fail less on surfaces that are hard to unroll."""


class GmshFailure(Exception):
    """gmsh gave a wrong result without an error of its own; raised inside a session, this becomes a MeshError."""


@contextmanager
def gmsh_session(body: str) -> Iterator[Any]:
    """The module gmsh, initialised to use its own optimiser and Netgen's; its whole state ends with the session.

    gmsh runs on one thread, because several threads number the nodes in a random order, and reads no configuration of
    the user: the same calls give the same mesh, node for node. Its messages are kept in a file only if it fails.

    Args:
        body: name of what is meshed in errors, for example "this finger" or "body.step".
    """
    require("meshing", "gmsh")
    try:
        import gmsh
    except (ImportError, OSError) as error:
        raise MeshError(
            f"gmsh cannot be loaded ({_one_line(error)}); `taichisoft doctor` says which system libraries to install"
        ) from error
    if gmsh.isInitialized():
        raise MeshError(f"gmsh is already in use in this process; finalize it before meshing {body}")
    # Not interruptible: gmsh would take over the signal handlers, and can only do so in the main thread.
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    _keep_broken_pipes_an_error()
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("General.NumThreads", 1)
        gmsh.option.setNumber("Mesh.Optimize", 1)
        gmsh.option.setNumber("Mesh.OptimizeNetgen", 1)
        gmsh.logger.start()
        yield gmsh
    except Exception as error:
        if type(error) not in (Exception, GmshFailure):  # gmsh raises plain Exception; others are not its own
            raise
        place = _place_of_surfaces(gmsh, str(error))
        raise MeshError(f"gmsh cannot mesh {body}: {_one_line(error)}{place}; {_kept_log(gmsh)}") from error
    finally:
        gmsh.finalize()


def successes(body: str, ways: Sequence[Way], make: Callable[[Any, Way], Made]) -> Iterator[Made]:
    """Make something in several ways, each in a session of its own, and give what comes out of those that do not fail.

    Args:
        body: name of what is meshed in errors.
        ways: ways to make it, in the order in which they are tried.
        make: called with gmsh and a way.

    Raises:
        MeshError: every way failed; the error is that of the last.
    """
    made = False
    for number, way in enumerate(ways, 1):
        result = None
        with gmsh_session(body) as gmsh:  # each its own: gmsh does nothing more after it has failed
            try:
                result = make(gmsh, way)
            except Exception as error:
                expected = type(error) in (Exception, GmshFailure, MeshError)
                if not expected or (number == len(ways) and not made):
                    raise
        if result is not None:
            made = True
            yield result


def tetrahedra(gmsh: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nodes in use and tetrahedra of the session's mesh, which gmsh makes positive.

    Returns:
        Node positions [mm], shape (node_count, 3); elements, shape (element_count, 4); gmsh's number of each node,
        in ascending order.
    """
    corner_tags = gmsh.model.mesh.getElementsByType(TETRAHEDRON)[1]
    if len(corner_tags) == 0:
        raise GmshFailure("no tetrahedra came out")
    nodes, corners, used = numbered(gmsh.model.mesh, corner_tags)
    return nodes, corners.reshape(-1, 4).astype(np.int32), used


def numbered(mesh: Any, corner_tags: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The nodes of `gmsh.model.mesh` that are corners, the corners as indices of them, and gmsh's number of each."""
    tags, coordinates, _ = mesh.getNodes()
    order = np.argsort(tags)
    used, corners = np.unique(corner_tags, return_inverse=True)
    return coordinates.reshape(-1, 3)[order[np.searchsorted(tags[order], used)]], corners, used


def obey_size_fields(gmsh: Any) -> None:
    """Let the smallest of all size fields made so far decide everywhere; a distance is not a size."""
    field = gmsh.model.mesh.field
    smallest = field.add("Min")
    field.setNumbers(smallest, "FieldsList", [tag for tag in field.list() if field.getType(tag) != "Distance"])
    field.setAsBackgroundMesh(smallest)


def gmsh_version() -> str:
    """The version of gmsh that is installed, found without loading it."""
    try:
        return version("gmsh")
    except PackageNotFoundError:  # installed by other means than pip
        return "unknown"


def _keep_broken_pipes_an_error() -> None:
    """Undo a side effect of gmsh's start, after which the signal of a broken pipe would end the process.

    Python ignores that signal and raises BrokenPipeError instead; in threads it cannot set it itself.
    """
    if hasattr(signal, "SIGPIPE") and signal.getsignal(signal.SIGPIPE) is signal.SIG_IGN:
        ctypes.CDLL(None).signal(int(signal.SIGPIPE), ctypes.c_void_p(int(signal.SIG_IGN)))


def _kept_log(gmsh: Any) -> str:
    """Write gmsh's messages to a file that stays, and say where it is."""
    lines = "\n".join(gmsh.logger.get())
    try:
        handle, name = tempfile.mkstemp(prefix="taichisoft-gmsh-", suffix=".log")
        os.close(handle)
        Path(name).write_text(lines + "\n", encoding="utf-8")
    except OSError as error:
        return f"gmsh's log cannot be written: {error.strerror or error}"
    return f"gmsh's log is {name}"


def _place_of_surfaces(gmsh: Any, message: str) -> str:
    """Where the meshed surfaces cross, or the boxes meet of those that a message of gmsh numbers, in words, or ""."""
    remedy = "; a smaller size, or defeature, may help"
    corner_tags = gmsh.model.mesh.getElementsByType(TRIANGLE)[1]
    if len(corner_tags):
        nodes, corners, _ = numbered(gmsh.model.mesh, corner_tags)
        triangles = corners.reshape(-1, 3)
        if (np.unique(undirected_sides(triangles), axis=0, return_counts=True)[1] == 2).all():
            places = find_crossings(nodes, triangles, np.zeros(len(triangles), dtype=int)).places
            if len(places):
                return f", where surfaces cross at {np.round(places[0], 2).tolist()} mm{remedy}"
    tags = [int(tag) for tag in re.findall(r"\bsurface (\d+)", message)]
    if not tags:
        return ""
    boxes = np.reshape([gmsh.model.getBoundingBox(2, tag) for tag in tags], (-1, 2, 3))
    middle = (boxes[:, 0].max(axis=0) + boxes[:, 1].min(axis=0)) / 2
    return f", near {np.round(middle, 2).tolist()} mm{remedy}"


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())


# Ten-node tetrahedra whose sides follow the curved surfaces of the geometry.

SIX_NODES, TEN_NODES = 9, 11  # gmsh's numbers for triangles and tetrahedra with nodes in the middles of their sides

LEAST = 0.1
"""Least part of its volume with straight sides that an element may have anywhere, see `least_volumes` [-]."""


@dataclass(frozen=True)
class CurvedSides:
    """The middles of the sides on the surfaces of the geometry.

    Attributes:
        ends: node indices of the corners of each side, the lower first, shape (side_count, 2).
        middles: points of the surfaces [mm], shape (side_count, 3).
    """

    ends: np.ndarray
    middles: np.ndarray


def curved_sides(gmsh: Any, nodes: np.ndarray, elements: np.ndarray) -> CurvedSides:
    """Let gmsh put nodes into the middles of all sides, where they lie on its geometry; its mesh is of order 2 then.

    gmsh gives all nodes other numbers, but keeps the order of the tetrahedra and of their corners.

    Args:
        gmsh: the module, with a mesh of linear tetrahedra.
        nodes, elements: that mesh, as `tetrahedra` gave it: [mm], shape (node_count, 3), and (element_count, 4).
    """
    mesh = gmsh.model.mesh
    mesh.setOrder(2)
    tags, coordinates, _ = mesh.getNodes()
    order = np.argsort(tags)
    positions = coordinates.reshape(-1, 3)[order]
    triangles, tetrahedra = (
        np.searchsorted(tags[order], mesh.getElementsByType(kind)[1]).reshape(-1, count)
        for kind, count in ((SIX_NODES, 6), (TEN_NODES, 10))
    )
    if len(tetrahedra) != len(elements) or (positions[tetrahedra[:, :4]] != nodes[elements]).any():
        raise GmshFailure("the second order of elements has other corners than the first")
    corner = np.full(len(tags), -1)
    corner[tetrahedra[:, :4]] = elements
    ends = np.sort(corner[triangles[:, [[0, 1], [1, 2], [0, 2]]]].reshape(-1, 2), axis=1)
    ends, first = np.unique(ends, axis=0, return_index=True)
    return CurvedSides(ends, positions[triangles[:, 3:].ravel()[first]])


def with_curved_sides(mesh: VolumeMesh, sides: CurvedSides) -> VolumeMesh:
    """The mesh with ten-node tetrahedra, as `curve_sides` gives it; a warning says how many sides stay straight."""
    curved, straight_count = curve_sides(mesh, sides)
    if straight_count:
        warn_caller(
            f"{mesh.source}: {straight_count} sides stay straight where curved ones would turn elements over; "
            "mesh more finely there"
        )
    return curved


def curve_sides(mesh: VolumeMesh, sides: CurvedSides) -> tuple[VolumeMesh, int]:
    """Ten-node tetrahedra, the middles of whose sides lie on the surfaces where these are curved.

    The sides of an element stay straight that would else be turned over, or nearly so.

    Args:
        mesh: of linear tetrahedra; their sides on the surfaces are the sides in `sides`.
        sides: from `curved_sides`.

    Returns:
        The mesh, and how many sides stay straight though the surface is not.
    """
    straight = with_middle_nodes(mesh)
    numbers = np.array([len(mesh.nodes), 1])
    keys, first = np.unique(np.sort(straight.elements[:, SIDES], axis=2).astype(np.int64) @ numbers, return_index=True)
    middle_of = straight.elements[:, 4:].ravel()[first]
    moved = middle_of[np.searchsorted(keys, sides.ends.astype(np.int64) @ numbers)]
    nodes = straight.nodes.copy()
    nodes[moved] = sides.middles
    least = LEAST * tetrahedron_volumes(mesh.nodes, mesh.elements)
    straightened = np.zeros(len(nodes), dtype=bool)
    # It ends: an element whose sides are all straight has its whole volume everywhere.
    while (turned := least_volumes(nodes, straight.elements) < least).any():
        middles = np.unique(straight.elements[turned, 4:])
        straightened[middles] |= (nodes[middles] != straight.nodes[middles]).any(axis=1)
        nodes[middles] = straight.nodes[middles]
    return replace(straight, nodes=nodes), int(straightened.sum())


SAID, REFUSED = 0.1, 0.25
"""Errors of a curved volume as shares of it [-], at which a warning is given, and at which the mesh is refused: flat
triangles cut some of it off."""

SILICONE = "silicone"
"""Name of the group of all elements."""
NO_GROUPS: Mapping[str, Any] = MappingProxyType({})


def meshed_body(
    gmsh: Any,
    shells: Sequence[Sequence[int]],
    source: str,
    parts: Mapping[str, int] = NO_GROUPS,
    faces: Mapping[str, Sequence[int]] = NO_GROUPS,
) -> VolumeMesh:
    """The tetrahedra of a session, with the groups "silicone", "outer" and one for each cavity.

    Args:
        gmsh: the module, with a mesh.
        shells: gmsh's numbers of the surfaces of the outside, then of each cavity.
        source: begins every error.
        parts: further element groups, and gmsh's number of the volume of each.
        faces: further surface groups, and gmsh's numbers of the surfaces of each; those inside the body face any way.

    Raises:
        GmshFailure: there are no tetrahedra, or they do not end at these surfaces.
    """
    nodes, elements, used = tetrahedra(gmsh)
    surfaces = _surfaces(elements, [_triangles(gmsh.model.mesh, shell, used) for shell in shells])
    names = ["outer", *cavity_names(len(shells) - 1)]
    groups = {"outer": surfaces[0]}
    # A boundary triangle faces out of the silicone; a cavity encloses a positive volume if it faces into it.
    groups |= {name: np.ascontiguousarray(wall[:, ::-1]) for name, wall in zip(names[1:], surfaces[1:], strict=True)}
    groups |= {name: _outward(elements, _triangles(gmsh.model.mesh, its, used)) for name, its in faces.items()}
    every = gmsh.model.mesh.getElementsByType(TETRAHEDRON)[0]
    element_groups = {SILICONE: np.arange(len(elements), dtype=np.int32)}
    for name, volume in parts.items():
        its = gmsh.model.mesh.getElementsByType(TETRAHEDRON, volume)[0]
        element_groups[name] = np.flatnonzero(np.isin(every, its)).astype(np.int32)
    return VolumeMesh(source, nodes, elements, groups, element_groups).check()


def shells_of_solid(occ: Any, solid: int) -> list[list[int]]:
    """Faces of the outside of a solid, then the faces of each void, in OpenCASCADE's order.

    Args:
        occ: `gmsh.model.occ`.
        solid: gmsh's number of the solid.

    Raises:
        GmshFailure: the solid has no surface.
    """
    shells = [faces.tolist() for faces in occ.getSurfaceLoops(solid)[1]]
    if not shells:
        raise GmshFailure("the body has no closed surface")
    outside = max(range(len(shells)), key=lambda number: _extent(occ, shells[number]))
    return [shells.pop(outside), *shells]


def compare_volumes(
    mesh: VolumeMesh,
    silicone: float,
    cavities: Sequence[float],
    tolerance: float | None,
    parts: Mapping[str, float] = NO_GROUPS,
) -> None:
    """Compare the volumes of a mesh with its body's [mm^3].

    Args:
        mesh: the result of `meshed_body`.
        silicone: volume of the body's silicone.
        cavities: volumes of the body's cavities, in their order.
        tolerance: share of each that may be missing [-]; None for curved surfaces, which flat triangles cut short.
        parts: volumes of the body's element groups.
    """
    volumes = element_volumes(mesh.nodes, mesh.elements)
    meshed = [float(volumes.sum()), *(float(volumes[mesh.element_groups[name]].sum()) for name in parts)]
    meshed += [enclosed_volume(mesh.nodes, mesh.surface_groups[name]) for name in cavity_names(len(cavities))]
    names = [SILICONE, *parts, *cavity_names(len(cavities))]
    drawn = [silicone, *parts.values(), *cavities]
    for refused in (True, False):  # all are looked at before any is only said
        for name, got, wanted in zip(names, meshed, drawn, strict=True):
            off = abs(got - wanted) / wanted
            amount = f"{got:.6g} mm^3 in the mesh instead of {wanted:.6g}, {100 * off:.2g} % off"
            what = f"{mesh.source}: {name} has {amount}"
            if refused and off > (REFUSED if tolerance is None else tolerance):
                raise MeshError(f"{what}; try another size")
            if not refused and tolerance is None and off > SAID:
                warn_caller(f"{what}: the curved surfaces are meshed coarsely")


def _triangles(gmsh_mesh: Any, surfaces: Sequence[int], used: np.ndarray) -> np.ndarray:
    """Triangles on some of gmsh's surfaces as node indices, shape (count, 3); `used` has gmsh's number of each node."""
    corners = np.concatenate([gmsh_mesh.getElementsByType(TRIANGLE, surface)[1] for surface in surfaces])
    at = np.searchsorted(used, corners)
    if len(corners) == 0 or (used[np.minimum(at, len(used) - 1)] != corners).any():
        raise GmshFailure("the tetrahedra do not reach a surface")
    return at.reshape(-1, 3)


def _surfaces(elements: np.ndarray, shells: Sequence[np.ndarray]) -> list[np.ndarray]:
    """The shells, turned to face out of the silicone; together they must be the boundary of the tetrahedra."""
    boundary = boundary_triangles(elements)
    together = _places(boundary, np.vstack(shells))
    if (together < 0).any() or len(together) != len(boundary):
        raise GmshFailure("the tetrahedra do not end at the surfaces")
    return np.split(boundary[together], np.cumsum([len(shell) for shell in shells])[:-1])


def _outward(elements: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """The triangles, those on the boundary turned to face out of the silicone."""
    boundary = boundary_triangles(elements)
    place = _places(boundary, triangles)
    return np.where(place[:, None] >= 0, boundary[place], triangles).astype(np.int32)


def _places(boundary: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """The row of the boundary that has the corners of each triangle, -1 where none has."""
    every = np.sort(np.vstack([boundary, triangles]), axis=1)
    number = np.unique(every, axis=0, return_inverse=True)[1].ravel()
    place = np.full(number.max() + 1, -1)
    place[number[: len(boundary)]] = np.arange(len(boundary))
    found: np.ndarray = place[number[len(boundary) :]]
    return found


def _extent(occ: Any, faces: list[int]) -> float:
    boxes = np.array([occ.getBoundingBox(2, face) for face in faces])
    return float(np.linalg.norm(boxes[:, 3:].max(axis=0) - boxes[:, :3].min(axis=0)))
