"""Triangulated surfaces: those that move with nodes, and whether a surface is closed and which way it faces."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from taichisoft.caller_warnings import warn_caller
from taichisoft.errors import MeshError


@dataclass(frozen=True)
class MappedSurface:
    """A surface that moves with nodes: vertex = sum over k of weights[k] * node position[nodes[k]].

    A surface made of the mesh's own nodes has one node of weight 1 per vertex; one that does not match the
    mesh has the nodes of the element around each vertex and their barycentric weights.

    Attributes:
        nodes: node indices of the body, shape (vertex_count, nodes_per_vertex).
        weights: their weights [-], shape (vertex_count, nodes_per_vertex); each row sums to 1.
        triangles: vertex indices, outward by the right-hand rule, shape (triangle_count, 3).
    """

    nodes: np.ndarray
    weights: np.ndarray
    triangles: np.ndarray

    @classmethod
    def of_nodes(cls, triangles: np.ndarray) -> "MappedSurface":
        """The surface spanned by triangles of node indices, its vertices renumbered in node order."""
        nodes, vertices = np.unique(triangles, return_inverse=True)
        return cls(
            nodes.reshape(-1, 1).astype(np.int32),
            np.ones((len(nodes), 1)),
            vertices.reshape(-1, 3).astype(np.int32),
        )

    @classmethod
    def joined(cls, surfaces: Sequence["MappedSurface"]) -> "MappedSurface":
        """Surfaces whose vertices have as many nodes each, as one, in their order; a single one remains itself."""
        if len(surfaces) == 1:
            return surfaces[0]
        first_vertex = np.cumsum([0, *(len(surface.nodes) for surface in surfaces)])
        return cls(
            np.vstack([surface.nodes for surface in surfaces]),
            np.vstack([surface.weights for surface in surfaces]),
            np.vstack(
                [surface.triangles + first for surface, first in zip(surfaces, first_vertex[:-1], strict=True)]
            ).astype(np.int32),
        )

    def positions(self, node_positions: np.ndarray) -> np.ndarray:
        """Vertex positions [mm], shape (vertex_count, 3), for node positions of shape (node_count, 3)."""
        return np.einsum("vk,vkd->vd", self.weights, node_positions[self.nodes])


def stacked(tables: Sequence[np.ndarray]) -> np.ndarray:
    """Nodes or weights of several surfaces under each other; narrower tables are filled up with node 0 of weight 0."""
    columns = max((table.shape[1] for table in tables), default=1)
    padded = [np.pad(table, ((0, 0), (0, columns - table.shape[1]))) for table in tables]
    return np.concatenate([np.zeros((0, columns)), *padded])


def enclosed_volume(vertices: np.ndarray, triangles: np.ndarray) -> float:
    """Signed volume [mm^3] inside a closed surface, positive when it faces outward (divergence theorem)."""
    a, b, c = np.moveaxis(vertices[triangles] - vertices.mean(axis=0), 1, 0)
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def closed_outward(vertices: np.ndarray, triangles: np.ndarray, source: str) -> np.ndarray:
    """The triangles of a closed surface, turned round with a warning when it is inside out.

    Args:
        vertices: positions [mm], shape (vertex_count, 3).
        triangles: vertex indices, shape (triangle_count, 3).
        source: name of the surface, which begins the error and the warning.

    Raises:
        MeshError: the surface is not closed, or encloses no volume.
    """
    open_edges = count_open_edges(triangles)
    if open_edges:
        raise MeshError(
            f"{source}: is not closed: {open_edges} edges do not join exactly two triangles of one "
            "orientation; fill the holes and merge equal vertices"
        )
    volume = enclosed_volume(vertices, triangles)
    if volume == 0.0:
        raise MeshError(f"{source}: encloses no volume")
    if volume < 0.0:
        warn_caller(f"{source}: is inside out; its triangles are turned round")
        return np.ascontiguousarray(triangles[:, ::-1])
    return triangles


def count_open_edges(triangles: np.ndarray) -> int:
    """Number of directed edges that do not occur exactly once with exactly one opposite."""
    edges = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).astype(np.int64)
    size = int(triangles.max()) + 1 if len(triangles) else 1
    forward, counts = np.unique(edges @ [size, 1], return_counts=True)
    backward = edges @ [1, size]
    return int((counts != 1).sum() + (~np.isin(backward, forward)).sum())
