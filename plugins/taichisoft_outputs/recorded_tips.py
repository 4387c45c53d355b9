"""The tips of the fingers of a recording, as the controller of its run observed them."""

from collections.abc import Sequence
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from taichisoft.bodies import anchor_stiffness, select_nodes
from taichisoft_outputs.recording.reader import RecordedSoftBody, Recording

if TYPE_CHECKING:
    from taichisoft.control import Fingertips


def recorded_fingertips(recording: Recording, bodies: Sequence[RecordedSoftBody]) -> "Fingertips":
    """What observes the tips of some bodies of a recording; `tip_state` is what it looks at."""
    from taichisoft.control import Fingertips

    fingers: Any = tuple(_finger(recording, body) for body in bodies)
    return Fingertips(fingers, recording.frames)


def _finger(recording: Recording, body: RecordedSoftBody) -> SimpleNamespace:
    """The part of the engine's `SoftBody` that shows where the tip is."""
    settings, mesh = recording.scene.soft_bodies[body.name], body.mesh(str(recording.path))
    return SimpleNamespace(
        name=body.name,
        settings=settings,
        nodes=body.nodes,
        rest_position=body.rest_position,
        anchored=anchor_stiffness(mesh, settings.anchors, f"{body.name}.anchors").any(axis=1),
        tip_nodes=None if settings.tip is None else select_nodes(mesh, settings.tip, f"{body.name}.tip"),
    )


def tip_state(recording: Recording, frame: int) -> Any:
    """The part of a `State` that shows where the tips are; velocities are not used."""
    position, frame_pose = recording.row("position", frame), recording.row("frame_pose", frame)
    return SimpleNamespace(position=position, velocity=np.zeros_like(position), frame_pose=frame_pose)
