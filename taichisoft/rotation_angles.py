"""Rotation matrices by angles and by vectors; SciPy's Rotation, for the rest, takes a tenth of a start to import."""

import math

import numpy as np


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
    angle = float(np.linalg.norm(vector))
    if angle == 0.0:
        return np.eye(3)
    x, y, z = vector / angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + math.sin(angle) * cross + 2.0 * math.sin(angle / 2.0) ** 2 * cross @ cross


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
