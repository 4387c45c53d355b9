"""Ten-node tetrahedra whose sides follow the curved surfaces of the geometry."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from taichisoft.caller_warnings import warn_caller
from taichisoft.meshes import SIDES, VolumeMesh, least_volumes, tetrahedron_volumes, with_middle_nodes
from taichisoft_meshing.gmsh_session import GmshFailure

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

    Raises:
        GmshFailure: the corners of its mesh of order 2 are other ones.
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
