"""Frames of a recording, for a page."""

import tomllib
from typing import Any

import numpy as np

from taichisoft_plugins.recording.reader import Recording
from taichisoft_plugins.web.frame import Cast, Frame, PagePlane, PageSurface


def cast_of(recording: Recording) -> Cast:
    """Who appears in a recording; what was not recorded is not plotted."""
    scene = tomllib.loads(recording.scene)
    bodies = [body.name for body in recording.rigid_bodies]
    gripped = scene.get("goal", {}).get("object", bodies[0] if bodies else None)
    if not (recording.has("normal_force") and recording.has("rigid_position")):
        gripped = None
    return Cast(
        title=scene.get("title", ""),
        up=recording.up,
        surfaces=tuple(PageSurface(s.name, s.kind, s.triangles) for s in recording.surfaces),
        planes=tuple(PagePlane(plane.name, plane.point, plane.normal) for plane in recording.planes),
        cavities=tuple(recording.cavities) if recording.has("pressure") else (),
        soft_bodies=tuple(surface.name for surface in recording.surfaces if surface.kind == "soft"),
        gripped=gripped,
        gripped_index=bodies.index(gripped) if gripped is not None else 0,
    )


def frame_of(recording: Recording, index: int) -> Frame:
    """A frame.

    Raises:
        RecordingError: positions were not recorded.
    """
    contacts = np.zeros((0, 3)), np.zeros((0, 3))
    if recording.has("contact_offset"):
        contacts = recording.contacts(index)
    return Frame(
        time=float(recording.row("time", index)),
        vertices=tuple(surface.vertices(index) for surface in recording.surfaces),
        rigid_position=_row(recording, "rigid_position", index, np.zeros((0, 3))),
        contact_points=contacts[0],
        contact_forces=contacts[1],
        pressures=_named(recording, "pressure", recording.cavities, index),
        normal_forces=_named(recording, "normal_force", recording.pairs, index),
    )


def _named(recording: Recording, quantity: str, names: list[str], index: int) -> dict[str, float]:
    """Values by name; a frame before the first step has none, which are zero to look at."""
    values = _row(recording, quantity, index, np.zeros(len(names)))
    return dict(zip(names, np.nan_to_num(values).tolist(), strict=True))


def _row(recording: Recording, quantity: str, index: int, otherwise: np.ndarray) -> Any:
    return recording.row(quantity, index) if recording.has(quantity) else otherwise
