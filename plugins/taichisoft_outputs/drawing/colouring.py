"""The colours of the surfaces of a recording in its frames, before light falls on them.

Bodies have the colours of the scene, or soft bodies show displacement, stress or strain; actuators show their effort:
cavities the pressure, cables the tension.
"""

from collections.abc import Callable, Sequence

import numpy as np

from taichisoft.actuators import ACTUATOR_KINDS, ActuatorKind
from taichisoft.bodies import Stretches
from taichisoft.scenes import Scene, red_green_blue
from taichisoft_outputs.drawing.cable_tubes import LineTube
from taichisoft_outputs.drawing.scales import AIR, LINE, SOFT, ColourScale, round_up, sample_frames, scale_of
from taichisoft_outputs.drawing.style import Style
from taichisoft_outputs.recording.bodies import RecordedSurface
from taichisoft_outputs.recording.reader import Recording
from taichisoft_outputs.stress import nodal_mean, recorded_stress, von_mises

PLAIN = {
    "soft": (0.96, 0.93, 0.88),
    "cavity": (0.10, 0.52, 0.55),
    "rigid": (0.16, 0.33, 0.72),
    "obstacle": (0.62, 0.65, 0.69),
    "line": LINE[0],
}
"""Red, green and blue [-] by the kind of surface, of what has no colour of its own."""

SAMPLES = 40
"""Number of frames, at most, in which the range of a quantity is looked for."""
COVERED_SHARE = 0.995
"""Part of the values that the range covers: single elements at an edge would make all others look alike."""

NodeValues = Callable[[int], np.ndarray]
"""Gives the values at the nodes of all soft bodies in a frame, shape (node_count,)."""


def body_colours(scene: Scene) -> dict[str, np.ndarray]:
    """Red, green and blue [-], shape (3,), of each body or obstacle to which the scene gives a colour."""
    colours: dict[str, str | None] = {}
    for bodies in (scene.soft_bodies, scene.rigid_bodies, scene.obstacles):
        colours |= {name: body.colour for name, body in bodies.items()}
    return {name: np.array(red_green_blue(colour)) for name, colour in colours.items() if colour is not None}


class Colouring:
    """Gives every surface its colours.

    Args:
        recording: the recording, which stays open.
        style: what the user chose.
        frames: all frames that will be drawn.
        surfaces: all surfaces that will be drawn.

    Attributes:
        scales: what the colours mean.
    """

    def __init__(self, recording: Recording, style: Style, frames: Sequence[int], surfaces: Sequence[RecordedSurface]):
        self._recording, self._surfaces = recording, surfaces
        own = body_colours(recording.scene)
        self._plain = {surface.name: own.get(surface.name, np.array(PLAIN[surface.kind])) for surface in surfaces}
        self._scale: ColourScale | None = None
        if style.colour_by != "none":
            quantity, title = QUANTITIES[style.colour_by]
            self._values = quantity(recording)
            self._scale = ColourScale(title, 0.0, self._high_end(frames), SOFT)
        self._effort_scales: dict[str, ColourScale] = {}
        for kind in ACTUATOR_KINDS:
            shown = style.cavity_pressure and style.soft_opacity < 1.0 if kind.drawn == "walls" else style.cable_tension
            scale = _effort_scale(recording, kind, np.unique(frames)) if shown else None
            if scale is not None:
                self._effort_scales[kind.name] = scale
        self.scales = (*((self._scale,) if self._scale is not None else ()), *self._effort_scales.values())

    def colours(self, frame: int) -> dict[str, np.ndarray]:
        """Red, green and blue [-] by surface, shape (3,), or of each of its vertices, shape (vertex_count, 3)."""
        colours = dict(self._plain)
        for kind in ACTUATOR_KINDS:
            scale = self._effort_scales.get(kind.name)
            if scale is not None and kind.drawn == "walls":
                efforts = self._recording.row(kind.effort.name, frame)
                colours |= zip(self._recording.actuators.names_of(kind), scale.colours(efforts), strict=True)
            elif scale is not None:
                along = self._recording.segment_efforts(kind, frame)
                for tube in self._surfaces:
                    if isinstance(tube, LineTube) and tube.actuator == kind.name:
                        colours[tube.name] = scale.colours(tube.at_vertices(along[tube.number]))
        if self._scale is not None:
            values = self._values(frame)
            for surface in self._surfaces:
                if surface.kind == "soft" and surface.mapping is not None:
                    at_vertices = np.einsum("vk,vk->v", surface.mapping.weights, values[surface.mapping.nodes])
                    colours[surface.name] = self._scale.colours(at_vertices)
        return colours

    def _high_end(self, frames: Sequence[int]) -> float:
        samples = [self._values(frame) for frame in sample_frames(frames, SAMPLES)]
        values = [sample[body.nodes] for body in self._recording.soft_bodies for sample in samples]
        highest = max((float(np.quantile(some, COVERED_SHARE)) for some in values), default=0.0)
        return round_up(highest) if highest > 0 else 1.0


def displacement(recording: Recording) -> NodeValues:
    """Distance of each node from its place if the bodies had moved with their frames and kept their shape [mm]."""
    bodies = recording.soft_bodies
    carriers = recording.frames.numbers(recording.scene.soft_bodies[body.name].follows for body in bodies)

    def values(frame: int) -> np.ndarray:
        places = recording.frames.places(recording.row("frame_pose", frame))
        carried = [places.moved(body.rest_position, one) for body, one in zip(bodies, carriers, strict=True)]
        return np.linalg.norm(recording.row("position", frame) - np.vstack([np.zeros((0, 3)), *carried]), axis=1)

    return values


def stress(recording: Recording) -> NodeValues:
    """Von Mises stress at each node [kPa], the mean of the elements around it."""
    stresses = recorded_stress(recording)

    def values(frame: int) -> np.ndarray:
        of_bodies = [
            nodal_mean(von_mises(of_body), body.tetrahedra, body.rest_position)
            for body, of_body in zip(recording.soft_bodies, stresses(frame), strict=True)
        ]
        return np.concatenate([np.zeros(0), *of_bodies])

    return values


def strain(recording: Recording) -> NodeValues:
    """Largest principal strain at each node [-], the stretch less one: the mean of the elements around it."""
    laws = [Stretches(body.rest_position, body.elements) for body in recording.soft_bodies]

    def values(frame: int) -> np.ndarray:
        position = recording.row("position", frame)
        of_bodies = [
            nodal_mean(law.largest(position[body.nodes]) - 1.0, body.tetrahedra, body.rest_position)
            for law, body in zip(laws, recording.soft_bodies, strict=True)
        ]
        return np.concatenate([np.zeros(0), *of_bodies])

    return values


QUANTITIES = {
    "displacement": (displacement, "displacement [mm]"),
    "stress": (stress, "stress [kPa]"),
    "strain": (strain, "largest strain [-]"),
}


def _effort_scale(recording: Recording, kind: ActuatorKind, frames: np.ndarray) -> ColourScale | None:
    """The scale of the efforts of a kind; None where it has no actuators, or no effort but zero."""
    if not recording.actuators.names_of(kind):
        return None
    title = f"{kind.effort.words} [{kind.effort.unit}]"
    if kind.drawn == "walls":
        return scale_of(title, recording.column(kind.effort.name)[frames], AIR)
    return scale_of(title, np.concatenate(recording.segment_efforts(kind, frames), axis=1), LINE)
