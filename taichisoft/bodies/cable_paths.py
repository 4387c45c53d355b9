"""Where the points of cables are, in a state and in a frame of a recording; this needs no kernels."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from taichisoft.bodies.rotations import matrices_from_quaternions, rotation_from_vector
from taichisoft.bodies.surfaces import Poses

if TYPE_CHECKING:
    from taichisoft.bodies.cables import Cables


class CablePoses(Poses, Protocol):
    """Where bodies, base and pull points are; a `State` is one. The arrays are those of `State`."""

    @property
    def base_translation(self) -> np.ndarray: ...
    @property
    def base_rotation(self) -> np.ndarray: ...
    @property
    def pull_point(self) -> np.ndarray: ...


@dataclass(frozen=True)
class CablePath:
    """The points that a cable runs through, and what carries them.

    Attributes:
        name: "body.cable".
        number: row of the cable in `pull_point` and in the other arrays by cable.
        owner: rigid body that carries each point, negative for points of soft bodies or in space, (point_count,).
        nodes: soft nodes that carry each point, shape (point_count, slots).
        weights: their weights; all 0 for points that no soft body carries, shape (point_count, slots).
        place: points that no soft body carries, in the rigid body's frame or in space, else 0 [mm], (point_count, 3).
        rest_length: length at the start [mm].
        friction: coefficient between the cable and its points [-].
        has_pull_point: whether the first point is a pull point, which stands in space and not on a body.
        pull_point_moves: whether it moves with the base.
    """

    name: str
    number: int
    owner: np.ndarray
    nodes: np.ndarray
    weights: np.ndarray
    place: np.ndarray
    rest_length: float
    friction: float
    has_pull_point: bool
    pull_point_moves: bool

    def points(self, poses: CablePoses, base_pivot: np.ndarray) -> np.ndarray:
        """Positions of the points from the pulled end on [mm], shape (point_count, 3).

        Args:
            poses: where bodies, base and pull points are.
            base_pivot: the point about which the base turns [mm], shape (3,).
        """
        place = self.place.copy()
        if self.has_pull_point:
            place[0] = poses.pull_point[self.number]
            if self.pull_point_moves:
                (place[0],) = moved_with_base(place[:1], poses, base_pivot)
        for body in np.unique(self.owner[self.owner >= 0]):
            (turn,) = matrices_from_quaternions(poses.rigid_rotation[body, None])
            place[self.owner == body] = place[self.owner == body] @ turn.T + poses.rigid_position[body]
        return place + np.einsum("pk,pkd->pd", self.weights, poses.position[self.nodes])


def cable_paths(cables: "Cables") -> list[CablePath]:
    """The paths of a model's cables."""
    return [
        CablePath(
            name=cable.name,
            number=number,
            owner=cable.owner,
            nodes=cable.nodes,
            weights=cable.weights,
            place=cable.place,
            rest_length=cable.rest_length,
            friction=cable.settings.friction,
            has_pull_point=bool(cables.has_pull_point[number]),
            pull_point_moves=bool(cables.pull_point_moves[number]),
        )
        for number, cable in enumerate(cables.all)
    ]


def moved_with_base(points: np.ndarray, poses: CablePoses, base_pivot: np.ndarray) -> np.ndarray:
    """Points [mm], shape (count, 3), carried along by the base, which turns about `base_pivot` [mm], shape (3,)."""
    return (points - base_pivot) @ rotation_from_vector(poses.base_rotation).T + base_pivot + poses.base_translation


def segment_tensions(paths: Sequence[CablePath], tension: np.ndarray, tension_loss: np.ndarray) -> list[np.ndarray]:
    """Tensions between the points of each cable [mN], each of shape (..., point_count - 1); friction makes them differ.

    Args:
        paths: all cables of a model.
        tension: `State.cable_tension` [mN], shape (..., cable_count); further dimensions in front may be frames.
        tension_loss: `State.cable_tension_loss` [mN], shape (..., rubbing_point_count).
    """
    tensions, first = [], 0
    for path, pulled in zip(paths, np.moveaxis(tension, -1, 0), strict=True):
        lost = np.zeros((*tension.shape[:-1], len(path.owner) - 1))
        if path.friction:
            last = first + len(path.owner) - 2
            lost[..., 1:] = tension_loss[..., first:last].cumsum(axis=-1)
            first = last
        tensions.append(pulled[..., None] - lost)
    return tensions
