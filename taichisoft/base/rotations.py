"""Rotations as matrices, vectors, angles and quaternions. SciPy's Rotation takes a tenth of a start to import."""

import math

import numpy as np

# Rotation matrices by angles and by vectors; SciPy's Rotation, for the rest, takes a tenth of a start to import.

IDENTITY = np.eye(3)


def rotation_from_degrees(angles: tuple[float, float, float]) -> np.ndarray:
    """Rotation matrix (3, 3) for turns [degrees] about the fixed x, y and z axes, in this order."""
    a, b, c = np.radians(angles)
    about_x = np.array([[1, 0, 0], [0, math.cos(a), -math.sin(a)], [0, math.sin(a), math.cos(a)]])
    about_y = np.array([[math.cos(b), 0, math.sin(b)], [0, 1, 0], [-math.sin(b), 0, math.cos(b)]])
    about_z = np.array([[math.cos(c), -math.sin(c), 0], [math.sin(c), math.cos(c), 0], [0, 0, 1]])
    return about_z @ about_y @ about_x


def degrees_from_rotation(matrix: np.ndarray) -> list[float]:
    """The three angles [degrees] of `rotation_from_degrees`; the third is 0 where the second is a right angle."""
    across = math.hypot(matrix[0, 0], matrix[1, 0])
    second = math.atan2(-matrix[2, 0], across)
    if across < 1e-7:
        return np.degrees([math.atan2(-matrix[1, 2], matrix[1, 1]), second, 0.0]).tolist()
    first, third = math.atan2(matrix[2, 1], matrix[2, 2]), math.atan2(matrix[1, 0], matrix[0, 0])
    return np.degrees([first, second, third]).tolist()


def rotation_from_vector(vector: np.ndarray) -> np.ndarray:
    """Rotation matrix (3, 3) by the angle |vector| [rad] about it, by Rodrigues' formula."""
    angle = math.sqrt(vector @ vector)
    if angle == 0.0:
        return IDENTITY.copy()
    x, y, z = vector / angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return IDENTITY + math.sin(angle) * cross + 2.0 * math.sin(angle / 2.0) ** 2 * cross @ cross


def quaternion_from_matrix(matrix: np.ndarray) -> np.ndarray:
    """Unit quaternion (w, x, y, z) of a rotation matrix, by its largest entry (Shepperd 1978, Quaternion from rotation
    matrix)."""
    m, trace = matrix, np.trace(matrix)
    squares = np.array([trace, *np.diag(m)])  # 4 w^2 - 1, and 2 x^2 + (trace - 1) / 2 and so on
    k = int(np.argmax(squares))
    if k == 0:
        found = np.array([1.0 + trace, m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]])
    else:
        i, j, h = k - 1, k % 3, (k + 1) % 3
        found = np.zeros(4)
        found[0] = m[h, j] - m[j, h]
        found[1 + i] = 1.0 + m[i, i] - m[j, j] - m[h, h]
        found[1 + j], found[1 + h] = m[j, i] + m[i, j], m[h, i] + m[i, h]
    return found / np.linalg.norm(found)


# Rotations that place bodies, and directions, with the conventions of scenes and states.


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

    turn = (Rotation.from_rotvec(end.copy()) * Rotation.from_rotvec(start.copy()).inv()).as_rotvec()
    angle = float(np.linalg.norm(turn))
    return end if angle <= furthest else compose_rotation_vectors(furthest / angle * turn, start)


def edge_frames(along: np.ndarray, across: np.ndarray) -> np.ndarray:
    """Frames (count, 3, 3): first column along one edge, third normal to it and another; edges of shape (count, 3)."""
    first = along / np.linalg.norm(along, axis=1, keepdims=True)
    third = np.cross(first, across)
    third /= np.linalg.norm(third, axis=1, keepdims=True)
    return np.ascontiguousarray(np.stack([first, np.cross(third, first), third], axis=2))


def turn_matrices(turn: np.ndarray, mean: bool = False) -> np.ndarray:
    """Rotations by vectors [rad], (..., 3, 3), or their means on the way, by which vectors turn with a change."""
    square = (turn**2).sum(axis=-1)[..., None, None]
    x, y, z = np.moveaxis(turn, -1, 0)
    cross = np.moveaxis(np.array([[0.0 * x, -z, y], [z, 0.0 * x, -x], [-y, x, 0.0 * x]]), (0, 1), (-2, -1))
    small = np.abs(square) < 1e-4
    angle = np.sqrt(np.where(small, 1.0, square))
    if mean:
        first = np.where(small, 0.5 - square / 24.0 + square**2 / 720.0, (1.0 - np.cos(angle)) / angle**2)
        second = np.where(small, (1.0 - square / 20.0 + square**2 / 840.0) / 6.0, (angle - np.sin(angle)) / angle**3)
    else:
        first = np.where(small, 1.0 - square / 6.0 + square**2 / 120.0, np.sin(angle) / angle)
        second = np.where(small, 0.5 - square / 24.0 + square**2 / 720.0, (1.0 - np.cos(angle)) / angle**2)
    return np.eye(3) + first * cross + second * (cross @ cross)
