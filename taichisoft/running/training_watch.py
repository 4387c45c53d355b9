"""The range of a reduced body's training, and warnings beyond it or above its tolerance."""

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from taichisoft.base.rotations import rotation_from_degrees
from taichisoft.contact.model import Model
from taichisoft.mechanics.model_actuators import ACTUATOR_KINDS
from taichisoft.mechanics.state import State
from taichisoft.mesh.surface import vertex_normals
from taichisoft.mesh.volume_mesh import boundary_triangles
from taichisoft.step.solution import StepReport

if TYPE_CHECKING:
    from taichisoft.mechanics.rigid_body_arrays import MovingFrames
    from taichisoft.mechanics.soft_body_arrays import SoftBody

# How far reduced bodies are beyond the amplitudes of their training, and the imbalance of their validation.

REACH = 0.1
"""Distance from a place that was pressed in the training, over the body's largest extent, up to which modes know dents:
the radius of what pressed there."""
ASKEW = 0.5
"""Least cosine between the surface's normals at both places."""


class TrainingRange:
    """What is known of the training and the validation of the reduced bodies of a model.

    Attributes:
        names: of the reduced bodies whose training is known.
        validated: of those whose validation measured how much error goes with an imbalance.
    """

    def __init__(self, bodies: "Sequence[SoftBody]", frames: "MovingFrames"):
        """Take the soft bodies of a model, and the frames that they follow."""
        self._bodies = [body for body in bodies if body.modes is not None and body.modes.amplitude_range is not None]
        self.names = tuple(body.name for body in self._bodies)
        self._frames, self._frame = frames, frames.numbers(body.settings.follows for body in self._bodies)
        modes = {body.name: body.modes for body in bodies if body.modes is not None}
        self._validation = {
            name: (known.imbalance, known.error_per_imbalance)
            for name, known in modes.items()
            if known.imbalance and known.error_per_imbalance is not None
        }
        self.validated = tuple(self._validation)
        pressed = [
            (number, body) for number, body in enumerate(bodies) if body.modes and body.modes.pressed is not None
        ]
        self._near_pressed = {number: _near_pressed(body) for number, body in pressed}
        self._soft_bodies = bodies
        self._turns = [rotation_from_degrees(body.settings.rotation) for body in self._bodies]
        self._weighted = []
        for body in self._bodies:
            assert body.modes is not None
            weighted = body.node_mass[:, None, None] * body.modes.modes
            self._weighted.append(weighted.reshape(-1, body.modes.mode_count))

    def amplitudes(self, number: int, state: "State") -> np.ndarray:
        """Amplitudes of one of the bodies in a state [mm sqrt(kg)], shape (mode_count,)."""
        body, frame, places = self._bodies[number], self._frame[number], self._frames.places(state.frame_pose)
        placed = (state.position[body.nodes] - places.shift[frame]) @ places.turn[frame]
        local = (placed - np.asarray(body.settings.translation)) @ self._turns[number]
        amplitudes: np.ndarray = (local - body.mesh.nodes).reshape(-1) @ self._weighted[number]
        return amplitudes

    def beyond(self, state: "State") -> dict[str, float]:
        """By body: displacement beyond the trained amplitudes over the largest one in the training [-], 0 within.

        Both are roots of the mean square over the body's mass, in which the modes are orthonormal.
        """
        shares = {}
        for number, body in enumerate(self._bodies):
            assert body.modes is not None and body.modes.amplitude_range is not None
            low, high = body.modes.amplitude_range.T
            amplitude = self.amplitudes(number, state)
            excess = np.maximum(np.maximum(low - amplitude, amplitude - high), 0.0)
            size = float(np.maximum(np.abs(low), np.abs(high)).max())
            shares[body.name] = float(np.linalg.norm(excess)) / max(size, np.finfo(float).tiny)
        return shares

    def pressed_elsewhere(self, state: "State") -> dict[str, np.ndarray]:
        """By body, the contact [mm] that presses most of those where nothing near by pressed in the training, (3,)."""
        from scipy.spatial import cKDTree  # a tenth of a start, for reduced bodies alone

        places = {}
        force = np.einsum("cd,cd->c", state.contact_impulse, state.contact_normal)
        for number, near in self._near_pressed.items():
            body = self._soft_bodies[number]
            mine = np.flatnonzero((force > 0.0) & (state.contact_body_pair == number).any(axis=1))
            nearest = cKDTree(state.position[body.nodes]).query(state.contact_point[mine])[1] if len(mine) else mine
            strange = mine[~near[nearest]]
            if len(strange):
                places[body.name] = state.contact_point[strange[force[strange].argmax()]]
        return places

    def beyond_validation(self, imbalance: Mapping[str, float]) -> dict[str, tuple[float, float]]:
        """By body: its imbalance over the largest one of its validation [-], and the error that goes with it [mm].

        Args:
            imbalance: by body, as in `StepReport.imbalance` [mm].
        """
        return {
            name: (imbalance[name] / largest, imbalance[name] * ratio)
            for name, (largest, ratio) in self._validation.items()
        }


def _near_pressed(body: "SoftBody") -> np.ndarray:
    """Whether a node is near one that something pressed in the training, on the same side, shape (node_count,)."""
    from scipy.spatial import cKDTree

    assert body.modes is not None and body.modes.pressed is not None
    nodes, pressed = body.mesh.nodes, np.flatnonzero(body.modes.pressed)
    normals = vertex_normals(nodes, boundary_triangles(body.mesh.elements[:, :4]))
    reach = REACH * float(np.ptp(nodes, axis=0).max())
    around = cKDTree(nodes[pressed]).query_ball_point(nodes, reach) if len(pressed) else [[]] * len(nodes)
    return np.array(
        [bool((normals[pressed[near]] @ normal > ASKEW).any()) for near, normal in zip(around, normals, strict=True)]
    )


# Warnings of reduced bodies whose error is not that of their validation: beyond their training, or above tolerance.

EVERY = 20
"""Steps between two checks: each takes half a step, for a product with all modes and for the forces on some nodes."""
MARGIN = 0.05
"""Displacement beyond the trained amplitudes, over the largest trained one, and effort beyond the trained ones, over
their range, up to which there is no warning."""
UNBALANCED = 1.5
"""Imbalance over the largest one of the validation, up to which there is no warning."""


class TrainingWatch:
    """Compares amplitudes with those of the training, and imbalances with those of the validation, at intervals."""

    def __init__(self, model: Model):
        """Prepare; without reduced bodies there is nothing to do."""
        self._model = model
        self._range = TrainingRange(model.soft_bodies, model.frames)
        reduced = [(body.name, body.modes) for body in model.soft_bodies if body.modes is not None]
        self._is_reduced = bool(reduced)
        self._trained = {
            f"{name}.{own}": drive for name, modes in reduced for own, drive in json.loads(modes.drives).items()
        }
        self._warned: set[tuple[str, str]] = set()

    def complaints_at_start(self) -> Iterator[str]:
        """A line for each reduced body whose validation found more than the tolerance."""
        for body in self._model.soft_bodies:
            modes = body.modes
            if modes is None or modes.error is None or modes.tolerance is None or modes.error <= modes.tolerance:
                continue
            yield (
                f"soft_bodies.{body.name}.reduced: its error of {100 * modes.error:.2g} % is above the tolerance of "
                f"{100 * modes.tolerance:.2g} % that was asked for; try more modes, or a wider training"
            )

    def complaints(self, state: State, report: StepReport) -> Iterator[str]:
        """Lines for each body that is beyond its training, or beyond its validation, for the first time."""
        if state.step % EVERY or not self._is_reduced:
            return
        for name, share in self._range.beyond(state).items():
            if share > MARGIN and self._is_new(name, "training"):
                yield (
                    f"'{name}' moves as it was not trained to at {state.time:.2f} s: {100 * share:.0f} % beyond the "
                    "amplitudes of the training: the validation's error no longer holds; metrics.json has the farthest"
                )
        for name, drive in self._driven_beyond(state) if self._trained else ():
            if self._is_new(name, "training"):
                yield (
                    f"'{name}' is driven as it was not trained to at {state.time:.2f} s: {drive}: modes do not know "
                    "what that does, and the validation's error no longer holds; `taichisoft reduce --range` trains it"
                )
        for name, (x, y, z) in self._range.pressed_elsewhere(state).items():
            if self._is_new(name, "places"):
                yield (
                    f"'{name}' is pressed at ({x:.1f}, {y:.1f}, {z:.1f}) mm at {state.time:.2f} s, where nothing "
                    "did in its training: modes have no dents there, and the validation says nothing of their error; "
                    "`--reduced-check` runs the full model beside it"
                )
        for name, (times, error) in self._range.beyond_validation(report.imbalance).items():
            if times > UNBALANCED and self._is_new(name, "validation"):
                yield (
                    f"'{name}' is {times:.1f} times as far from the full equations of motion as in its validation at "
                    f"{state.time:.2f} s: its error no longer holds, and is up to some {error:.1g} mm; "
                    "`--reduced-check` runs the full model beside it"
                )

    def _driven_beyond(self, state: State) -> Iterator[tuple[str, str]]:
        """Bodies with an actuator that is driven farther than in the training, and by how much."""
        actuators, coordinate = self._model.actuators, self._model.actuators.own_coordinates(state)
        for kind in ACTUATOR_KINDS:
            for drive, values in ((kind.effort, state.actuator_effort), (kind.coordinate, coordinate)):
                for name, value in zip(actuators.names_of(kind), actuators.of(kind, values).tolist(), strict=True):
                    key, low, high = self._trained.get(name, ("", 0.0, 0.0))
                    if key == drive.request and max(low - value, value - high) > MARGIN * (high - low):
                        yield (
                            name.partition(".")[0],
                            f"the {drive.words} of '{name}' is {value:.3g} {drive.unit}, trained from {low:.3g} "
                            f"to {high:.3g}",
                        )

    def _is_new(self, name: str, of: str) -> bool:
        new = (name, of) not in self._warned
        self._warned.add((name, of))
        return new
