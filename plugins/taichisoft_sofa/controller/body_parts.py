"""Present values of the parts of which a scene puts soft bodies together: free points, and frames of rigid parts."""

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from taichisoft_sofa.components.frames import base_frames, composed, index_pairs, relative
from taichisoft_sofa.components.graph import inputs_of, mapping_of
from taichisoft_sofa.components.states import is_rigid, start_position
from taichisoft_sofa.translation.rigid_parts import rigid_parts

if TYPE_CHECKING:
    from taichisoft_sofa.translation.parts import SoftPart
    from taichisoft_sofa.tree.component import Component

Points = Callable[[], np.ndarray]
"""Function that returns the present places of all points of a body [mm], shape (point_count, 3)."""


def part_positions(part: "SoftPart", points: Points) -> "Iterator[tuple[Component, Points]]":
    """Mechanical objects of which a body is put together, each with a function that returns its positions.

    Args:
        part: the body.
        points: present places of its points.
    """
    parts = rigid_parts(part.body.state)
    mapping = mapping_of(part.body.state)
    if mapping is None or not parts:
        return
    inputs = inputs_of(mapping)
    pairs = index_pairs(mapping, len(inputs))
    for which, source in enumerate(inputs):
        rows = np.full(len(start_position(source)), -1)
        rows[pairs[pairs[:, 0] == which, 1]] = np.flatnonzero(pairs[:, 0] == which)
        if (rows >= 0).all():
            yield source, _rows(points, rows)
    frames: dict[int, tuple[Component, dict[int, np.ndarray]]] = {}
    for rigid in parts:
        for base, index in base_frames(rigid.state, rigid.index):
            if mapping_of(base) is None and is_rigid(base) and index is not None:
                frames.setdefault(id(base), (base, {}))[1][index] = rigid.points
    for base, by_index in frames.values():
        yield base, _frames(points, part.body.position, start_position(base), by_index)


def _rows(points: Points, rows: np.ndarray) -> Points:
    return lambda: points()[rows]


def _frames(points: Points, start: np.ndarray, poses: np.ndarray, by_index: dict[int, np.ndarray]) -> Points:
    def present() -> np.ndarray:
        moved, now = poses.copy(), points()
        for index, own in by_index.items():
            moved[index] = moved_pose(poses[index], start[own], now[own])
        return moved

    return present


def moved_pose(pose: np.ndarray, start: np.ndarray, now: np.ndarray) -> np.ndarray:
    """Pose (7,) of a frame that moves as points do that keep their shape, shapes (count, 3), in least squares."""
    turn, _ = Rotation.align_vectors(now - now.mean(axis=0), start - start.mean(axis=0))
    before = np.array([[*start.mean(axis=0), 0.0, 0.0, 0.0, 1.0]])
    after = np.array([[*now.mean(axis=0), *turn.as_quat()]])
    found: np.ndarray = composed(after, relative(before, pose[None]))[0]
    return found
