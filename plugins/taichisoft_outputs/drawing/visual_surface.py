"""A finer surface in place of a soft body's own: it is mapped onto the elements and moves with them."""

from pathlib import Path

import numpy as np

from taichisoft.bodies import embed, soft_surface
from taichisoft.meshes import MappedSurface, linear_parts, read_surface
from taichisoft_outputs.drawing.style import StyleError
from taichisoft_outputs.recording.bodies import RecordedSoftBody, RecordedSurface
from taichisoft_outputs.recording.reader import Recording


def with_visual_surfaces(recording: Recording, path: Path | None) -> list[RecordedSurface]:
    """The surfaces of a recording; a file replaces the surfaces of soft bodies.

    Args:
        recording: the recording, which stays open.
        path: file of a surface in the coordinates of the bodies' mesh files [mm]; None leaves all as they are.

    Raises:
        MeshError: the file is missing or unreadable.
        StyleError: the surface does not fit one of the soft bodies; the message says which.
    """
    if path is None:
        return list(recording.surfaces)
    vertices, triangles = read_surface(path)
    mapped: dict[bytes, MappedSurface] = {}  # often several bodies have one mesh
    surfaces = {}
    for body in recording.soft_bodies:
        mesh = body.mesh_nodes.tobytes()
        if mesh not in mapped:
            mapped[mesh] = _map(vertices, triangles, body, path)
        surfaces[body.name] = recording.follow(soft_surface(body.name, "soft", mapped[mesh], body.nodes))
    return [surfaces[surface.name] if surface.kind == "soft" else surface for surface in recording.surfaces]


def _map(vertices: np.ndarray, triangles: np.ndarray, body: RecordedSoftBody, path: Path) -> MappedSurface:
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
    return MappedSurface(*embed(vertices, body.mesh_nodes, linear_parts(body.elements)), triangles)
