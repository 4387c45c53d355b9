"""Frames that move as they are asked to, and carry what is anchored to them or follows them; the base is the first."""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from taichisoft.bodies.rotations import rotation_from_vector


@dataclass(frozen=True)
class FramePlaces:
    """Where all frames are: what was at x when they were at rest is at turn @ x + shift.

    Attributes:
        turn: rotation matrices, shape (frame_count, 3, 3).
        shift: shifts [mm], shape (frame_count, 3).
    """

    turn: np.ndarray
    shift: np.ndarray

    def moved(self, points: np.ndarray, frame: int) -> np.ndarray:
        """Points at rest [mm], shape (count, 3), carried along by a frame."""
        moved: np.ndarray = points @ self.turn[frame].T + self.shift[frame]
        return moved


@dataclass(frozen=True)
class MovingFrames:
    """The frames of a scene.

    A pose is the shift of the pivot and a rotation vector about it, in the axes of the frame that carries this one as
    they are at rest; so a jaw opens by the same translation, wherever the base is.

    Attributes:
        names: "base", then the others, each behind the frame that carries it.
        parent: number of the frame that carries each, -1 for frames in space, shape (frame_count,).
        pivot: points about which they turn, at rest [mm], shape (frame_count, 3).
    """

    names: tuple[str, ...]
    parent: np.ndarray
    pivot: np.ndarray
    _last: list[tuple[np.ndarray, FramePlaces]] = field(default_factory=list, repr=False, compare=False)

    def numbers(self, names: Iterable[str | None]) -> np.ndarray:
        """Numbers of frames by name, -1 for None."""
        return np.array([-1 if name is None else self.names.index(name) for name in names], dtype=np.int32)

    def places(self, pose: np.ndarray) -> FramePlaces:
        """Where the frames are, by their translations [mm] and rotation vectors [rad], shape (frame_count, 2, 3).

        Of poses that cannot change, such as those of a `State`, the last one is remembered: a step asks several times.
        """
        for known, places in self._last:
            if known is pose:
                return places
        found = self._find(pose)
        if not pose.flags.writeable:
            found.turn.setflags(write=False)
            found.shift.setflags(write=False)
            self._last[:] = [(pose, found)]
        return found

    def _find(self, pose: np.ndarray) -> FramePlaces:
        count = len(self.names)
        turn, shift = np.empty((count, 3, 3)), np.empty((count, 3))
        for number, (translation, rotation) in enumerate(pose):
            turn[number] = own = rotation_from_vector(rotation)
            pivot = self.pivot[number]
            shift[number] = (pivot - own @ pivot if rotation.any() else 0.0) + translation
            above = self.parent[number]
            if above >= 0:
                turn[number] = turn[above] @ own
                shift[number] = turn[above] @ shift[number] + shift[above]
        return FramePlaces(turn, shift)

    def pivots(self, places: FramePlaces) -> np.ndarray:
        """Where the pivots are [mm], shape (frame_count, 3)."""
        found: np.ndarray = np.einsum("fij,fj->fi", places.turn, self.pivot) + places.shift
        return found
