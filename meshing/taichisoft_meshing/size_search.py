"""The element size that gives a mesh of so many nodes."""

import math
from dataclasses import dataclass, field

from taichisoft.errors import MeshError
from taichisoft.meshes.volume_mesh import VolumeMesh
from taichisoft.plugin_system.geometry import Geometry
from taichisoft_meshing.quality.tetrahedra import edge_lengths

WITHIN = 0.15
"""Of the number of nodes asked for: how far off a mesh may be."""

NEAR_ENOUGH = 0.05
"""Of the number: the search goes no further."""

MOST_MESHES = 8
"""That a search makes."""

DIMENSION = 2.4
"""Nodes go like size ** -DIMENSION: between those of a surface (2) and of a volume (3)."""

FARTHEST = 4.0
"""Times a size that was tried: beyond, nothing is known of the next one."""


def size_for_nodes(geometry: Geometry, nodes: int) -> tuple[float, VolumeMesh]:
    """Search for the size whose mesh has the number of nodes asked for, within 15 %.

    The number is no smooth function of the size, so the best of a few meshes is taken; the same description and number
    give the same mesh.

    Returns:
        The size [mm], and the mesh.

    Raises:
        MeshError: no size that was tried gives so many nodes, or the body cannot be meshed.
    """
    if nodes < 4:
        raise MeshError(f"nodes = {nodes}: must be at least 4, those of one tetrahedron")
    search = _Search(nodes)
    size: float | None = _first_size(geometry)
    while size is not None and len(search.counts) < MOST_MESHES and search.miss > NEAR_ENOUGH:
        search.add(size, geometry)
        size = search.next_size()
    if search.best is None:
        raise search.refusals[0]
    if search.miss > WITHIN:
        why = "".join(f"; {error}" for error in search.refusals[-1:])
        raise MeshError(
            f"nodes = {nodes}: no size was found that gives as many within {WITHIN:.0%}; the nearest mesh has "
            f"{len(search.best.nodes)}, with largest elements of {search.best_size:.4g} mm{why}"
        )
    return search.best_size, search.best


def _first_size(geometry: Geometry) -> float:
    """One that the geometry names, or a guess from the mesh of its own size [mm]."""
    presets = geometry.presets
    if presets:
        return max(presets.values())
    mesh = geometry.mesh(None)
    return float(edge_lengths(mesh.nodes, mesh.elements).max())


@dataclass
class _Search:
    """What is known so far.

    Attributes:
        target: number of nodes wanted.
        counts: number of nodes by size [mm]; 0 where the size is too large for the body, infinite where too small.
        refusals: why sizes are.
        best: mesh with the number of nodes nearest to the target, and `best_size` [mm].
        miss: how far off its number is, of the target [-].
    """

    target: int
    counts: dict[float, float] = field(default_factory=dict)
    refusals: list[MeshError] = field(default_factory=list)
    best: VolumeMesh | None = None
    best_size: float = math.nan
    miss: float = math.inf

    def add(self, size: float, geometry: Geometry) -> None:
        """Mesh at a size."""
        try:
            mesh = geometry.mesh(size).check()
        except MeshError as error:
            self.refusals.append(error)
            meshed = [known for known, count in self.counts.items() if 0 < count < math.inf]
            self.counts[size] = math.inf if meshed and size < min(meshed) else 0
            return
        self.counts[size] = len(mesh.nodes)
        miss = abs(len(mesh.nodes) / self.target - 1)
        if miss < self.miss:
            self.best, self.best_size, self.miss = mesh, size, miss

    def next_size(self) -> float | None:
        """Where to look next [mm]; None between two nearly equal sizes."""
        few = min((size for size, count in self.counts.items() if count <= self.target), default=None)
        many = max((size for size, count in self.counts.items() if count > self.target), default=None)
        if few is None or many is None:
            known = few or many or 0.0
            step = (self.counts[known] / self.target) ** (1 / DIMENSION)
            return known * min(max(step, 1 / FARTHEST), FARTHEST)
        if few <= many * 1.001:  # also where more nodes came with a larger size
            return None
        if self.counts[few] == 0 or self.counts[many] == math.inf:
            return math.sqrt(few * many)
        part = math.log(self.counts[many] / self.target) / math.log(self.counts[many] / self.counts[few])
        return many * (few / many) ** min(max(part, 0.1), 0.9)
