"""Triangulated surfaces whose vertices follow the nodes of a soft body."""

from dataclasses import dataclass

import numpy as np


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

    def positions(self, node_positions: np.ndarray) -> np.ndarray:
        """Vertex positions [mm], shape (vertex_count, 3), for node positions of shape (node_count, 3)."""
        return np.einsum("vk,vkd->vd", self.weights, node_positions[self.nodes])


def enclosed_volume(vertices: np.ndarray, triangles: np.ndarray) -> float:
    """Signed volume [mm^3] inside a closed surface, positive when it faces outward (divergence theorem)."""
    a, b, c = np.moveaxis(vertices[triangles] - vertices.mean(axis=0), 1, 0)
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)
