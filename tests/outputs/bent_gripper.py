"""A made-up recording of the shipped gripper: nothing is simulated, the fingers are bent into arcs."""

from pathlib import Path
from types import SimpleNamespace

import fake_run
import numpy as np

from taichisoft import load_scene
from taichisoft.base.rotations import rotation_from_degrees
from taichisoft.mechanics.rigid_body_arrays import make_obstacle, make_rigid_body
from taichisoft.mechanics.soft_body_arrays import make_soft_body
from taichisoft.running.simulation import load_meshes
from taichisoft_outputs.recording.recording_output import RecordingOutput

LENGTH, INNER_SIDE = 115.0, 30.0
"""Of the shipped finger along -x, and the y of the side that it bends to [mm]."""

FRAMES = ((0.0, 0.0, 0.0), (0.45, 40.0, 0.0), (0.55, 50.0, 25.0))
"""Bend of the tips [rad], pressure [kPa] and height of cube and base [mm]."""


def gripper_model() -> SimpleNamespace:
    """What outputs may know of the gripper's model, without the engine."""
    scene = load_scene("gripper")
    bodies, node_count = [], 0
    meshes = load_meshes(scene)
    for name, body in scene.soft_bodies.items():
        first_material = list(scene.young_moduli).index(name)
        bodies.append(make_soft_body(name, body, meshes[name], node_count, first_material))
        node_count = bodies[-1].nodes.stop
    anchored = np.concatenate([body.rest_position[body.anchored] for body in bodies])
    return SimpleNamespace(
        scene=scene,
        material_names=tuple(scene.young_moduli),
        frames=fake_run.frames_of(anchored.mean(axis=0)),
        body_names=(*scene.soft_bodies, *scene.rigid_bodies, *scene.obstacles),
        actuators=fake_run.FakeActuators([cavity.name for body in bodies for cavity in body.cavities]),
        soft_bodies=tuple(bodies),
        rigid_bodies=tuple(make_rigid_body(name, body) for name, body in scene.rigid_bodies.items()),
        obstacles=tuple(make_obstacle(name, obstacle) for name, obstacle in scene.obstacles.items()),
    )


def bent(nodes: np.ndarray, angle: float) -> np.ndarray:
    """Nodes of a finger's mesh whose inner side is an arc of this angle [rad]."""
    if angle == 0.0:
        return nodes
    radius = LENGTH / angle
    along, outside = -nodes[:, 0] / radius, radius + INNER_SIDE - nodes[:, 1]
    return np.stack(
        [-outside * np.sin(along), INNER_SIDE + radius - outside * np.cos(along), nodes[:, 2]],
        axis=1,
    )


def gripper_state(model: SimpleNamespace, step: int) -> SimpleNamespace:
    """The state of one of FRAMES, with a force on the cube from each finger after the first."""
    angle, _, height = FRAMES[step]
    lift = np.array([height, 0.0, 0.0])
    state = fake_run.fake_state(step)
    placed = []
    for body in model.soft_bodies:
        turn = rotation_from_degrees(body.settings.rotation)
        placed.append(bent(body.mesh.nodes, angle) @ turn.T + np.array(body.settings.translation) + lift)
    cube = model.scene.rigid_bodies["cube"]
    middle = np.array(cube.position) + lift
    count = 3 if step else 0
    inwards = np.array([[0.1, 1.0, 0.0], [0.1, -0.7, -0.7], [0.1, -0.7, 0.7]])[:count]
    state.position = np.concatenate(placed)
    state.velocity = np.zeros_like(state.position)
    state.rigid_position, state.rigid_rotation = middle[None], np.array([[1.0, 0.0, 0.0, 0.0]])
    state.frame_pose = np.array([[lift, np.zeros(3)]])
    state.young_modulus = np.array(list(model.scene.young_moduli.values()))
    cavities = np.zeros(len(model.soft_bodies))
    state.actuator_imposed = cavities > 0
    state.actuator_request = state.actuator_target = state.actuator_value = cavities
    state.actuator_effort = cavities + FRAMES[step][1]
    state.contact_body_pair = np.tile(np.array([0, 1], dtype=np.int32), (count, 1))
    state.contact_point = middle - 21.0 * inwards
    state.contact_normal = inwards
    state.contact_impulse = 300.0 * inwards * model.scene.time.step
    state.contact_slip = np.zeros((count, 3))
    return state


def record_gripper(folder: Path) -> Path:
    """Write the recording of FRAMES and return its path."""
    model = gripper_model()
    output = RecordingOutput(folder)
    output.begin(model, gripper_state(model, 0))
    for step in range(1, len(FRAMES)):
        state, report = gripper_state(model, step), fake_run.fake_report(step)
        seen = report.observation.truth
        seen.normal_forces = seen.friction_forces = seen.slip_speeds = {}
        seen.contact_areas = seen.peak_pressures = {}
        report.contact_count = len(state.contact_body_pair)
        report.contact_points = state.contact_point
        report.contact_forces = state.contact_impulse / model.scene.time.step
        output.record(state, report)
    output.end("completed")
    return output.path
