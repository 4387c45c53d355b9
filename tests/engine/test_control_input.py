"""What a controller may ask for, and what it is told otherwise."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from taichisoft import Control, Force, Simulation, State
from taichisoft.errors import ControlError
from taichisoft.scene import scene_from_dict


@pytest.fixture
def simulation(block: Callable[..., str]) -> Simulation:
    """Two hollow blocks held at one end."""
    body = {
        "mesh": block((3, 3, 3), (20.0, 20.0, 20.0), hollow=True),
        "mass": 0.01,
        "young_modulus": 500,
        "poisson_ratio": 0.3,
        "rayleigh_stiffness": 0.01,
        "anchors": [{"box": [[-10, -10, -10], [-10, 10, 10]]}],
        "cavities": {"air": {"group": "cavity"}},
    }
    region = {"box": [[0, -10, -10], [10, 10, 10]], "young_modulus": 1500}
    bodies = {"left": body, "right": {**body, "translation": [0, 100, 0], "regions": [region]}}
    return Simulation(scene_from_dict({"gravity": [0, 0, 0], "soft_bodies": bodies}))


@pytest.mark.parametrize(
    ("control", "message"),
    [
        (Control(pressure={"left": 1.0}), "control.pressure: no cavity is called 'left'; did you mean 'left.air'?"),
        (Control(pressure={"left.air\n\x1b[2J": 1.0}), "control.pressure: no cavity is called 'left.air\\n\\x1b[2J'"),
        (Control(volume_growth={"air": 1.0}), "control.volume_growth: no cavity is called 'air'"),
        (Control(pressure={"left.air": 1.0}, volume_growth={"left.air": 1.0}), "'left.air' is given a pressure and a"),
        (Control(pressure={"left.air": float("nan")}), "control.pressure['left.air'] = nan: must be one finite number"),
        (Control(volume_growth={"right.air": float("inf")}), "control.volume_growth['right.air'] = inf: must be one"),
        (Control(pressure={"left.air": "much"}), "control.pressure['left.air'] = 'much': must be a number"),
        (Control(pressure={"left.air": "5.0"}), "control.pressure['left.air'] = '5.0': must be a number"),
        (Control(pressure={"left.air": True}), "control.pressure['left.air'] = True: must be a number"),
        (Control(pressure={"left.air": np.True_}), "control.pressure['left.air'] = np.True_: must be a number"),
        (Control(base_translation=["1", "2", "3"]), "control.base_translation = ['1', '2', '3']: must be a number or"),
        (Control(signals={"set point": True}), "control.signals['set point'] = True: must be a number"),
        ({}, "control = {}: must be a taichisoft.Control"),
        (0, "control = 0: must be a taichisoft.Control"),
        (Control(pressure={"left.air": None}), "control.pressure['left.air'] = None: must be"),
        (Control(pressure={"left.air": [1.0, 2.0]}), "control.pressure['left.air'] = [1.0, 2.0]: must be one finite"),
        (Control(pressure={"left.air": np.array([1.0])}), "must be one finite number, not an array of shape (1,)"),
        (Control(base_translation=np.zeros(2)), "control.base_translation = array([0., 0.]): must be 3 finite numbers"),
        (Control(base_rotation=np.array([0, 0, np.nan])), "control.base_rotation = array([ 0.,  0., nan]): must be 3"),
        (Control(gravity=np.zeros(2)), "control.gravity = array([0., 0.]): must be 3 finite numbers"),
        (Control(anchor_positions={"lefd": np.ones((16, 3))}), "no soft body with anchors is called 'lefd'; did"),
        (Control(anchor_positions={"left": np.zeros((15, 3))}), "control.anchor_positions['left'] has shape (15, 3): "),
        (Control(anchor_positions={"left": np.full((16, 3), np.nan)}), "has a number that is not finite"),
        (Control(anchor_positions={"left": "up"}), "control.anchor_positions['left'] = 'up': must be"),
        (Control(young_modulus={"left.air": 600.0}), "control.young_modulus: no material is called 'left.air'"),
        (Control(young_modulus={"left": 0.0}), "control.young_modulus['left'] = 0.0: must be above 0"),
        (Control(young_modulus={"left": -500}), "control.young_modulus['left'] = -500: must be above 0"),
        (Control(young_modulus={"right.regions.0": float("inf")}), "['right.regions.0'] = inf: must be one finite"),
        (Control(young_modulus={"right": float("nan")}), "control.young_modulus['right'] = nan: must be one finite"),
        (Control(young_modulus={"left.regions.0": 1.0}), "no material is called 'left.regions.0'; did you mean 'right"),
        (Control(young_modulus=600.0), "by name, not float, such as {'left': 600.0}"),
        (Control(pressure=10.0), "must be a dictionary by name, not float, such as {'left.air': 10.0}"),
        (Control(pressure=np.array([10.0])), "not ndarray, such as {'left.air': ...}"),
        (Control(cable_pull=2), "control.cable_pull: must be a dictionary by name, not int"),
        (Control(forces={"lefd": Force()}), "control.forces: no body or frame is called 'lefd'; did you mean 'left'?"),
        (Control(forces={"base": [0, 0, 1]}), "control.forces['base'] = [0, 0, 1]: must be None or a taichisoft.Force"),
        (Control(forces=Force([0.0, 0.0, 1.0])), "control.forces: must be a dictionary by name, not Force"),
        (Control(forces={"base": Force([0.0, 1.0])}), "control.forces['base'].force = [0.0, 1.0]: must be 3 finite"),
        (Control(forces={"base": Force(torque=[0, 0, np.nan])}), "['base'].torque = [0, 0, nan]: must be 3 finite"),
        (Control(forces={"base": Force(np.zeros((2, 3)))}), "must be 3 finite numbers, not an array of shape (2, 3)"),
        (Control(forces={"base": Force(point="tip")}), "control.forces['base'].point = 'tip': must be a number or an"),
        (Control(forces={"base": Force(axes="own ")}), "control.forces['base'].axes = 'own ': must be"),
        (Control(forces={"base": Force(axes=np.eye(2))}), "must be 'world' or 'own'"),
        (Control(forces={"base": Force([0.0, 0.0, -1e16])}), "control.forces['base']: has a number above 1e+15, which"),
        (Control(forces={"base": Force(steps=0)}), "control.forces['base'].steps = 0: must be a whole number"),
        (Control(forces={"base": Force(steps=2.0)}), "['base'].steps = 2.0: must be a whole number of time steps"),
        (Control(forces={"base": Force(steps=True)}), "['base'].steps = True: must be a whole number of time steps"),
        (Control(forces={"base": Force(steps=2**31)}), "['base'].steps = 2147483648: must be a whole number of time"),
        (Control(forces={"left": Force([1, 0, 0])}), "control.forces['left'].point: a soft body needs one, a place at"),
        (Control(forces={"left": Force(torque=[1, 0, 0], point=[10, 0, 0])}), "['left'].torque: a point of a"),
        (Control(forces={"left": Force(point=[0, 0, 0])}), "['left'].point = [0.0, 0.0, 0.0]: lies 5.77 mm outside;"),
        (Control(forces={"left": Force(point=[0, 90, 0])}), "and the body spans [-10.0, -10.0, -10.0] to [10.0,"),
        (Control(anchor_positions=np.ones((16, 3))), "control.anchor_positions: must be a dictionary by name, not nd"),
    ],
)  # fmt: skip
def test_the_impossible_is_refused_and_nothing_has_changed(
    simulation: Simulation, control: Control, message: str
) -> None:
    before = simulation.state.copy()
    with pytest.raises(ControlError) as refused:
        simulation.step(control)
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)
    assert simulation.state == before


def test_unknown_names_get_nearest_ones(simulation: Simulation) -> None:
    seen: Any = simulation.observe()
    state: Any = simulation.state
    for use, error, message in (
        (lambda: Control(**{"presure": {}}), TypeError, "Control has no 'presure'; did you mean 'pressure'?"),
        (lambda: Force(**{"torqe": [0, 0, 1]}), TypeError, "Force has no 'torqe'; did you mean 'torque'?"),
        (lambda: seen.tip_position, AttributeError, "an Observation has no 'tip_position'; did you mean 'tip_positio"),
        (lambda: seen.pressures["left.iar"], KeyError, "'left.iar'; did you mean 'left.air'?"),
        (lambda: seen.tip_positions["up"], KeyError, "'up'; there are: left, right"),
        (lambda: state.object_rotations, AttributeError, "a State has no 'object_rotations': simulation.observe() has"),
    ):
        with pytest.raises(error, match=re.escape(message)):
            use()


def test_representations_have_ten_lines_at_most(simulation: Simulation) -> None:
    report = simulation.step(Control(pressure={"left.air": 1.0}))
    for thing in (simulation, simulation.state, report, report.observation):
        shown = repr(thing)
        assert shown.startswith(f"{type(thing).__name__}(") and len(shown.splitlines()) <= 10
        assert max(map(len, shown.splitlines())) <= 130
    assert "left.air': 1" in repr(report.observation) and "array[" in repr(simulation.state)


def test_what_is_not_mentioned_keeps_its_last_value(simulation: Simulation) -> None:
    translation, rotation = np.array([1.0, 2.0, 3.0]), np.array([0.1, 0.0, 0.0])
    simulation.step(Control(pressure={"left.air": 3.0}, base_translation=translation, base_rotation=rotation))
    report = simulation.step(Control(pressure={"right.air": 4.0}))
    assert report.observation.pressures == pytest.approx({"left.air": 3.0, "right.air": 4.0}, rel=1e-12)
    np.testing.assert_array_equal(simulation.state.base_translation, translation)
    np.testing.assert_array_equal(simulation.state.base_rotation, rotation)
    translation[:] = 99.0
    assert simulation.state.base_translation[0] == 1.0  # the state keeps a copy


def test_a_cavity_changes_from_pressure_to_volume_and_back(simulation: Simulation) -> None:
    """Volumes in a report are those at the start of a step; the linearised volume reaches the target in one."""
    simulation.step(Control(volume_growth={"left.air": 10.0}))
    for _ in range(60):
        report = simulation.step()
    rest = simulation.model.cavities.rest_value[0]
    assert report.observation.volumes["left.air"] - rest == pytest.approx(10.0, abs=1e-6)
    assert report.observation.pressures["left.air"] > 0.1
    assert report.observation.pressures["right.air"] == 0.0
    report = simulation.step(Control(pressure={"left.air": 0.0}))
    assert report.observation.pressures["left.air"] == 0.0


def test_the_base_carries_its_anchors(simulation: Simulation) -> None:
    """Moved and turned about the pivot, which is the mean of the anchored nodes; reached when the body has settled."""
    turn = np.array([0.0, 0.0, np.pi / 2])
    for _ in range(40):
        simulation.step(Control(base_translation=np.array([5.0, 0.0, 0.0]), base_rotation=turn))
    for _ in range(200):
        simulation.step()
    model, anchored = simulation.model, simulation.model.anchored_nodes
    np.testing.assert_allclose(model.base_pivot, [-10, 50, 0], atol=1e-12)
    arm = model.rest_position[anchored] - model.base_pivot
    turned = np.column_stack([-arm[:, 1], arm[:, 0], arm[:, 2]]) + model.base_pivot + [5, 0, 0]
    np.testing.assert_allclose(simulation.state.position[anchored], turned, atol=1e-3)


def anchored(simulation: Simulation) -> np.ndarray:
    return simulation.state.position[simulation.model.anchored_nodes]


def test_anchors_are_put_node_by_node(simulation: Simulation) -> None:
    """Those of one body turned and stretched, each to a place of its own; those of the other stay where they are."""
    rest = simulation.state.anchor_position.copy()
    assert rest.shape == (32, 3)
    np.testing.assert_array_equal(rest, anchored(simulation))
    arm = rest[16:] - [-10, 100, 0]
    places = np.column_stack([arm[:, 0], -1.2 * arm[:, 2], 1.1 * arm[:, 1]]) + np.array([-9, 100, 2])
    simulation.step(Control(anchor_positions={"right": places}))
    for _ in range(300):
        simulation.step()
    np.testing.assert_allclose(anchored(simulation)[16:], places, atol=1e-6)
    np.testing.assert_allclose(anchored(simulation)[:16], rest[:16], atol=1e-6)
    places[:] = 999.0
    assert simulation.state.anchor_position.max() < 999.0  # the state keeps a copy


def test_the_base_moves_anchors_on_from_where_they_were_put(simulation: Simulation) -> None:
    """A shift of the anchors, then a turn of the base by 90 degrees about z and its pivot (-10, 50, 0)."""
    rest = simulation.state.anchor_position
    control = Control(
        anchor_positions={"left": rest[:16] + np.array([0.0, 2.0, 1.0])}, base_rotation=np.array([0.0, 0.0, np.pi / 2])
    )
    for _ in range(40):
        simulation.step(control)
    for _ in range(300):
        simulation.step()
    arm = rest[:16] + np.array([0.0, 2.0, 1.0]) - [-10, 50, 0]
    turned = np.column_stack([-arm[:, 1], arm[:, 0], arm[:, 2]]) + np.array([-10, 50, 0])
    np.testing.assert_allclose(anchored(simulation)[:16], turned, atol=1e-3)


def test_a_shift_of_all_anchors_is_a_translation_of_the_base(simulation: Simulation) -> None:
    """One is as good as the other but for round-off, which the springs of 1e12 mN/mm turn into nanometres."""
    shift, rest = np.array([1.0, -2.0, 0.5]), simulation.state.anchor_position
    other = Simulation(simulation.model)
    other.step(Control(base_translation=shift))
    simulation.step(Control(anchor_positions={"left": rest[:16] + shift, "right": rest[16:] + shift}))
    for _ in range(20):
        simulation.step()
        other.step()
    np.testing.assert_allclose(simulation.state.position, other.state.position, atol=1e-6)


def test_gravity_changes_how_bodies_fall(block: Callable[..., str]) -> None:
    """A rigid cube and a soft block gain h g in a step, and keep their velocity when gravity goes."""
    body = {"mesh": block((1, 1, 1), (5.0, 5.0, 5.0)), "mass": 0.01, "young_modulus": 500, "poisson_ratio": 0.3}
    cube = {"box": [5.0, 5.0, 5.0], "mass": 0.01, "position": [50.0, 0.0, 0.0]}
    simulation = Simulation(scene_from_dict({"soft_bodies": {"block": body}, "rigid_bodies": {"cube": cube}}))
    for step, gravity in enumerate([None, [0.0, 500.0, 0.0], None, [0.0, 0.0, 0.0], None]):
        simulation.step(Control(gravity=None if gravity is None else np.array(gravity)))
        speed = [0.0, 5.0 * min(step, 2), -98.1]
        np.testing.assert_allclose(simulation.state.rigid_velocity, [speed], atol=1e-9)
        np.testing.assert_allclose(simulation.state.velocity.mean(axis=0), speed, atol=1e-6)


def test_a_run_goes_on_from_anchors_and_gravity_that_were_set(simulation: Simulation, tmp_path: Path) -> None:
    places = simulation.state.anchor_position[:16] + np.array([0.0, 1.0, 0.0])
    simulation.step(Control(anchor_positions={"left": places}, gravity=np.array([0.0, -100.0, 0.0])))
    simulation.state.save(tmp_path / "state.npz")
    other = Simulation(simulation.model)
    other.step()
    other.restore(State.load(tmp_path / "state.npz"))
    for _ in range(5):
        simulation.step()
        other.step()
    assert other.state == simulation.state


def test_the_observation_is_what_the_report_says_and_cannot_be_written(simulation: Simulation) -> None:
    before = simulation.observe()
    assert (before.time, before.step, before.pressures) == (0.0, 0, {"left.air": 0.0, "right.air": 0.0})
    report = simulation.step(Control(pressure={"left.air": 3.0}))
    seen = simulation.observe()
    assert (seen.time, seen.step) == (0.01, 1)
    assert seen.pressures == report.observation.pressures
    assert seen.volumes == report.observation.volumes
