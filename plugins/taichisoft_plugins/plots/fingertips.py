"""Where the tips of the fingers were and by how much the fingers were bent, as a controller would have observed it."""

import tomllib
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
from pydantic import ValidationError

from taichisoft.bodies.selection import select_nodes
from taichisoft.scenes.scene import SoftBody
from taichisoft_plugins.recording.layout import RecordingError
from taichisoft_plugins.recording.reader import RecordedSoftBody, Recording

MOST_FRAMES = 600
"""Of a long run only so many frames are looked at, evenly apart: each takes reading all positions."""


@dataclass(frozen=True)
class TipMotion:
    """The tips in some frames.

    Attributes:
        frames: which frames, shape (count,).
        names: of the fingers.
        positions: of the tips [mm], shape (count, finger_count, 3).
        bending_angles: [rad], shape (count, finger_count).
    """

    frames: np.ndarray
    names: tuple[str, ...]
    positions: np.ndarray
    bending_angles: np.ndarray


def tip_motion(recording: Recording) -> TipMotion:
    """Observe the tips of all fingers.

    Raises:
        RecordingError: the recording has no positions, or its scene is not understood.
    """
    from taichisoft.control.fingertips import Fingertips

    scene = tomllib.loads(recording.scene)["soft_bodies"] if recording.soft_bodies else {}
    tips = Fingertips(tuple(_finger(recording, body, scene[body.name]) for body in recording.soft_bodies))
    frames = np.unique(np.linspace(0, recording.frame_count - 1, MOST_FRAMES).astype(int))
    positions, bending_angles = np.zeros((len(frames), len(tips.names), 3)), np.zeros((len(frames), len(tips.names)))
    if tips.names:
        for index, frame in enumerate(frames):
            positions[index], _, bending_angles[index] = tips.observe(_state(recording, frame))
    return TipMotion(frames, tips.names, positions, bending_angles)


def _finger(recording: Recording, body: RecordedSoftBody, table: dict[str, Any]) -> Any:
    """What the engine needs to know of a soft body to find its tip."""
    try:
        settings = SoftBody.model_validate(table)
    except ValidationError as error:
        raise RecordingError(f"{recording.path}: its scene's body '{body.name}' is not understood: {error}") from error
    mesh = body.mesh(str(recording.path))
    anchor_stiffness = np.zeros(len(body.rest_position))
    for index, anchor in enumerate(settings.anchors):
        anchor_stiffness[select_nodes(mesh, anchor, f"{body.name}.anchors.{index}")] = anchor.stiffness
    return SimpleNamespace(
        name=body.name,
        nodes=body.nodes,
        rest_position=body.rest_position,
        anchor_stiffness=anchor_stiffness,
        tip_nodes=None if settings.tip is None else select_nodes(mesh, settings.tip, f"{body.name}.tip"),
    )


def _state(recording: Recording, frame: int) -> Any:
    """What the engine looks at; where velocities were not recorded none are needed here either."""
    position = recording.row("position", frame)
    return SimpleNamespace(
        position=position, velocity=np.zeros_like(position), base_rotation=recording.row("base_rotation", frame)
    )
