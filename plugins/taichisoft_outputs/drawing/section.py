"""The bodies of a recording cut open by a plane: which surfaces are cut, and what closes them."""

from collections.abc import Sequence

import numpy as np

from taichisoft.meshes import SectionPlane, closed_cap, cut_tetrahedra, split_triangles
from taichisoft_outputs.drawing.style import StyleError
from taichisoft_outputs.drawing.surface_painter import Section
from taichisoft_outputs.recording.bodies import RecordedSurface
from taichisoft_outputs.recording.reader import Recording


def refuse_what_cuts_nothing(section: str, points: np.ndarray) -> None:
    """Check that a plane, "y=0", has something on both sides.

    Args:
        section: the plane in words.
        points: vertices of all that is drawn [mm], shape (point_count, 3).

    Raises:
        StyleError: it has not.
    """
    height = SectionPlane.parse(section).height(points)
    if not height.min() < 0.0 < height.max():
        lower, upper = (np.round(end(points, axis=0), 1).tolist() for end in (np.min, np.max))
        raise StyleError(f"section '{section}' cuts nothing; what is drawn spans {lower} to {upper} mm")


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
