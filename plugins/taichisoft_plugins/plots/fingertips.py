"""Where the tips of the fingers were and by how much the fingers were bent, as a controller would have observed it."""

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from taichisoft.bodies.selection import anchor_stiffness, select_nodes
from taichisoft_plugins.recording.reader import RecordedSoftBody, Recording

MOST_FRAMES = 600
"""Most frames of a long run that are looked at, evenly apart: each takes reading all positions."""


@dataclass(frozen=True)
class TipMotion:
    """The tips in some frames.

    Attributes:
        frames: indices of the frames, shape (count,).
        names: names of the fingers.
        positions: positions of the tips [mm], shape (count, finger_count, 3).
        bending_angles: bending angles [rad], shape (count, finger_count).
    """

    frames: np.ndarray
    names: tuple[str, ...]
    positions: np.ndarray
    bending_angles: np.ndarray


def tip_motion(recording: Recording) -> TipMotion:
    """Observe the tips of all fingers."""
    from taichisoft.control.fingertips import Fingertips

    fingers: Any = tuple(_finger(recording, body) for body in recording.soft_bodies)
    tips = Fingertips(fingers)
    frames = np.unique(np.linspace(0, recording.frame_count - 1, MOST_FRAMES).astype(int))
    observed = [tips.observe(_state(recording, frame)) for frame in frames]
    positions, _, bending_angles = (np.array(values) for values in zip(*observed, strict=True))
    return TipMotion(frames, tips.names, positions, bending_angles)


def _finger(recording: Recording, body: RecordedSoftBody) -> SimpleNamespace:
    """The part of the engine's `SoftBody` that shows where the tip is."""
    settings, mesh = recording.scene.soft_bodies[body.name], body.mesh(str(recording.path))
    return SimpleNamespace(
        name=body.name,
        nodes=body.nodes,
        rest_position=body.rest_position,
        anchored=anchor_stiffness(mesh, settings.anchors, f"{body.name}.anchors").any(axis=1),
        tip_nodes=None if settings.tip is None else select_nodes(mesh, settings.tip, f"{body.name}.tip"),
    )


def _state(recording: Recording, frame: int) -> Any:
    """The part of a `State` that shows where the tips are; nobody looks at their velocities."""
    position, base_rotation = recording.row("position", frame), recording.row("base_rotation", frame)
    return SimpleNamespace(position=position, velocity=np.zeros_like(position), base_rotation=base_rotation)
