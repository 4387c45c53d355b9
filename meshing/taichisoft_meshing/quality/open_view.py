"""A mesh cut open and projected onto a plane, ready to be painted from back to front."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from taichisoft.meshes.volume_mesh import VolumeMesh
from taichisoft_meshing.quality.surfaces import SurfaceQuality

TILT = np.radians(25.0)
"""How far the eye is above the line at a right angle to the cut."""


class Side(IntEnum):
    """What a face is part of."""

    CUT = 0
    OUTER = 1
    CAVITY = 2


@dataclass(frozen=True)
class OpenView:
    """Visible faces, farthest first.

    Attributes:
        corners: in the plane of the picture [mm], shape (face_count, 3, 2).
        element: that each face belongs to, shape (face_count,).
        side: of type `Side`, shape (face_count,).
        facing: cosine of the angle at which each face is seen, shape (face_count,).
    """

    corners: np.ndarray
    element: np.ndarray
    side: np.ndarray
    facing: np.ndarray


def open_view(mesh: VolumeMesh, surfaces: Sequence[SurfaceQuality]) -> OpenView:
    """Cut along the two longest dimensions, through the middle of the cavities if there are any."""
    extent = np.ptp(mesh.nodes, axis=0)
    right, up, through = (np.eye(3)[axis] for axis in np.argsort(-extent, kind="stable"))
    if np.linalg.det([right, up, through]) < 0:
        through = -through
    cavities = [surface.triangles for surface in surfaces if surface.of_cavity]
    inside = mesh.nodes[np.unique(np.concatenate(cavities))] if cavities else mesh.nodes
    middle = (inside.min(axis=0) + inside.max(axis=0)) / 2
    kept = np.flatnonzero((mesh.nodes[mesh.elements[:, :4]].mean(axis=1) - middle) @ through < 0)
    faces, element = _faces_of(mesh.elements[kept, :4])
    element = kept[element]
    towards = np.cos(TILT) * through + np.sin(TILT) * up
    upwards = np.cos(TILT) * up - np.sin(TILT) * through
    a, b, c = np.moveaxis(mesh.nodes[faces], 1, 0)
    normals = np.cross(b - a, c - a)
    facing = normals @ towards / np.linalg.norm(normals, axis=1)
    visible = np.flatnonzero(facing > 0)
    depth = mesh.nodes[faces[visible]].mean(axis=1) @ towards
    shown = visible[np.argsort(depth, kind="stable")]
    side = _sides(faces, surfaces)
    return OpenView(
        mesh.nodes[faces[shown]] @ np.column_stack([right, upwards]), element[shown], side[shown], facing[shown]
    )


def _faces_of(elements: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Faces that belong to one of the elements only, outward, and which one."""
    faces = elements[:, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]].reshape(-1, 3)
    _, first, counts = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    own = np.sort(first[counts == 1])
    return faces[own], own // 4


def _sides(faces: np.ndarray, surfaces: Sequence[SurfaceQuality]) -> np.ndarray:
    """Faces of a closed surface are those with its triangles' nodes, whichever way round."""
    sides = np.full(len(faces), Side.CUT)
    size = int(faces.max()) + 1
    numbers = np.sort(faces, axis=1).astype(np.int64) @ [size * size, size, 1]
    for surface in surfaces:
        if surface.closed_by_name:
            own = surface.triangles[(surface.triangles < size).all(axis=1)]
            here = np.isin(numbers, np.sort(own, axis=1).astype(np.int64) @ [size * size, size, 1])
            sides[here] = Side.CAVITY if surface.of_cavity else Side.OUTER
    return sides
