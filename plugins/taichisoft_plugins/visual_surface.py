"""A finer surface in place of a soft body's own: it is mapped onto the elements and moves with them."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from taichisoft.embedding import embed
from taichisoft.mapped_surface import MappedSurface
from taichisoft.surface_files import read_surface
from taichisoft_plugins.recording_reader import RecordedSoftBody, RecordedSurface, Recording
from taichisoft_plugins.style import StyleError

LARGEST_WEIGHT = 2.0
"""Of a node in a vertex [-]; a vertex further outside belongs to something else. On the surface it is 1."""


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
    nodes, weights = embed(vertices, body.mesh_nodes, body.elements)
    outside = int(np.count_nonzero(np.abs(weights).max(axis=1) > LARGEST_WEIGHT))
    if outside:
        raise StyleError(
            f"{path}: {outside} of {len(vertices)} vertices lie far outside the mesh of '{body.name}'; "
            "a surface must be in the coordinates of the body's mesh file, in mm"
        )
    return MappedSurface(nodes, weights, triangles)


def _moving(recording: Recording, body: RecordedSoftBody, surface: MappedSurface):  # type: ignore[no-untyped-def]
    return lambda frame: surface.positions(recording.row("position", frame)[body.nodes])
