"""The bodies of a recording, as they are read from it."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from taichisoft.meshes.volume_mesh import VolumeMesh


@dataclass(frozen=True)
class RecordedSurface:
    """A surface that can be drawn.

    Attributes:
        name: of the body, or of the cavity ("finger1.cavity").
        kind: what it belongs to.
        triangles: vertex indices, outward, shape (triangle_count, 3).
        vertices: gives the vertex positions [mm], shape (vertex_count, 3), in a frame.
    """

    name: str
    kind: Literal["soft", "cavity", "rigid", "obstacle"]
    triangles: np.ndarray
    vertices: Callable[[int], np.ndarray]


@dataclass(frozen=True)
class RecordedPlane:
    """An infinite plane.

    Attributes:
        name: of the obstacle.
        point: a point of it [mm], shape (3,).
        normal: unit normal [-], shape (3,).
    """

    name: str
    point: np.ndarray
    normal: np.ndarray


@dataclass(frozen=True)
class RecordedSoftBody:
    """A soft body; node indices count within it.

    Attributes:
        name: of the body.
        nodes: where its nodes stand in `row("position", frame)` and the other arrays of all nodes.
        rest_position: placed nodes [mm], shape (node_count, 3).
        elements: shape (element_count, nodes_per_element).
        young_modulus: of each element [kPa], shape (element_count,).
        poisson_ratio: of each element, shape (element_count,).
        element_groups: element indices by the names of the mesh.
        surface_groups: triangles (count, 3) of node indices by the names of the mesh.
        mesh_nodes: nodes as they were in the mesh, before they were placed [mm], shape (node_count, 3).
    """

    name: str
    nodes: slice
    rest_position: np.ndarray
    elements: np.ndarray
    young_modulus: np.ndarray
    poisson_ratio: np.ndarray
    element_groups: dict[str, np.ndarray]
    surface_groups: dict[str, np.ndarray]
    mesh_nodes: np.ndarray

    def mesh(self, source: str) -> VolumeMesh:
        """The mesh that it was made of; errors about it begin with `source`."""
        return VolumeMesh(source, self.mesh_nodes, self.elements, self.surface_groups, self.element_groups)


@dataclass(frozen=True)
class RecordedRigidBody:
    """A rigid body; its frame has its origin in the centre of mass.

    Attributes:
        name: of the body.
        vertices: of its surface in the body frame [mm], shape (vertex_count, 3).
        triangles: vertex indices, outward, shape (triangle_count, 3).
    """

    name: str
    vertices: np.ndarray
    triangles: np.ndarray


def read_soft_body(group: Any) -> RecordedSoftBody:
    """One of the groups of `soft_bodies`.

    Raises:
        KeyError: it lacks something, because an older version wrote it.
    """
    return RecordedSoftBody(
        name=group.attrs["name"],
        nodes=slice(*map(int, group.attrs["nodes"])),
        rest_position=group["rest_position"][:],
        elements=group["elements"][:],
        young_modulus=group["young_modulus"][:],
        poisson_ratio=group["poisson_ratio"][:],
        element_groups={name: members[:] for name, members in group["element_groups"].items()},
        surface_groups={name: members[:] for name, members in group["surface_groups"].items()},
        mesh_nodes=group["mesh_nodes"][:],
    )


def read_rigid_body(group: Any) -> RecordedRigidBody:
    """One of the groups of `rigid_bodies`."""
    return RecordedRigidBody(group.attrs["name"], group["vertices"][:], group["triangles"][:])


def numbered(file: Any, name: str) -> list[Any]:
    """The groups "0", "1", ... of a group, in this order; HDF5 lists them as words ("10" before "2")."""
    return [file[name][key] for key in sorted(file[name], key=int)] if name in file else []
