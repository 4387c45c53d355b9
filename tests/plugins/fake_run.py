"""A made-up run for the tests of outputs: a soft tetrahedron with a cavity, and a rigid cube that rises.

`python fake_run.py FOLDER` records it for ever, until it is killed.
"""

import sys
import time
from itertools import count
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from taichisoft.bodies.elements import lame_parameters
from taichisoft.meshes.surface import MappedSurface
from taichisoft.meshes.volume_mesh import VolumeMesh
from taichisoft.scenes.scene import Scene
from taichisoft_plugins.recording.output import RecordingOutput

STEP = 0.01
RISE_AFTER = 5
"""The base stands still up to this step."""

REST = np.array([[0.0, 0.0, 0.0], [30.0, 0.0, 0.0], [0.0, 30.0, 0.0], [0.0, 0.0, 30.0]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
CUBE = np.array([[x, y, z] for x in (-5.0, 5.0) for y in (-5.0, 5.0) for z in (-5.0, 5.0)])
CUBE_FACES = np.array(
    [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ]
)  # fmt: skip


NO_CABLES = SimpleNamespace(names=(), all=(), pulls=lambda *_: np.zeros(0))


def fake_model(floor: bool = False) -> SimpleNamespace:
    """What outputs may know of a model."""
    scene = Scene.model_validate(
        {
            "gravity": [-9810.0, 0.0, 0.0],
            "time": {"step": STEP},
            "soft_bodies": {"finger": {"mesh": "a", "mass": 1, "young_modulus": 500, "poisson_ratio": 0.3}},
            "rigid_bodies": {"cube": {"box": [10, 10, 10], "mass": 0.001}},
        }
    )
    inner = 0.7 * np.eye(4) + 0.3 * np.full((4, 4), 0.25)
    cavity = MappedSurface(np.tile(np.arange(4), (4, 1)), inner, FACES)
    finger = SimpleNamespace(
        name="finger",
        mesh=VolumeMesh("a", REST, np.array([[0, 1, 2, 3]]), {"outer": FACES}, {"tip": np.array([0])}),
        nodes=slice(0, 4),
        material=np.zeros(1, dtype=np.int32),
        lame=lame_parameters(np.array([500.0]), np.array([0.3])),
        rest_position=REST,
        elements=np.array([[0, 1, 2, 3]]),
        surface=MappedSurface.of_nodes(FACES),
        cavities=(SimpleNamespace(name="finger.cavity", surface=cavity),),
    )
    plane = SimpleNamespace(
        name="floor",
        vertices=None,
        triangles=None,
        point=np.array([-1.0, 0, 0]),
        normal=np.array([1.0, 0, 0]),
    )
    return SimpleNamespace(
        scene=scene,
        base_pivot=np.zeros(3),
        material_names=("finger",),
        body_names=("finger", "cube", *(("floor",) if floor else ())),
        cavities=SimpleNamespace(names=("finger.cavity",)),
        cables=NO_CABLES,
        soft_bodies=(finger,),
        rigid_bodies=(SimpleNamespace(name="cube", vertices=CUBE, triangles=CUBE_FACES),),
        obstacles=(plane,) if floor else (),
    )


def fake_state(step: int) -> SimpleNamespace:
    """The state after `step` steps, with step % 3 contacts: every number depends on it."""
    lift = max(step - RISE_AFTER, 0) * 1.0
    turn = 0.01 * step
    contacts = step % 3
    return SimpleNamespace(
        time=step * STEP,
        step=step,
        position=REST + np.array([lift, 0.0, 0.0]),
        velocity=np.full((4, 3), float(step)),
        rigid_position=np.array([[lift, 30.0, 30.0]]),
        rigid_rotation=np.array([[np.cos(turn), np.sin(turn), 0.0, 0.0]]),
        rigid_velocity=np.zeros((1, 3)),
        rigid_angular_velocity=np.zeros((1, 3)),
        base_translation=np.array([lift, 0.0, 0.0]),
        base_rotation=np.zeros(3),
        base_request=np.full((2, 3), 0.1 * step),
        base_velocity=np.full((2, 3), 0.2 * step),
        anchor_position=REST[:2] + 0.3 * step,
        gravity=np.array([0.0, 0.0, -100.0 * step]),
        young_modulus=np.array([500.0 + step]),
        cavity_volume_imposed=np.array([step % 2 == 0]),
        cavity_request=np.array([3.0 * step]),
        cavity_target=np.array([2.5 * step]),
        cavity_pressure=np.array([2.0 * step]),
        cavity_volume=np.array([100.0 + step]),
        cable_pull_imposed=np.zeros(0, dtype=bool),
        cable_request=np.zeros(0),
        cable_target=np.zeros(0),
        cable_tension=np.zeros(0),
        cable_tension_loss=np.zeros(0),
        cable_length=np.zeros(0),
        pull_point=np.zeros((0, 3)),
        contact_body_pair=np.tile(np.array([0, 1], dtype=np.int32), (contacts, 1)),
        contact_point=np.full((contacts, 3), float(step)),
        contact_normal=np.tile([0.0, 0.0, 1.0], (contacts, 1)),
        contact_impulse=np.full((contacts, 3), -STEP * step),
        contact_slip=np.tile([0.5 * step, 0.0, 0.0], (contacts, 1)),
    )


def fake_report(step: int) -> SimpleNamespace:
    """The report of the step that led to `fake_state(step)`."""
    contacts = step % 3
    return SimpleNamespace(
        step=step,
        time=step * STEP,
        observation=SimpleNamespace(
            pressures={"finger.cavity": 2.0 * step},
            volumes={"finger.cavity": 100.0 + step},
            normal_forces={("cube", "finger"): 3.0 * step},
            friction_forces={("finger", "cube"): 1.0 * step},
            slip_speeds={("finger", "cube"): 0.5 * step},
            clipped=(),
        ),
        contact_count=contacts,
        contact_points=np.full((contacts, 3), float(step)),
        contact_forces=np.full((contacts, 3), -STEP * step) / STEP,
        max_penetration=0.1,
        iterations=step,
        residual=1e-6,
        converged=step % 2 == 0,
        inverted_elements=0,
        linearisations=1,
        newton_residual=None,
        signals={},
        step_time=0.02,
    )


def fake_run(outputs: list, steps: int, outcome: str = "completed", floor: bool = False) -> None:
    """Take the outputs through a run."""
    for output in outputs:
        output.begin(fake_model(floor), fake_state(0))
    for step in range(1, steps + 1):
        for output in outputs:
            output.record(fake_state(step), fake_report(step))
    for output in outputs:
        output.end(outcome)


if __name__ == "__main__":
    endless = RecordingOutput(Path(sys.argv[1]))
    endless.begin(fake_model(), fake_state(0))
    print("begun", flush=True)
    for number in count(1):
        endless.record(fake_state(number), fake_report(number))
        if number % 20 == 0:
            time.sleep(0.002)  # so that whoever reads it can keep up
