"""Appearance: colours, axes and camera."""

import contextlib
import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from taichisoft.errors import SceneError
from taichisoft_sofa.components.draft import SceneDraft
from taichisoft_sofa.components.meshes import placed, read_loader, split_quads
from taichisoft_sofa.components.reading import computed, described, independent_state, mesh_of, node_of
from taichisoft_sofa.components.states import is_rigid, width_of
from taichisoft_sofa.components.topologies import surface_triangles
from taichisoft_sofa.tree.component import Component, component, without_effect
from taichisoft_sofa.tree.value_kinds import ANY, WrongValue, fixed, numbers

NAMED = {
    "white": "#ffffff",
    "black": "#000000",
    "red": "#ff0000",
    "green": "#00ff00",
    "blue": "#0000ff",
    "cyan": "#00ffff",
    "magenta": "#ff00ff",
    "yellow": "#ffff00",
    "gray": "#808080",
}
"""Colours by name."""


@component(
    "OglModel",
    "VisualModel",
    color=ANY,
    filename="",
    fileMesh="",
    fileTopology="",
    **dict.fromkeys(("scale", "scale3d", "rotation", "translation"), ANY),  # of a picture alone: any value is valid
    **without_effect("transformation"),
)
def visual_model(component: "Component", draft: "SceneDraft") -> None:
    """Translate the colour of a body, and the shape of one that is rigid; its opacity has no effect."""
    draft.visuals.append(component)
    colour, state = _colour(component, draft), independent_state(node_of(component))
    if state is None or width_of(state) == 1:
        return
    body = draft.carrier_of(component)
    if body is None:
        return
    if colour is not None:
        body.colours.append(colour)
    if is_rigid(state):
        body.shapes += visible_shapes([component])


def visible_shapes(components: "Sequence[Component]") -> list[tuple[np.ndarray, np.ndarray]]:
    """Points [mm] and triangles of the visual models whose shape can be read; a picture without it is no mistake."""
    found = []
    for model in components:
        with contextlib.suppress(SceneError):
            if len((shape := _shape(model))[1]):
                found.append(shape)
    return found


def _shape(component: "Component") -> tuple[np.ndarray, np.ndarray]:
    """Points [mm] and triangles of a visual model: those of a file, its source, or the nearest mesh in its node."""
    if component.read_text("filename", "fileMesh"):
        mesh = read_loader(component)
        points, triangles = mesh.points, np.vstack([mesh.triangles, split_quads(mesh.quads)])
    else:
        source = mesh_of(component)
        points, triangles = computed(source, "position", 3), surface_triangles(source)
    scale = component.read_vector("scale3d", default=[component.read_number("scale", default=1.0)] * 3)
    turn, shift = (component.read_vector(name, default=(0.0, 0.0, 0.0)) for name in ("rotation", "translation"))
    return placed(points, scale.tolist(), turn.tolist(), shift.tolist()), triangles


@component("BackgroundSetting", color=ANY)
def background(component: "Component", draft: "SceneDraft") -> None:
    """Translate the background colour; an image has no effect."""
    colour = _colour(component, draft)
    if colour is not None:
        draft.appearance["background"] = colour


@component("OglSceneFrame", draw=True)
def axes(component: "Component", draft: "SceneDraft") -> None:
    """Show the axes in a corner of pictures."""
    draft.appearance["frame"] = component.read_flag("draw")


@component("Camera", "InteractiveCamera", position=fixed(3), lookAt=fixed(3))
def camera(component: "Component", draft: "SceneDraft") -> None:
    """Translate the camera, if the scene gives `position` and `lookAt`."""
    eye, target = (component.read_numbers(name, default=()) for name in ("position", "lookAt"))
    if len(eye) == 3:
        draft.appearance["eye"] = eye.tolist()
        if len(target) == 3 and not np.array_equal(eye, target):
            draft.appearance["target"] = target.tolist()


def _colour(component: "Component", draft: "SceneDraft") -> str | None:
    """Colour of a component as "#rrggbb"; None without a valid one."""
    value = component.read_data("color")
    if value is None:
        return None
    colour = read_colour(value)
    if colour is None:
        draft.depart(f"{described(component)}: color = {value!r} is not a colour; it gets the usual one")
    return colour


def read_colour(value: Any) -> str | None:
    """Convert a colour of SOFA, a name, digits, or three or four numbers from 0 to 1, to "#rrggbb"; None if invalid.

    The opacity is ignored: pictures show soft bodies translucent, so that their interior is visible.
    """
    if isinstance(value, str):
        text = NAMED.get(value.strip().lower(), value.strip().lower())
        if re.fullmatch("#([0-9a-f]{3,4}|[0-9a-f]{6}|[0-9a-f]{8})", text):
            digits = text[1:] if len(text) > 5 else "".join(2 * digit for digit in text[1:])
            return f"#{digits[:6]}"
    try:
        parts = numbers(value)
    except WrongValue:
        return None
    if len(parts) not in (3, 4) or not np.isfinite(parts).all():
        return None
    red, green, blue = np.rint(255 * np.clip(parts[:3], 0.0, 1.0)).astype(int)
    return f"#{red:02x}{green:02x}{blue:02x}"
