"""The bodies of a recording cut open by a plane: which surfaces are cut, and what closes them."""

from collections.abc import Sequence

import numpy as np

from taichisoft.meshes import SectionPlane, closed_cap, cut_tetrahedra, split_triangles
from taichisoft_outputs.drawing.surface_painter import Section
from taichisoft_outputs.recording.bodies import RecordedSurface
from taichisoft_outputs.recording.reader import Recording


def cut_open(
    recording: Recording,
    surfaces: Sequence[RecordedSurface],
    frame: int,
    plane: SectionPlane,
    values: np.ndarray | None = None,
) -> Section:
    """Cut what moves and the obstacles, in one frame: silicone shows its elements' section, air and bodies are filled.

    Cables, and planes without an end, stay whole.

    Args:
        recording: the recording, which stays open.
        surfaces: its surfaces, or finer ones in their place.
        frame: the frame.
        plane: the plane, whose normal points to what is left out.
        values: values at the nodes of all soft bodies, which the section shows, shape (node_count,); or None.
    """
    caps = {}
    position = recording.row("position", frame)
    for body in recording.soft_bodies:
        at_nodes = position[body.nodes]
        height = plane.height(at_nodes)[body.tetrahedra]
        if values is not None:
            at_nodes = np.column_stack([at_nodes, values[body.nodes]])
        caps[body.name] = cut_tetrahedra(at_nodes[body.tetrahedra], height, plane.normal)[0]
    cut = [surface for surface in surfaces if surface.kind != "line"]
    for surface in cut:
        if surface.kind != "soft":
            corners = surface.vertices(frame)[surface.triangles]
            _, _, sides = split_triangles(corners, plane.height(corners))
            caps[surface.name] = closed_cap(sides, plane.normal)
    return Section(plane, frozenset(surface.name for surface in cut), caps)
