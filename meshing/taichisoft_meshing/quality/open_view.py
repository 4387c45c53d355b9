"""A mesh cut open and projected onto a plane, ready to be painted from back to front."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from taichisoft.meshes.volume_mesh import VolumeMesh
from taichisoft_meshing.quality.surfaces import SurfaceQuality
from taichisoft_meshing.quality.tetrahedra import FACES, neighbours

TILT = np.radians(25.0)
"""Angle of the eye above the line at a right angle to the cut [rad]."""


class Side(IntEnum):
    """The side of the body to which a face belongs."""

    CUT = 0
    OUTER = 1
    CAVITY = 2


@dataclass(frozen=True)
class OpenView:
    """Visible faces, farthest first.

    Attributes:
        corners: corners of each face in the plane of the picture [mm], shape (face_count, 3, 2).
        element: element of each face, shape (face_count,).
        side: side of each face, of type `Side`, shape (face_count,).
        facing: cosine of the angle at which each face is seen [-], shape (face_count,).
    """

    corners: np.ndarray
    element: np.ndarray
    side: np.ndarray
    facing: np.ndarray


def open_view(mesh: VolumeMesh, surfaces: Sequence[SurfaceQuality]) -> OpenView:
    """Cut a mesh along its two longest dimensions, through the middle of the cavities if there are any."""
    extent = np.ptp(mesh.nodes, axis=0)
    right, up, through = (np.eye(3)[axis] for axis in np.argsort(-extent, kind="stable"))
    if np.linalg.det([right, up, through]) < 0:
        through = -through
    cavities = [surface.triangles for surface in surfaces if surface.of_cavity]
    inside = mesh.nodes[np.unique(np.concatenate(cavities))] if cavities else mesh.nodes
    middle = (inside.min(axis=0) + inside.max(axis=0)) / 2
    kept = np.flatnonzero((mesh.nodes[mesh.elements[:, :4]].mean(axis=1) - middle) @ through < 0)
    solid = mesh.elements[kept, :4]
    element, face = np.nonzero(neighbours(solid) < 0)
    faces = solid[element[:, None], FACES[face]]
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


def _sides(faces: np.ndarray, surfaces: Sequence[SurfaceQuality]) -> np.ndarray:
    """The side of each face, shape (face_count,): a closed surface has the faces with the nodes of its triangles."""
    sides = np.full(len(faces), Side.CUT)
    size = int(faces.max()) + 1
    numbers = np.sort(faces, axis=1).astype(np.int64) @ [size * size, size, 1]
    for surface in surfaces:
        if surface.closed_by_name:
            own = surface.triangles[(surface.triangles < size).all(axis=1)]
            here = np.isin(numbers, np.sort(own, axis=1).astype(np.int64) @ [size * size, size, 1])
            sides[here] = Side.CAVITY if surface.of_cavity else Side.OUTER
    return sides
