"""Surfaces of all bodies of a scene, and where they are in any of its states; this needs no kernels."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, NamedTuple, Protocol

import numpy as np

from taichisoft.base.rotations import matrices_from_quaternions, rotation_from_degrees
from taichisoft.mesh.surface import MappedSurface
from taichisoft.scene.scene import Scene

if TYPE_CHECKING:
    from taichisoft.mechanics.rigid_body_arrays import Obstacle, RigidBody
    from taichisoft.mechanics.soft_body_arrays import SoftBody

SurfaceKind = Literal["soft", "cavity", "membrane", "fibre", "rigid", "obstacle", "line"]


class Poses(Protocol):
    """Where soft nodes and rigid bodies are: the arrays of a `State`, which is one."""

    @property
    def position(self) -> np.ndarray: ...
    @property
    def rigid_position(self) -> np.ndarray: ...
    @property
    def rigid_rotation(self) -> np.ndarray: ...


class PosesAhead(NamedTuple):
    """Where soft nodes and rigid bodies would be, as `Poses`."""

    position: np.ndarray
    rigid_position: np.ndarray
    rigid_rotation: np.ndarray


@dataclass(frozen=True)
class Surface:
    """A surface of a body; two kinds of it know where its vertices are, in a state and in a frame of a recording.

    Attributes:
        name: name of the body, or of the cavity ("finger1.cavity"), membrane or fibre ("finger1.paper|membrane").
        kind: what the surface belongs to.
        triangles: vertex indices, outward, shape (triangle_count, 3).
    """

    name: str
    kind: SurfaceKind
    triangles: np.ndarray


@dataclass(frozen=True)
class BodySurface(Surface):
    """A surface and what carries it: soft nodes, a rigid body, or nothing that moves.

    Attributes:
        shape: a map from all soft nodes to the vertices, or the vertices [mm], shape (vertex_count, 3), of a
            rigid body in its own frame, of an obstacle in the world.
        rigid_body: index of the rigid body that carries the vertices; None for other surfaces.
    """

    shape: MappedSurface | np.ndarray
    rigid_body: int | None = None

    def vertices(self, poses: Poses) -> np.ndarray:
        """Positions of the vertices [mm], shape (vertex_count, 3)."""
        if isinstance(self.shape, MappedSurface):
            return self.shape.positions(poses.position)
        if self.rigid_body is None:
            return self.shape
        (rotation,) = matrices_from_quaternions(poses.rigid_rotation[self.rigid_body, None])
        return self.shape @ rotation.T + poses.rigid_position[self.rigid_body]


@dataclass(frozen=True)
class Plane:
    """An infinite obstacle.

    Attributes:
        name: name of the obstacle.
        point: a point of the plane [mm], shape (3,).
        normal: unit normal, shape (3,).
    """

    name: str
    point: np.ndarray
    normal: np.ndarray


def soft_surface(name: str, kind: SurfaceKind, surface: MappedSurface, nodes: slice) -> BodySurface:
    """The surface of a soft body, or the wall of a cavity, over the body's nodes, which are `nodes` of all nodes."""
    carried = MappedSurface(surface.nodes + nodes.start, surface.weights, surface.triangles)
    return BodySurface(name, kind, surface.triangles, carried)


def body_surfaces(
    soft_bodies: "Iterable[SoftBody]", rigid_bodies: "Iterable[RigidBody]", obstacles: "Iterable[Obstacle]"
) -> list[BodySurface]:
    """All surfaces with triangles: each soft body with what is in and on it, the rigid bodies, the obstacles."""
    surfaces = []
    for body in soft_bodies:
        surfaces.append(soft_surface(body.name, "soft", body.surface, body.nodes))
        surfaces += [soft_surface(cavity.name, "cavity", cavity.surface, body.nodes) for cavity in body.cavities]
        surfaces += [soft_surface(*one, body.nodes) for one in body.reinforcement_surfaces]
    for index, rigid in enumerate(rigid_bodies):
        surfaces.append(BodySurface(rigid.name, "rigid", rigid.triangles, rigid.vertices, index))
    for obstacle in obstacles:
        if obstacle.vertices is not None and obstacle.triangles is not None:
            surfaces.append(BodySurface(obstacle.name, "obstacle", obstacle.triangles, obstacle.vertices))
    return surfaces


def planes_of(obstacles: "Iterable[Obstacle]") -> list[Plane]:
    """The infinite obstacles."""
    return [
        Plane(obstacle.name, obstacle.point, obstacle.normal)
        for obstacle in obstacles
        if obstacle.point is not None and obstacle.normal is not None
    ]


# Where the axes of bodies are in any state, for those whose axes a scene wants to be shown; this needs no kernels.


class PlacedNodes(Protocol):
    """A soft body, of a model or of a recording."""

    @property
    def name(self) -> str: ...
    @property
    def nodes(self) -> slice: ...
    @property
    def rest_position(self) -> np.ndarray: ...


@dataclass(frozen=True)
class SoftAxes:
    """The axes of a soft body's mesh file, turned as the body has turned on the whole, at the mean of its nodes.

    Attributes:
        nodes: where its nodes stand among the nodes of all soft bodies.
        rest_position: its placed nodes [mm], shape (node_count, 3).
        placement: rotation that placed it, shape (3, 3).
    """

    nodes: slice
    rest_position: np.ndarray
    placement: np.ndarray

    def place(self, poses: Poses) -> np.ndarray:
        """Origin [mm] and unit vectors along x, y and z, shape (4, 3)."""
        position = np.asarray(poses.position[self.nodes], dtype=float)
        turn = best_rotation(self.rest_position, position) @ self.placement
        return np.vstack([position.mean(axis=0), turn.T])


@dataclass(frozen=True)
class RigidAxes:
    """The axes of a rigid body's surface, at its centre of mass.

    Attributes:
        index: number of the rigid body.
    """

    index: int

    def place(self, poses: Poses) -> np.ndarray:
        """Origin [mm] and unit vectors along x, y and z, shape (4, 3)."""
        (turn,) = matrices_from_quaternions(poses.rigid_rotation[self.index, None])
        return np.vstack([poses.rigid_position[self.index], turn.T])


BodyAxes = SoftAxes | RigidAxes


def axes_of_bodies(scene: Scene, soft_bodies: Iterable[PlacedNodes]) -> dict[str, BodyAxes]:
    """By name, the axes of the bodies that have `axes = true` in the scene."""
    axes: dict[str, BodyAxes] = {
        body.name: SoftAxes(
            body.nodes, body.rest_position, rotation_from_degrees(scene.soft_bodies[body.name].rotation)
        )
        for body in soft_bodies
        if scene.soft_bodies[body.name].axes
    }
    rigid = enumerate(scene.rigid_bodies.items())
    return axes | {name: RigidAxes(index) for index, (name, body) in rigid if body.axes}


def best_rotation(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """The rotation about their means that brings points [mm], (count, 3), closest to where they are after, shape (3,
    3).

    Closest in the sum of squares: Kabsch, "A solution for the best rotation to relate two sets of vectors", Acta
    Crystallographica A32 (1976) 922.
    """
    covariance = (after - after.mean(axis=0)).T @ (before - before.mean(axis=0))
    left, _, right = np.linalg.svd(covariance)
    left[:, 2] *= np.sign(np.linalg.det(left @ right))
    return left @ right
