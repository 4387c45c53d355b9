"""Normals of a triangulated surface at its vertices, and whether it can be taken as a smooth one."""

import numpy as np

from taichisoft.errors import MeshError

SHARPEST = 40.0  # [degrees] between two triangles of a surface that stands for a smooth one
# A triangle is curved in both directions if its corners' normals span at least this share of the solid angle that they
# would on a ball of the same angles; on a cylinder they span none.
CURVED = 1e-3


def vertex_normals(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Unit normals at the vertices, shape (vertex_count, 3): means of the triangles', weighted by their angles there.

    Args:
        vertices: positions [mm], shape (vertex_count, 3).
        triangles: vertex indices, outward, shape (triangle_count, 3).
    """
    corners = vertices[triangles]
    faces = _unit(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    total = np.zeros_like(vertices)
    for corner in range(3):
        one = _unit(corners[:, (corner + 1) % 3] - corners[:, corner])
        other = _unit(corners[:, (corner + 2) % 3] - corners[:, corner])
        angle = np.arccos(np.clip((one * other).sum(axis=1), -1.0, 1.0))
        np.add.at(total, triangles[:, corner], angle[:, None] * faces)
    return _unit(total)


def refuse_unsmooth(vertices: np.ndarray, triangles: np.ndarray, source: str) -> None:
    """Refuse what cannot be taken as a smooth surface that is curved in both directions, such as a ball or an egg.

    Args:
        vertices: positions [mm], shape (vertex_count, 3).
        triangles: vertex indices, outward, shape (triangle_count, 3).
        source: key of the scene that asks for it, which begins the error.

    Raises:
        MeshError: it has sharp edges, or triangles that stand for flat or cylindrical parts.
    """
    corners = vertices[triangles]
    faces = _unit(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    edges = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    order = np.lexsort(edges.T)
    same = (edges[order[1:]] == edges[order[:-1]]).all(axis=1)
    cosine = (faces[order[1:][same] // 3] * faces[order[:-1][same] // 3]).sum(axis=1)
    turn = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
    if (turn > SHARPEST).any():
        raise MeshError(
            f"{source}: the surface turns by up to {turn.max():.0f} degrees, by more than {SHARPEST:.0f} at "
            f"{(turn > SHARPEST).sum()} edges; mesh it more finely, or leave smooth out"
        )
    normals = vertex_normals(vertices, triangles)[triangles]
    spread = np.linalg.norm(normals - np.roll(normals, 1, axis=1), axis=2)
    spanned = np.abs(np.linalg.det(normals))
    unfit = int((spanned <= CURVED * spread.max(axis=1) ** 2 + 1e-12).sum())
    if unfit:
        raise MeshError(
            f"{source}: {unfit} of {len(triangles)} triangles are flat or curved in one direction only; a surface "
            "that is taken as smooth is curved in both everywhere, as a ball or an egg is"
        )


def _unit(vectors: np.ndarray) -> np.ndarray:
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    unit: np.ndarray = vectors / np.where(lengths > 0.0, lengths, 1.0)
    return unit
