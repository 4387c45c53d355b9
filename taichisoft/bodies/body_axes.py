"""Where the axes of bodies are in any state, for those whose axes a scene wants to be shown; this needs no kernels."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from taichisoft.bodies.body_geometry import Poses
from taichisoft.bodies.rotations import matrices_from_quaternions, rotation_from_degrees
from taichisoft.scenes.scene import Scene


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
    """The rotation about their means that brings points closest to where they are after, shape (3, 3).

    Closest in the sum of squares: Kabsch, "A solution for the best rotation to relate two sets of vectors", Acta
    Crystallographica A32 (1976) 922.

    Args:
        before, after: points [mm], shape (count, 3).
    """
    covariance = (after - after.mean(axis=0)).T @ (before - before.mean(axis=0))
    left, _, right = np.linalg.svd(covariance)
    left[:, 2] *= np.sign(np.linalg.det(left @ right))
    return left @ right
