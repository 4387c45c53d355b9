"""The tables that bodies from files share: their base, the sizes of their elements, and how gmsh is told of these."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from taichisoft.base import SIZE, likely_unit
from taichisoft.errors import MeshError
from taichisoft.mesh import VolumeMesh, boundary_triangles
from taichisoft.running import Geometry
from taichisoft.scene import NotNegative, Positive, Table, Vector
from taichisoft_meshing.closed_shells import (
    NEAR,
    Shell,
    angles_between,
    area_vectors,
    diagonal,
    joined_sides,
    undirected_sides,
)
from taichisoft_meshing.gmsh_session import obey_size_fields, tetrahedra
from taichisoft_meshing.wall_quality import edge_lengths, find_walls

Count = Annotated[int, Field(strict=True, ge=0)]

PRESETS = {"coarse": 12.0, "medium": 24.0, "fine": 48.0}
"""Diagonal of the body over the element size [-]; the tutorial's finger has 600, 2000 and 6000 nodes."""


class BasePlane(Table):
    """The triangles of the outer surface in a plane, by which a gripper holds the body."""

    point: Vector
    """A point anywhere in the plane [mm]."""
    normal: Vector
    """Normal of the plane, of any length [-]."""

    @model_validator(mode="after")
    def _check_normal(self) -> "BasePlane":
        if not any(self.normal):
            raise ValueError("normal = [0, 0, 0]: has no direction")
        return self

    def select(self, nodes: np.ndarray, triangles: np.ndarray) -> np.ndarray:
        """Whether each triangle belongs to the base, shape (triangle_count,); nodes in [mm].

        Raises:
            ValueError: no triangle belongs to it.
        """
        heights = (nodes - np.array(self.point)) @ (np.array(self.normal) / np.linalg.norm(self.normal))
        chosen: np.ndarray = (np.abs(heights) <= NEAR * diagonal(nodes))[triangles].all(axis=1)
        if not chosen.any():
            lower, upper = np.round(nodes.min(axis=0), 3).tolist(), np.round(nodes.max(axis=0), 3).tolist()
            raise ValueError(
                f"base: no triangle of the outer surface lies in this plane; it spans {lower} to {upper} mm"
            )
        return chosen


def with_base(mesh: VolumeMesh, base: BasePlane | Sequence[BasePlane] | None) -> VolumeMesh:
    """The mesh with the part of its outside in one or several planes as the group "base"; unchanged without a plane.

    Raises:
        MeshError: no triangle lies in one of the planes.
    """
    planes = [base] if isinstance(base, BasePlane) else list(base or ())
    if not planes:
        return mesh
    outer = mesh.surface_groups["outer"]
    try:
        chosen = outer[np.any([plane.select(mesh.nodes, outer) for plane in planes], axis=0)]
    except ValueError as error:
        raise MeshError(f"{mesh.source}: {error}") from error
    return replace(mesh, surface_groups={**mesh.surface_groups, "base": chosen})


@dataclass(frozen=True)
class FittedSizes:
    """Sizes of the tetrahedra in a certain body; the attributes of `Sizes`, all of them known."""

    largest: float
    smallest: float
    curvature: int
    elements_across_walls: int = 2


class Sizes(Table):
    """Sizes of the tetrahedra."""

    largest: Positive | None = None
    """Edge length far from the cavities [mm]; a twelfth of the body's diagonal when it is not given."""
    smallest: Positive | None = None
    """Edge length at the cavities [mm]; the largest when it is not given."""
    curvature: Count = 16
    """Number of edges around a full turn of a curved surface; 0: no finer where it is curved."""
    elements_across_walls: Literal[1, 2] = 2
    """Least number of elements; 2 cuts the edges that lead through a wall, which about doubles the nodes."""

    @model_validator(mode="after")
    def _check_sizes(self) -> "Sizes":
        if self.largest is not None and self.smallest is not None and self.smallest > self.largest:
            raise ValueError(f"smallest = {self.smallest:g}: must be at most largest, {self.largest:g}")
        if self.largest is None and self.smallest is not None:
            raise ValueError(f"smallest = {self.smallest:g}: needs largest beside it")
        return self

    def fitted(
        self, extent: np.ndarray, volume: float, size: float | None = None, cavity_volumes: Sequence[float] = ()
    ) -> FittedSizes:
        """The sizes for a body.

        Args:
            extent: edge lengths of the box around the body along x, y and z [mm], shape (3,).
            volume: volume of the silicone [mm^3].
            size: largest size, instead of the table's; scales the smallest with it [mm].
            cavity_volumes: volumes of the cavities, where they are known [mm^3].
        """
        largest = size or self.largest or preset_sizes(extent)["coarse"]
        if not largest <= extent.max():
            meant = likely_unit(extent.max(), SIZE) if extent.max() < SIZE.lowest else ""
            raise ValueError(
                f"size {largest:g}: is larger than the body; must be at most {extent.max():.4g} mm"
                f"{f'; is the body in another unit? {meant}' if meant else ''}"
            )
        smallest = largest * (self.smallest / self.largest if self.smallest and self.largest else 1.0)
        refuse_sizes(largest, smallest, volume, cavity_volumes, ("size", "smallest"))
        return FittedSizes(largest, smallest, self.curvature, self.elements_across_walls)


class SolidSizes(Sizes):
    """Sizes of the tetrahedra in a solid, whose surfaces are known between the nodes, and how they follow them."""

    wall_ratio: NotNegative = 0.0
    """Longest edge in a wall over the wall's thickness [-], so that thin walls get finer elements than the rest, with
    sizes that grow away from them; 0: walls are as coarse as what is around them."""

    order: Literal[1, 2] = 1
    """1: tetrahedra of four nodes; 2: of ten, whose sides follow curved surfaces, for `element = "quadratic"`."""


def preset_sizes(extent: np.ndarray) -> dict[str, float]:
    """Largest element size [mm] of each preset, for a body of an extent along x, y and z [mm]."""
    return {name: float(f"{np.linalg.norm(extent) / parts:.3g}") for name, parts in PRESETS.items()}


WITHIN = 0.15
"""Largest allowed error of the number of nodes, as a share of the number asked for [-]."""

NEAR_ENOUGH = 0.05
"""Error at which the search ends, as a share of the number asked for [-]."""

MOST_MESHES = 8
"""Number of meshes after which a search ends."""

DIMENSION = 2.4
"""Nodes go like size ** -DIMENSION: between a surface (2) and a volume (3)."""

FARTHEST = 4.0
"""Largest ratio of the next size to one that was tried, beyond which the estimate is worth nothing [-]."""

GROWTH = 0.5
"""Growth of the element size with the distance from the cavities [-]."""

MOST_ELEMENTS = 5_000_000
"""More elements than any machine meshes and simulates in a sensible time."""

MOST_NODES = 1_000_000
"""Nodes of so many elements of four nodes, which are some five times as many."""


def element_count(volume: float, largest: float, smallest: float, cavity_volumes: Sequence[float] = ()) -> float:
    """An estimate of the number of tetrahedra in a body, from below.

    Elements of the smallest size lie at the cavities, of which each has no less surface than a ball of its volume, and
    grow away from it by GROWTH: the integral of A / size^3 over the distance is A / (2 GROWTH smallest^2).

    Args:
        volume: volume of the silicone [mm^3].
        largest, smallest: sizes of elements [mm].
        cavity_volumes: volumes of the cavities [mm^3].
    """
    far = 8.5 * volume / largest**3
    if not smallest < largest:
        return far
    area = sum((36.0 * math.pi) ** (1 / 3) * cavity ** (2 / 3) for cavity in cavity_volumes)
    return far + 8.5 * area * (1.0 / smallest**2 - 1.0 / largest**2) / (2.0 * GROWTH)


def refuse_too_many(count: float, key: str, size: float, power: int = 3) -> None:
    """Raise ValueError where a mesh would have more than MOST_ELEMENTS elements, because of a size [mm].

    Args:
        count: estimate of their number, which goes like size ** -power.
        key: key of the size.
        size: length of elements [mm].
        power: 3 for elements that fill a body, 2 for elements at surfaces.
    """
    if count > MOST_ELEMENTS:
        least = size * (count / MOST_ELEMENTS) ** (1 / power)
        raise ValueError(
            f"{key} = {size:g}: must be at least {least:.2g} mm; it would make about {count:.0e} elements, and "
            f"{MOST_ELEMENTS:.0e} are the most"
        )


def refuse_sizes(
    largest: float,
    smallest: float,
    volume: float,
    cavity_volumes: Sequence[float] = (),
    keys: tuple[str, str] = ("mesh.largest", "mesh.smallest"),
) -> None:
    """Raise ValueError, which names a key, where sizes [mm] give too many elements in volumes [mm^3]."""
    refuse_too_many(element_count(volume, largest, largest), keys[0], largest)
    refuse_too_many(element_count(volume, largest, smallest, cavity_volumes), keys[1], smallest, power=2)


def refuse_nodes(nodes: int, key: str) -> None:
    """Raise MeshError, which begins with `key`, for fewer nodes than a tetrahedron has or more than MOST_NODES."""
    if not 4 <= nodes <= MOST_NODES:
        raise MeshError(f"{key}: must lie between 4, a single tetrahedron, and {MOST_NODES}")


def size_for_nodes(geometry: Geometry, nodes: int) -> tuple[float, VolumeMesh]:
    """Search for the size whose mesh has a number of nodes, within 15 %.

    The number does not depend smoothly on the size, so the best of a few meshes is taken; the same description and
    number give the same mesh.

    Returns:
        The size [mm], and the mesh.
    """
    refuse_nodes(nodes, f"nodes = {nodes}")
    counts: dict[float, float] = {}  # 0 where the size is too large for the body, infinite where it is too small
    meshes: dict[float, VolumeMesh] = {}
    refusals: list[MeshError] = []
    size: float | None = _first_size(geometry)
    while size is not None and len(counts) < MOST_MESHES:
        try:
            meshes[size] = geometry.mesh(size).check()
            counts[size] = len(meshes[size].nodes)
            if abs(counts[size] / nodes - 1) <= NEAR_ENOUGH:
                break
        except MeshError as error:
            refusals.append(error)
            counts[size] = math.inf if meshes and size < min(meshes) else 0
        size = _next_size(counts, nodes)
    if not meshes:
        raise refusals[0]
    best = min(meshes, key=lambda size: abs(counts[size] / nodes - 1))
    if abs(counts[best] / nodes - 1) > WITHIN:
        why = "".join(f"; {error}" for error in refusals[-1:])
        raise MeshError(
            f"nodes = {nodes}: no size was found that gives as many within {WITHIN:.0%}; the nearest mesh has "
            f"{len(meshes[best].nodes)}, with largest elements of {best:.4g} mm{why}"
        )
    return best, meshes[best]


def _first_size(geometry: Geometry) -> float:
    """A size that the geometry names, or a guess from the mesh of its own size [mm]."""
    presets = geometry.presets
    if presets:
        return max(presets.values())
    mesh = geometry.mesh(None)
    return float(edge_lengths(mesh.nodes, mesh.elements).max())


def _next_size(counts: Mapping[float, float], target: int) -> float | None:
    """The size to try next [mm], from the numbers of nodes by size; None between two nearly equal sizes."""
    few = min((size for size, count in counts.items() if count <= target), default=None)
    many = max((size for size, count in counts.items() if count > target), default=None)
    if few is None or many is None:
        known = few or many or 0.0
        step = (counts[known] / target) ** (1 / DIMENSION)
        return known * min(max(step, 1 / FARTHEST), FARTHEST)
    if few <= many * 1.001:  # also where more nodes came with a larger size
        return None
    if counts[few] == 0 or counts[many] == math.inf:
        return math.sqrt(few * many)
    part = math.log(counts[many] / target) / math.log(counts[many] / counts[few])
    return many * (few / many) ** min(max(part, 0.1), 0.9)


FINEST = 0.25
"""Least size on curves, such as that of a tiny fillet, over the smallest size that was asked for [-]."""
USUAL = 16
"""Edges around a full turn; where more are asked for, the least size is smaller in proportion."""

SAMPLES = 20  # points along each curve and surface, to which distances are measured


def set_sizes(gmsh: Any, sizes: FittedSizes, cavity_surfaces: Sequence[int]) -> None:
    """Tell gmsh the sizes; `cavity_surfaces` are gmsh's numbers of the surfaces of the cavities."""
    largest, smallest = sizes.largest, sizes.smallest
    gmsh.option.setNumber("Mesh.MeshSizeMax", largest)
    gmsh.option.setNumber("Mesh.MeshSizeMin", _finest(sizes))
    gmsh.option.setNumber("Mesh.MeshSizeFromPoints", 0)
    gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", sizes.curvature)
    if smallest < largest and cavity_surfaces:
        field = gmsh.model.mesh.field
        distance, growing = field.add("Distance"), field.add("Threshold")
        field.setNumbers(distance, "SurfacesList", list(cavity_surfaces))
        field.setNumber(distance, "Sampling", SAMPLES)
        field.setNumber(growing, "InField", distance)
        for option, value in (
            ("SizeMin", smallest),
            ("SizeMax", largest),
            ("DistMin", 0.0),
            ("DistMax", (largest - smallest) / GROWTH),
        ):
            field.setNumber(growing, option, value)
        obey_size_fields(gmsh)


def add_box_of_size(
    gmsh: Any, lower: Iterable[float], upper: Iterable[float], inside: float, outside: float, sharp: bool = False
) -> None:
    """Add a field: a size in a box between two corners, from which sizes grow, or jump, to that outside [mm]."""
    field = gmsh.model.mesh.field
    tag = field.add("Box")
    options = {"VIn": inside, "VOut": outside, "Thickness": 0.0 if sharp else (outside - inside) / GROWTH}
    for axis, low, high in zip("XYZ", lower, upper, strict=True):
        options |= {f"{axis}Min": low, f"{axis}Max": high}
    for option, value in options.items():
        field.setNumber(tag, option, value)


def follow_curvature(gmsh: Any, sizes: FittedSizes, shells: Sequence[Shell], feature_angle: float) -> None:
    """Set smaller sizes where given triangles are curved, in place of gmsh's own: it finds unrolled flat ones curved.

    Args:
        gmsh: the module, after `set_sizes`.
        sizes: sizes of its elements.
        shells: the given triangles; none when all of them are flat.
        feature_angle: angle between two triangles above which their edge is sharp, not part of a curved surface [rad].
    """
    gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", 0)
    if sizes.curvature == 0 or not shells:
        return
    rows = []
    for shell in shells:
        curvatures = vertex_curvatures(shell.vertices, shell.triangles, feature_angle)
        with np.errstate(divide="ignore"):
            wanted = np.minimum(2 * math.pi / (sizes.curvature * curvatures), sizes.largest)
        rows.append(_size_rows(wanted, shell.vertices, shell.triangles))
    _add_sizes(gmsh, np.vstack(rows))


def follow_walls(gmsh: Any, sizes: FittedSizes, ratio: float, source: str) -> None:
    """Clear the mesh of a session, and set sizes in proportion to the thickness of the walls that were found in it.

    Args:
        gmsh: the module, after `set_sizes`, with a mesh.
        sizes: sizes of its elements.
        ratio: longest edge in a wall over the wall's thickness [-].
        source: begins every error.
    """
    nodes, elements, _ = tetrahedra(gmsh)
    rows = wall_sizes(nodes, elements, sizes, ratio, source)
    gmsh.model.mesh.clear()
    obey_wall_sizes(gmsh, sizes, rows)


def wall_sizes(
    nodes: np.ndarray, elements: np.ndarray, sizes: FittedSizes, ratio: float, source: str, least: float = 0.0
) -> np.ndarray:
    """Sizes for `obey_wall_sizes`, in proportion to the thickness of the walls of a mesh, none below the least [mm]."""
    walls = find_walls(nodes, elements)
    size = np.clip(ratio * walls.thickness, least, sizes.largest)
    wanted = np.full(len(nodes), sizes.largest)
    np.minimum.at(wanted, walls.triangles, size[:, None])
    count = float((8.5 * walls.areas * walls.thickness / 2 / size**3).sum())  # a wall is seen from both sides
    try:
        refuse_too_many(count, "mesh.wall_ratio", ratio)
    except ValueError as error:
        raise MeshError(f"{source}: {error}") from error
    return _size_rows(wanted, nodes, boundary_triangles(elements))


def obey_wall_sizes(gmsh: Any, sizes: FittedSizes, rows: np.ndarray) -> None:
    """Set sizes in walls, the result of `wall_sizes`; gmsh's least size is lowered to the least of them."""
    gmsh.option.setNumber("Mesh.MeshSizeMin", min(_finest(sizes), rows[:, 9:].min()))
    _add_sizes(gmsh, rows)


def _finest(sizes: FittedSizes) -> float:
    return FINEST * sizes.smallest * min(1.0, USUAL / max(1, sizes.curvature))


def _add_sizes(gmsh: Any, rows: np.ndarray) -> None:
    """Add a field of sizes on triangles, from the result of `_size_rows`."""
    view = gmsh.view.add("sizes")
    gmsh.view.addListData(view, "ST", len(rows), rows.ravel())  # a second call would replace it
    field = gmsh.model.mesh.field
    curved = field.add("PostView")
    field.setNumber(curved, "ViewTag", view)
    field.setNumber(curved, "UseClosest", 0)
    obey_size_fields(gmsh)


def _size_rows(sizes: np.ndarray, vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Corners of triangles and sizes there [mm], which grow slowly from the smallest, as gmsh takes them."""
    grown = _growing(sizes, vertices, triangles)[triangles]
    return np.concatenate([vertices[triangles].transpose(0, 2, 1).reshape(-1, 9), grown], axis=1)


def _growing(sizes: np.ndarray, vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """The sizes at the vertices [mm], lowered until none is larger than the size and distance of a neighbour allow."""
    ends = np.unique(undirected_sides(triangles), axis=0)
    ends = np.vstack([ends, ends[:, ::-1]])
    reach = GROWTH * np.linalg.norm(np.subtract(*vertices[ends.T]), axis=1)
    sizes = sizes.copy()
    while True:
        allowed = sizes[ends[:, 0]] + reach
        if (allowed >= sizes[ends[:, 1]] * (1 - 1e-9)).all():
            return sizes
        np.minimum.at(sizes, ends[:, 1], allowed)


def vertex_curvatures(vertices: np.ndarray, triangles: np.ndarray, feature_angle: float) -> np.ndarray:
    """The larger principal curvature near each vertex [1/mm], shape (vertex_count,); sharp edges do not count.

    Every edge gives the angle across it times its length, in its direction: a tensor. Over the area around a vertex its
    eigenvalues are the principal curvatures (Cohen-Steiner and Morvan 2003).

    Args:
        vertices: positions [mm], shape (vertex_count, 3).
        triangles: vertex indices of a closed surface, shape (triangle_count, 3).
        feature_angle: angle between two triangles above which their edge is sharp [rad].
    """
    normals = area_vectors(vertices[triangles])
    edges, sides = joined_sides(triangles)
    angles = angles_between(normals, sides // 3)
    along = np.subtract(*vertices[edges.T])
    lengths = np.linalg.norm(along, axis=1)
    bent = np.where(angles < feature_angle, angles, 0.0) / lengths
    tensors = np.zeros((len(vertices), 3, 3))
    for end in edges.T:  # half of the angle to either
        np.add.at(tensors, end, 0.5 * np.einsum("e,ei,ej->eij", bent, along, along))
    areas = np.linalg.norm(normals, axis=1) / 6  # a third to each corner
    around = np.bincount(triangles.ravel(), np.repeat(areas, 3), len(vertices))
    largest: np.ndarray = np.linalg.eigvalsh(tensors)[:, -1]
    return largest / around
