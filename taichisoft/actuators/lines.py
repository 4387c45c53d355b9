"""Actuators drawn as lines: where their points are, in a state and in a frame of a recording; this needs no kernels."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from taichisoft.bodies.body_geometry import Poses
from taichisoft.bodies.moving_frames import MovingFrames
from taichisoft.bodies.rotations import matrices_from_quaternions


class LinePoses(Poses, Protocol):
    """Where bodies, frames and pull points are; a `State` is one. The arrays are as in `State`."""

    @property
    def frame_pose(self) -> np.ndarray: ...
    @property
    def pull_point(self) -> np.ndarray: ...


@dataclass(frozen=True)
class Line:
    """The points that an actuator runs through, such as a cable, and what carries them.

    Attributes:
        name: "body.cable".
        number: its number among the actuators of its kind; of a cable, its row in `pull_point`.
        owner: rigid body that carries each point, negative for points of soft bodies or in space, (point_count,).
        nodes: soft nodes that carry each point, shape (point_count, slots).
        weights: their weights; all 0 for points that no soft body carries, shape (point_count, slots).
        place: points that no soft body carries, in the rigid body's frame or in space, else 0 [mm], (point_count, 3).
        rest_length: length at the start [mm].
        friction: coefficient between the line and its points [-].
        has_pull_point: whether the first point is a cable's pull point, which stands in space and not on a body.
        frame: number of the frame that carries the pull point; -1 where it stays in space, or there is none.
    """

    name: str
    number: int
    owner: np.ndarray
    nodes: np.ndarray
    weights: np.ndarray
    place: np.ndarray
    rest_length: float
    friction: float = 0.0
    has_pull_point: bool = False
    frame: int = -1

    def points(self, poses: LinePoses, frames: MovingFrames) -> np.ndarray:
        """Positions of the points from the pulled end on [mm], shape (point_count, 3).

        Args:
            poses: where bodies, frames and pull points are.
            frames: the frames of the poses.
        """
        place = self.place.copy()
        if self.has_pull_point:
            place[0] = poses.pull_point[self.number]
            if self.frame >= 0:
                (place[0],) = frames.places(poses.frame_pose).moved(place[:1], self.frame)
        for body in np.unique(self.owner[self.owner >= 0]):
            (turn,) = matrices_from_quaternions(poses.rigid_rotation[body, None])
            place[self.owner == body] = place[self.owner == body] @ turn.T + poses.rigid_position[body]
        return place + np.einsum("pk,pkd->pd", self.weights, poses.position[self.nodes])


def segment_efforts(lines: Sequence[Line], effort: np.ndarray, loss: np.ndarray) -> list[np.ndarray]:
    """Efforts between the points of each line, each of shape (..., point_count - 1); friction makes them differ.

    Args:
        lines: lines of all actuators of a kind.
        effort: their efforts, such as tensions at pulled ends [mN], shape (..., actuator_count); further dimensions in
            front may be frames.
        loss: efforts lost to friction at inner points, in the order of the lines with friction, (..., loss_count).
    """
    efforts, first = [], 0
    for line, pulled in zip(lines, np.moveaxis(effort, -1, 0), strict=True):
        lost = np.zeros((*effort.shape[:-1], len(line.owner) - 1))
        if line.friction:
            last = first + len(line.owner) - 2
            lost[..., 1:] = loss[..., first:last].cumsum(axis=-1)
            first = last
        efforts.append(pulled[..., None] - lost)
    return efforts
