"""A finer surface in place of a soft body's own: it is mapped onto the elements and moves with them."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from taichisoft.bodies.embedding import embed
from taichisoft.meshes.surface import MappedSurface
from taichisoft.meshes.surface_files import read_surface
from taichisoft_plugins.drawing.style import StyleError
from taichisoft_plugins.recording.reader import RecordedSoftBody, RecordedSurface, Recording


def with_visual_surfaces(recording: Recording, path: Path | None) -> list[RecordedSurface]:
    """The surfaces of a recording, those of soft bodies replaced with that of the file where one is given.

    Args:
        recording: stays open.
        path: a surface in the coordinates of the bodies' mesh files [mm]; None leaves all as they are.

    Raises:
        MeshError: the file is missing or unreadable.
        StyleError: it does not fit one of the soft bodies; says which.
        RecordingError: an older version wrote the recording, without the meshes.
    """
    if path is None:
        return list(recording.surfaces)
    vertices, triangles = read_surface(path)
    made: list[tuple[np.ndarray, MappedSurface]] = []
    surfaces = {}
    for body in recording.soft_bodies:
        mapped = next((surface for nodes, surface in made if np.array_equal(nodes, body.mesh_nodes)), None)
        if mapped is None:
            mapped = _mapped(vertices, triangles, body, path)
            made.append((body.mesh_nodes, mapped))
        surfaces[body.name] = _moving(recording, body, mapped)
    return [
        replace(surface, triangles=triangles, vertices=surfaces[surface.name]) if surface.kind == "soft" else surface
        for surface in recording.surfaces
    ]


def _mapped(vertices: np.ndarray, triangles: np.ndarray, body: RecordedSoftBody, path: Path) -> MappedSurface:
    from scipy.spatial import cKDTree

    corners = body.mesh_nodes[body.elements[:, :4]]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max()
    distance, _ = cKDTree(body.mesh_nodes).query(vertices)
    outside = int(np.count_nonzero(distance > longest))
    if outside:
        raise StyleError(
            f"{path}: {outside} of {len(vertices)} vertices lie further from the mesh of '{body.name}' than an element "
            "is long; a surface must be in the coordinates of the body's mesh file, in mm"
        )
    return MappedSurface(*embed(vertices, body.mesh_nodes, body.elements), triangles)


def _moving(recording: Recording, body: RecordedSoftBody, surface: MappedSurface):  # type: ignore[no-untyped-def]
    return lambda frame: surface.positions(recording.row("position", frame)[body.nodes])
