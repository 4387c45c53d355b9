"""The element size for a number of nodes, and an estimate of the number of elements for a size."""

import math
from collections.abc import Mapping, Sequence

from taichisoft.errors import MeshError
from taichisoft.mesh import VolumeMesh
from taichisoft.running import Geometry
from taichisoft_meshing.wall_quality import edge_lengths

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
