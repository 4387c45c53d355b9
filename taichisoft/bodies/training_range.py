"""How far reduced bodies are beyond the amplitudes of their training, and the imbalance of their validation."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from taichisoft.bodies.rotations import rotation_from_degrees
from taichisoft.meshes.smooth_normals import vertex_normals
from taichisoft.meshes.volume_mesh import boundary_triangles

if TYPE_CHECKING:
    from taichisoft.bodies.moving_frames import MovingFrames
    from taichisoft.bodies.soft_body_arrays import SoftBody
    from taichisoft.state import State


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
            name: (one.imbalance, one.error_per_imbalance)
            for name, one in modes.items()
            if one.imbalance and one.error_per_imbalance is not None
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
        found: np.ndarray = (local - body.mesh.nodes).reshape(-1) @ self._weighted[number]
        return found

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

        found = {}
        force = np.einsum("cd,cd->c", state.contact_impulse, state.contact_normal)
        for number, near in self._near_pressed.items():
            body = self._soft_bodies[number]
            mine = np.flatnonzero((force > 0.0) & (state.contact_body_pair == number).any(axis=1))
            nearest = cKDTree(state.position[body.nodes]).query(state.contact_point[mine])[1] if len(mine) else mine
            strange = mine[~near[nearest]]
            if len(strange):
                found[body.name] = state.contact_point[strange[force[strange].argmax()]]
        return found

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
        [bool((normals[pressed[some]] @ normal > ASKEW).any()) for some, normal in zip(around, normals, strict=True)]
    )
