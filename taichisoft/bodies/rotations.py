"""Rotations that place bodies, and directions, with the conventions of scenes and states."""

import numpy as np

from taichisoft.rotation_angles import quaternion_from_matrix as quaternion_from_matrix
from taichisoft.rotation_angles import rotation_from_degrees as rotation_from_degrees
from taichisoft.rotation_angles import rotation_from_vector as rotation_from_vector


def vector_from_rotation(matrix: np.ndarray) -> np.ndarray:
    """The rotation vector [rad], shape (3,), of a rotation matrix."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(matrix).as_rotvec()


def matrices_from_quaternions(quaternions: np.ndarray) -> np.ndarray:
    """Rotation matrices (count, 3, 3) of unit quaternions (w, x, y, z), shape (count, 4)."""
    w, x, y, z = quaternions.T
    return np.stack(
        [
            np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], axis=1),
            np.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], axis=1),
            np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=1),
        ],
        axis=1,
    )


def compose_rotation_vectors(second: np.ndarray, first: np.ndarray) -> np.ndarray:
    """The rotation vector [rad], shape (3,), of turning by `first` and then by `second`."""
    from scipy.spatial.transform import Rotation

    return (Rotation.from_rotvec(second.copy()) * Rotation.from_rotvec(first.copy())).as_rotvec()


def right_of(up: np.ndarray) -> np.ndarray:
    """The unit vector to the right, as keys and pictures have it, for a unit vector upwards; both of shape (3,).

    It is the next coordinate axis after up (z up: x, x up: y), made perpendicular to it, so that it stands firm.
    """
    axis = np.roll(np.eye(3)[np.argmax(np.abs(up))], 1)
    right = axis - up * (axis @ up)
    return right / np.linalg.norm(right)


def turn_towards(start: np.ndarray, end: np.ndarray, furthest: float) -> np.ndarray:
    """From the rotation vector `start` the shortest way to `end`, but by no more than `furthest` [rad]."""
    if (start == end).all():
        return end
    from scipy.spatial.transform import Rotation

    way = (Rotation.from_rotvec(end.copy()) * Rotation.from_rotvec(start.copy()).inv()).as_rotvec()
    angle = float(np.linalg.norm(way))
    return end if angle <= furthest else compose_rotation_vectors(furthest / angle * way, start)


def edge_frames(along: np.ndarray, across: np.ndarray) -> np.ndarray:
    """Frames (count, 3, 3): first column along one edge, third normal to it and another; edges of shape (count, 3)."""
    first = along / np.linalg.norm(along, axis=1, keepdims=True)
    third = np.cross(first, across)
    third /= np.linalg.norm(third, axis=1, keepdims=True)
    return np.ascontiguousarray(np.stack([first, np.cross(third, first), third], axis=2))
