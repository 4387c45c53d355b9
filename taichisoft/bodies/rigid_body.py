"""A rigid body's mass, inertia and surface, and obstacles that never move."""

from dataclasses import dataclass, field

import numpy as np
import trimesh

from taichisoft.bodies.rotations import quaternion_from_matrix, rotation_from_degrees
from taichisoft.errors import SceneError
from taichisoft.meshes.surface import closed_outward, count_open_edges
from taichisoft.meshes.surface_files import read_surface
from taichisoft.scenes import rigid_body as settings


@dataclass(frozen=True)
class RigidBody:
    """Constants of one rigid body; its frame has its origin in the centre of mass.

    Attributes:
        name: the body's name in the scene.
        vertices: of its surface in the body frame [mm], shape (vertex_count, 3).
        triangles: vertex indices, outward, shape (triangle_count, 3).
        mass: [kg].
        inertia: about the centre of mass in the body frame [kg mm^2], shape (3, 3).
        centre_of_mass: in the coordinates of the scaled surface [mm], shape (3,).
        start_position: centre of mass at the start [mm], shape (3,).
        start_rotation: unit quaternion (w, x, y, z) at the start.
        start_velocity: [mm/s], shape (3,).
        start_angular_velocity: [rad/s], shape (3,).
        collides: whether it touches other bodies.
        groups: surfaces that have one in common do not touch each other.
    """

    name: str
    vertices: np.ndarray
    triangles: np.ndarray
    mass: float
    inertia: np.ndarray
    centre_of_mass: np.ndarray
    start_position: np.ndarray
    start_rotation: np.ndarray
    start_velocity: np.ndarray
    start_angular_velocity: np.ndarray
    collides: bool = True
    groups: frozenset[int] = frozenset()


@dataclass(frozen=True)
class Obstacle:
    """Something static: a surface (vertices and triangles), or an infinite plane (point and unit normal).

    What is at x in the coordinates of its scaled surface stands at turn @ x + shift.
    """

    name: str
    vertices: np.ndarray | None = None
    triangles: np.ndarray | None = None
    point: np.ndarray | None = None
    normal: np.ndarray | None = None
    groups: frozenset[int] = frozenset()
    turn: np.ndarray = field(default_factory=lambda: np.eye(3))
    shift: np.ndarray = field(default_factory=lambda: np.zeros(3))


def make_rigid_body(name: str, body: settings.RigidBody) -> RigidBody:
    """Compute a rigid body from its table in the scene.

    Raises:
        MeshError: its surface cannot be read or is not closed.
        SceneError: the given inertia is not symmetric positive definite.
    """
    if body.box is not None:
        box = trimesh.creation.box(extents=body.box)
        vertices, triangles = np.array(box.vertices), np.array(box.faces)
    else:
        vertices, triangles = read_surface(body.surface or "")
        triangles = closed_outward(vertices, triangles, body.surface or "")
        vertices = vertices * body.scale
    solid = trimesh.Trimesh(vertices, triangles, process=False)
    solid.density = body.density if body.density is not None else (body.mass or 0.0) / solid.volume
    centre = np.array(body.centre_of_mass if body.centre_of_mass is not None else solid.center_mass)
    inertia = np.array(body.inertia) if body.inertia is not None else solid.mass_properties["inertia"]
    if not np.allclose(inertia, inertia.T) or np.linalg.eigvalsh(inertia)[0] <= 0.0:
        raise SceneError(f"rigid_bodies.{name}.inertia = {inertia.tolist()}: must be symmetric and positive definite")
    turn = rotation_from_degrees(body.rotation)
    return RigidBody(
        name=name,
        vertices=vertices - centre,
        triangles=triangles.astype(np.int32),
        mass=float(solid.mass),
        inertia=inertia,
        centre_of_mass=centre,
        start_position=np.asarray(body.position) + turn @ centre,
        start_rotation=quaternion_from_matrix(turn),
        start_velocity=np.array(body.velocity),
        start_angular_velocity=np.array(body.angular_velocity),
        collides=body.collides,
        groups=frozenset(body.groups),
    )


def make_obstacle(name: str, obstacle: settings.Obstacle) -> Obstacle:
    """Compute an obstacle from its table in the scene; its surface need not be closed, but a closed one faces outward.

    Raises:
        MeshError: its surface cannot be read, or is closed and encloses no volume.
    """
    if obstacle.plane is not None:
        normal = np.array(obstacle.plane.normal)
        return Obstacle(name, point=np.array(obstacle.plane.point), normal=normal / np.linalg.norm(normal))
    vertices, triangles = read_surface(obstacle.surface or "")
    if count_open_edges(triangles) == 0:
        triangles = closed_outward(vertices, triangles, obstacle.surface or "")
    turn, shift = rotation_from_degrees(obstacle.rotation), np.asarray(obstacle.translation)
    placed = obstacle.scale * vertices @ turn.T + shift
    groups = frozenset(obstacle.groups)
    return Obstacle(name, placed, triangles.astype(np.int32), groups=groups, turn=turn, shift=shift)
