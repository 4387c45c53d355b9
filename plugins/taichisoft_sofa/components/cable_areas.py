"""Cables that pull at areas of a surface: `method` "sphere" and "geodesic" of a CableConstraint."""

from typing import TYPE_CHECKING, Any

import numpy as np
import trimesh
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from taichisoft_sofa.components.contact_components import surface_triangles
from taichisoft_sofa.components.graph import TOPOLOGIES, nearest, node_of
from taichisoft_sofa.components.typed_values import numbers, text

if TYPE_CHECKING:
    from taichisoft_sofa.components.draft import SceneDraft
    from taichisoft_sofa.tree.component import Component

METHODS = ("point", "sphere", "geodesic")


def list_areas(component: "Component", points: np.ndarray, draft: "SceneDraft") -> list[Any]:
    """The points and areas of a cable in the format of a native scene; empty if the component was refused.

    A vertex within the radius has the weight radius - distance, with the distance measured in space, or along
    the edges of the surface.

    Args:
        component: the cable.
        points: points of the mechanical object in the cable's node [mm], shape (count, 3).
        draft: draft of the scene, which records refusals and departures.
    """
    method, link = text(component, "method", default="point"), text(component, "surfaceTopology")
    topology = component.linked("surfaceTopology") if link else nearest(node_of(component), TOPOLOGIES)
    triangles = np.zeros((0, 3), dtype=np.int64) if topology is None else surface_triangles(topology)
    if not len(triangles) or triangles.max() >= len(points):
        draft.refuse(component, f"method '{method}' needs a surfaceTopology of the points of its node, with triangles")
        return []
    centres = numbers(component, "centers").reshape(-1, 3)
    if not len(centres):
        centres = points[numbers(component, "indices", default=[0.0]).astype(np.int64)]
    radii = numbers(component, "radii", default=[1.0])
    if len(radii) not in (1, len(centres)):
        draft.refuse(component, f"radii has {len(radii)} numbers for {len(centres)} places")
        return []
    draft.depart(
        f"{component.getPathName()}: its length is measured to the weighted means of its areas; in SOFA to one vertex "
        "of each, which is not what it pulls at"
    )
    along = _along_edges(points, triangles)
    surface, used = trimesh.Trimesh(points, triangles, process=False), np.unique(triangles)
    feet, _, under = trimesh.proximity.closest_point_naive(surface, centres)
    places: list[Any] = []
    for foot, triangle, radius in zip(feet, under, np.broadcast_to(radii, len(centres)), strict=True):
        distance = np.full(len(points), np.inf)
        if method == "sphere":
            distance[used] = np.linalg.norm(points[used] - foot, axis=1)
        else:
            corners = triangles[triangle]
            first = np.linalg.norm(points[corners] - foot, axis=1)
            distance = (first[:, None] + dijkstra(along, indices=corners, limit=float(radius))).min(axis=0)
        within = np.flatnonzero(distance < radius)
        if len(within):
            places.append({"area": points[within].tolist(), "weights": (radius - distance[within]).tolist()})
        else:
            places.append(foot.tolist())
    return places


def _along_edges(points: np.ndarray, triangles: np.ndarray) -> csr_matrix:
    """Lengths of the edges of a surface [mm], as a matrix."""
    edges = np.unique(np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)
    lengths = np.linalg.norm(points[edges[:, 1]] - points[edges[:, 0]], axis=1)
    both = np.vstack([edges, edges[:, ::-1]])
    return csr_matrix((np.tile(lengths, 2), both.T), shape=(len(points), len(points)))
