"""A made-up run for the tests of outputs: a soft tetrahedron with a cavity, and a rigid cube that rises.

`python fake_run.py FOLDER` records it for ever, until it is killed.
"""

import sys
import time
from collections.abc import Iterable, Sequence
from itertools import count
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from taichisoft import Scene, State, VolumeMesh
from taichisoft.mechanics import ACTUATOR_KINDS, ActuatorKind, ActuatorNames, MovingFrames
from taichisoft.mesh import MappedSurface
from taichisoft.scene import lame_parameters
from taichisoft_outputs import Recording
from taichisoft_outputs.recording.recording_output import RecordingOutput

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


class FakeActuators(ActuatorNames):
    """What outputs may know of the actuators of a model with cavities alone."""

    def __init__(self, cavities: Sequence[str]):
        super().__init__({"cavity": cavities})
        self.sets = {kind.name: SimpleNamespace(names=self.names_of(kind), lines=()) for kind in ACTUATOR_KINDS}

    def losses_of(self, kind: ActuatorKind, losses: np.ndarray) -> np.ndarray:
        return losses

    def own_coordinates(self, state: SimpleNamespace) -> np.ndarray:
        return np.zeros(len(self.names))


def frames_of(pivot: np.ndarray) -> MovingFrames:
    """The base alone."""
    return MovingFrames(("base",), np.array([-1]), pivot[None])


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
        modes=None,
        mesh=VolumeMesh("a", REST, np.array([[0, 1, 2, 3]]), {"outer": FACES}, {"tip": np.array([0])}),
        nodes=slice(0, 4),
        material=np.zeros(1, dtype=np.int32),
        lame=lame_parameters(np.array([500.0]), np.array([0.3])),
        rest_position=REST,
        elements=np.array([[0, 1, 2, 3]]),
        surface=MappedSurface.of_nodes(FACES),
        cavities=(SimpleNamespace(name="finger.cavity", surface=cavity),),
        reinforcement_surfaces=(),
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
        frames=frames_of(np.zeros(3)),
        material_names=("finger",),
        body_names=("finger", "cube", *(("floor",) if floor else ())),
        actuators=FakeActuators(("finger.cavity",)),
        soft_bodies=(finger,),
        rigid_bodies=(SimpleNamespace(name="cube", vertices=CUBE, triangles=CUBE_FACES),),
        obstacles=(plane,) if floor else (),
    )


class FakeState(SimpleNamespace):
    """The fields of a `State`, and what it derives from them."""

    base_translation, base_rotation = State.base_translation, State.base_rotation


def fake_state(step: int) -> FakeState:
    """The state after `step` steps, with step % 3 contacts: every number depends on it."""
    lift = max(step - RISE_AFTER, 0) * 1.0
    turn = 0.01 * step
    contacts = step % 3
    return FakeState(
        time=step * STEP,
        step=step,
        position=REST + np.array([lift, 0.0, 0.0]),
        velocity=np.full((4, 3), float(step)),
        rigid_position=np.array([[lift, 30.0, 30.0]]),
        rigid_rotation=np.array([[np.cos(turn), np.sin(turn), 0.0, 0.0]]),
        rigid_velocity=np.zeros((1, 3)),
        rigid_angular_velocity=np.zeros((1, 3)),
        frame_pose=np.array([[[lift, 0.0, 0.0], np.zeros(3)]]),
        frame_request=np.full((1, 2, 3), 0.1 * step),
        frame_velocity=np.full((1, 2, 3), 0.2 * step),
        frame_wrench=np.full((1, 2, 3), 0.7 * step),
        external_force=np.full((3, 3, 3), 0.6 * step),
        external_force_steps=np.array([step, 0, -1], dtype=np.int32),
        external_force_own_axes=np.array([step % 2 == 0, False, True]),
        anchor_position=REST[:2] + 0.3 * step,
        gravity=np.array([0.0, 0.0, -100.0 * step]),
        young_modulus=np.array([500.0 + step]),
        actuator_imposed=np.array([step % 2 == 0]),
        actuator_request=np.array([3.0 * step]),
        actuator_target=np.array([2.5 * step]),
        actuator_effort=np.array([2.0 * step]),
        actuator_value=np.array([100.0 + step]),
        actuator_loss=np.zeros(0),
        air_mass=np.array([1e-5 + 1e-6 * step]),
        tube_air_mass=np.array([1e-6 * step]),
        warm_air_space=np.array([300.0 + step]),
        air_flow=np.array([1e-4 * step]),
        valve_request=np.array([0.02 * step]),
        valve_opening=np.array([0.01 * step]),
        supply_pressure=np.array([20.0 + step]),
        delayed_requests=np.array([[0.03 * step, 0.04 * step]]),
        **{f"network_{key}": np.zeros(0) for key in ("pressure", "flow", "air_mass", "request", "target", "drive")},
        network_delayed=np.zeros((0, 0)),
        sensor_memory=np.zeros(0),
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
            truth=SimpleNamespace(
                pressures={"finger.cavity": 2.0 * step},
                volumes={"finger.cavity": 100.0 + step},
                air_masses={"finger.cavity": 1e-5 + 1e-6 * step},
                air_flows={"finger.cavity": 1e-4 * step},
                valve_openings={"finger.cavity": 0.01 * step},
                normal_forces={("cube", "finger"): 3.0 * step},
                friction_forces={("finger", "cube"): 1.0 * step},
                slip_speeds={("finger", "cube"): 0.5 * step},
                contact_areas={("cube", "finger"): 2.0 * step},
                peak_pressures={("finger", "cube"): 4.0 * step},
                **dict.fromkeys(
                    ("base_force", "base_torque", "base_force_in_base", "base_torque_in_base"), np.full(3, 0.7 * step)
                ),
                clipped=(),
            ),
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


def begun(output: Any, steps: Iterable[int] = (), floor: bool = False) -> Any:
    """An output that has taken the first state and these steps."""
    output.begin(fake_model(floor), fake_state(0))
    return make_steps(output, steps)


def make_steps(output: Any, steps: Iterable[int]) -> Any:
    """An output that has taken these further steps."""
    for step in steps:
        output.record(fake_state(step), fake_report(step))
    return output


def fake_run(outputs: list, steps: int, outcome: str = "completed", floor: bool = False) -> None:
    """Take the outputs through a run."""
    for output in outputs:
        output.begin(fake_model(floor), fake_state(0))
    for step in range(1, steps + 1):
        for output in outputs:
            make_steps(output, [step])
    for output in outputs:
        output.end(outcome)


def check_instant(recording: Recording, frame: int, step: int) -> None:
    """A frame of a recording is what came after a step: its whole state, or all but positions in single precision."""
    expected = State(**vars(fake_state(step)))
    if recording.has_state(frame):
        assert recording.state(frame) == expected, frame
    assert np.array_equal(recording.row("position", frame).astype(np.float32), expected.position.astype(np.float32))
    for field in ("step", "rigid_position", "frame_request", "anchor_position", "actuator_target"):
        assert State.changed(expected, **{field: recording.field(field, frame)}) == expected, (field, frame)
    assert np.array_equal(recording.contacts(frame)[0], expected.contact_point)


if __name__ == "__main__":
    endless = begun(RecordingOutput(Path(sys.argv[1])))
    print("begun", flush=True)
    for number in count(1):
        make_steps(endless, [number])
        if number % 20 == 0:
            time.sleep(0.002)  # so that whoever reads it can keep up
