"""What anchored points follow: driven frames, the points of another mechanical object, or a motion given in time."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from taichisoft_sofa.components.frames import FramePoses, base_frames, composed, relative, start_values

if TYPE_CHECKING:
    from taichisoft_sofa.tree.component import Component


class AnchorTarget(Protocol):
    """Places to which points are held."""

    def places(self, rows: np.ndarray, time: float, poses: FramePoses) -> np.ndarray:
        """Places of some of the points [mm], shape (row_count, 3).

        Args:
            rows: numbers of these points among those of the anchor, shape (row_count,).
            time: end of the step [s].
            poses: poses of frames and places of points at that time.
        """
        ...

    def sources(self) -> "Sequence[Component]":
        """The mechanical objects whose positions the scene may write to move the target."""
        ...


@dataclass(frozen=True)
class DrivenFrameTarget:
    """Points that a driven frame carries: mechanical object and index of it, and their places in its axes [mm]."""

    state: "Component"
    index: int
    local: np.ndarray

    @classmethod
    def carrying(cls, state: "Component", index: int, places: np.ndarray) -> "DrivenFrameTarget":
        """The target of points at these places at the start [mm], shape (count, 3)."""
        frame = FramePoses(start_values).of(state)[[index]]
        return cls(state, index, relative(np.repeat(frame, len(places), axis=0), places))

    def places(self, rows: np.ndarray, time: float, poses: FramePoses) -> np.ndarray:
        """Places of points on the frame [mm]."""
        return composed(np.repeat(poses.of(self.state)[[self.index]], len(rows), axis=0), self.local[rows])

    def sources(self) -> "Sequence[Component]":
        """The independent frames and angles."""
        return [base for base, _ in base_frames(self.state, self.index)]


@dataclass(frozen=True)
class PointsTarget:
    """Points of another mechanical object that no body here moves: itself, and their indices, shape (count,)."""

    state: "Component"
    indices: np.ndarray

    def places(self, rows: np.ndarray, time: float, poses: FramePoses) -> np.ndarray:
        """Present places of the points, or of the origins of frames [mm]."""
        return poses.of(self.state)[self.indices[rows], :3]

    def sources(self) -> "Sequence[Component]":
        """The mechanical object."""
        return [self.state]

    def frame_of(self, row: int) -> "tuple[Component, int]":
        """The mechanical object, and the index in it of a point or frame."""
        return self.state, int(self.indices[row])


@dataclass(frozen=True)
class MotionTarget:
    """Points that are shifted in time, linearly from key to key, and stand still before the first and after the last.

    Attributes:
        start: places at the start [mm], shape (count, 3).
        times: times of the keys, rising [s], shape (key_count,).
        shifts: shifts at the keys [mm], shape (key_count, 3).
    """

    start: np.ndarray
    times: np.ndarray
    shifts: np.ndarray

    def places(self, rows: np.ndarray, time: float, poses: FramePoses) -> np.ndarray:
        """Shifted places [mm]."""
        shift = [np.interp(time, self.times, column) for column in self.shifts.T]
        return self.start[rows] + np.array(shift)

    def sources(self) -> "Sequence[Component]":
        """None."""
        return []
