"""Displacements from recordings that a user gives for the training."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from taichisoft import Scene
from taichisoft_reduction.body_shapes import BodyShape, RelativeMotion, shape_key
from taichisoft_reduction.errors import ReductionError
from taichisoft_reduction.run_request import RunResult

MOST_FRAMES = 200
"""Frames that are taken of a recording."""


def recorded_runs(paths: Sequence[Path], shapes: Sequence[BodyShape], scene: Scene) -> list[RunResult]:
    """The runs in recordings; the bodies of another scene count as well where they have the same mesh and material.

    Raises:
        ReductionError: a recording has no body of these shapes.
        RecordingError: one cannot be read.
    """
    from taichisoft_outputs.recording.reader import read_recording

    keys = {shape_key(scene.soft_bodies[shape.name]): shape.name for shape in shapes}
    found = []
    for path in paths:
        with read_recording(path) as recording:
            frames = np.unique(np.linspace(0, recording.frame_count - 1, MOST_FRAMES).astype(int))
            displacement: dict[str, list[np.ndarray]] = {}
            for body in recording.soft_bodies:
                settings = recording.scene.soft_bodies[body.name]
                name = keys.get(shape_key(settings))
                if name is None:
                    continue
                carrier = recording.frames.names.index(settings.follows)
                motion = RelativeMotion(body.mesh_nodes, settings.rotation, settings.translation)
                for frame in frames:
                    places = recording.frames.places(recording.row("frame_pose", frame))
                    position = recording.row("position", frame)[body.nodes]
                    displacement.setdefault(name, []).append(motion.displacement(position, places, carrier))
            if not displacement:
                names = ", ".join(shape.name for shape in shapes)
                raise ReductionError(
                    f"--runs {path}: no soft body has the mesh and material of {names}; record this scene"
                )
            arrays = {name: np.array(one) for name, one in displacement.items()}
            found.append(RunResult(str(path), "", np.zeros(0), arrays, {}))
    return found
