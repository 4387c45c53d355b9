"""What a controller sees, against closed forms on a block that is moved by hand."""

import pickle
import re
from collections.abc import Callable, Mapping
from copy import copy, deepcopy
from dataclasses import fields, replace
from typing import get_type_hints

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from taichisoft import Control, Observation, Simulation
from taichisoft.errors import SceneError
from taichisoft.scene import scene_from_dict


def beam(block: Callable[..., str], **changes: object) -> dict:
    """A hollow bar along x from -50 to 50 mm, held at its lower end."""
    return {
        "mesh": block((10, 3, 3), (100.0, 10.0, 10.0), hollow=True),
        "mass": 0.01,
        "young_modulus": 500,
        "poisson_ratio": 0.3,
        "anchors": [{"box": [[-50, -5, -5], [-50, 5, 5]]}],
        "cavities": {"air": {"group": "cavity"}},
        "tactile": {"pad": {"box": [[0, -6, -6], [60, 6, 6]], "patches": [2, 1, 1]}},
        **changes,
    }


@pytest.fixture
def simulation(block: Callable[..., str]) -> Simulation:
    return Simulation(scene_from_dict({"gravity": [0, 0, 0], "soft_bodies": {"beam": beam(block)}}))


def test_a_tactile_array_beside_its_body_is_refused(block: Callable[..., str]) -> None:
    pad = {"pad": {"box": [[51, -6, -6], [60, 6, 6]], "patches": [2, 1, 1]}}
    scene = {"gravity": [0, 0, 0], "soft_bodies": {"beam": beam(block, tactile=pad)}}
    with pytest.raises(SceneError, match=r"beam\.tactile\.pad: no part of the surface .* from \[-50\.0, -5\.0"):
        Simulation(scene_from_dict(scene))


def seen(simulation: Simulation, position: np.ndarray, velocity: np.ndarray | None = None) -> Observation:
    """What is observed when the nodes are put somewhere."""
    velocity = np.zeros_like(position) if velocity is None else velocity
    simulation.restore(replace(simulation.state, position=position, velocity=velocity))
    return simulation.observe()


@pytest.mark.parametrize("duplicate", [copy, deepcopy, lambda one: pickle.loads(pickle.dumps(one))])
def test_an_observation_can_be_copied(simulation: Simulation, duplicate: Callable[[Observation], Observation]) -> None:
    """Read or not before, with the errors of its mappings, which stay read-only."""
    for read in (False, True):
        first = simulation.step(Control(pressure={"beam.air": 2.0})).observation
        seen = dict(first.volumes) if read else {}
        second = duplicate(first)
        assert second.volumes == first.volumes and (not seen or second.volumes == seen)
        assert second.pressures == {"beam.air": first.pressures["beam.air"]} and second.state == first.state
        np.testing.assert_array_equal(second.tip_positions["beam"], first.tip_positions["beam"])
        with pytest.raises(KeyError, match=r"did you mean 'beam\.air'"):
            second.volumes["beam.aar"]
        with pytest.raises(TypeError):
            second.volumes["beam.air"] = 0.0  # type: ignore[index]
    assert deepcopy(first).tip_positions["beam"] is not first.tip_positions["beam"]


def test_the_time_between_two_calls_of_the_controller_is_known() -> None:
    cube = {"box": [1.0] * 3, "mass": 1e-6}
    for controller, period in (({}, 0.01), ({"controller": {"name": "x", "period": 0.05}}, 0.05)):
        simulation = Simulation(scene_from_dict({"time": {"step": 0.01}, "rigid_bodies": {"cube": cube}} | controller))
        assert simulation.model.control_period == pytest.approx(period)
        assert simulation.observe().control_period == pytest.approx(period)


def test_the_tip_is_the_end_far_from_the_anchors(simulation: Simulation) -> None:
    rest = simulation.model.rest_position
    observation = seen(simulation, rest, np.full_like(rest, 3.0))
    np.testing.assert_allclose(observation.tip_positions["beam"], [50, 0, 0], atol=1e-9)
    np.testing.assert_allclose(observation.tip_velocities["beam"], [3, 3, 3], rtol=1e-12)
    assert observation.bending_angles["beam"] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("angle", [0.02, 0.7, 2.5])
def test_a_bar_bent_to_an_arc_has_the_angle_of_the_arc(simulation: Simulation, angle: float) -> None:
    """Constant curvature k = angle / length over the 100 mm: sections turn by k times their distance from the base."""
    x, y, z = simulation.model.rest_position.T
    turn, radius = angle * (x + 50.0) / 100.0, 100.0 / angle
    bent = np.column_stack([(radius - y) * np.sin(turn), radius - (radius - y) * np.cos(turn), z])
    assert seen(simulation, bent).bending_angles["beam"] == pytest.approx(angle, rel=1e-6)


def test_a_finger_that_turns_with_its_base_does_not_bend(simulation: Simulation) -> None:
    turn = np.array([0.3, -1.1, 0.4])
    turned = np.array([1.0, 2.0, 3.0]) + Rotation.from_rotvec(turn).apply(simulation.model.rest_position.copy())
    simulation.restore(replace(simulation.state, frame_pose=np.array([[np.zeros(3), turn]])))
    assert seen(simulation, turned).bending_angles["beam"] == pytest.approx(0.0, abs=1e-7)


def test_the_flow_is_the_rate_of_the_volume(simulation: Simulation) -> None:
    """V = V0 s^3 when everything grows by s: dV/dt = 3 V s' at s = 1."""
    rest = simulation.model.rest_position
    observation = seen(simulation, rest, 0.5 * rest)
    assert observation.flows["beam.air"] == pytest.approx(1.5 * observation.volumes["beam.air"], rel=1e-12)


def test_a_scene_may_select_the_tip(block: Callable[..., str]) -> None:
    body = beam(block, tip={"box": [[-1, -5, -5], [1, 5, 5]]})
    simulation = Simulation(scene_from_dict({"soft_bodies": {"beam": body}}))
    np.testing.assert_allclose(simulation.observe().tip_positions["beam"], [0, 0, 0], atol=1e-9)


def test_a_tip_on_a_line_cannot_be_seen_to_turn(block: Callable[..., str]) -> None:
    body = beam(block, tip={"box": [[-50, 5, 5], [50, 5, 5]]})
    with pytest.raises(SceneError, match=r"^soft_bodies\.beam\.tip: selects 11 nodes on a line; three or more"):
        Simulation(scene_from_dict({"soft_bodies": {"beam": body}}))


def test_a_body_without_anchors_has_no_tip(block: Callable[..., str]) -> None:
    simulation = Simulation(scene_from_dict({"soft_bodies": {"beam": beam(block, anchors=[])}}))
    assert simulation.observe().tip_positions == {}


@pytest.fixture
def sliding() -> Simulation:
    """A cube of 10 g that slides over a plane of friction 0.2 at 1000 mm/s along y."""
    cube = {"box": [20, 20, 20], "mass": 0.01, "position": [0, 0, 11], "velocity": [0, 1000, 0]}
    return Simulation(
        scene_from_dict(
            {
                "contact": {"friction": 0.2},
                "frames": {"hand": {}},
                "rigid_bodies": {"cube": cube},
                "obstacles": {"floor": {"plane": {"point": [0, 0, 0], "normal": [0, 0, 1]}}},
            }
        )
    )


def test_contacts_are_counted_and_their_forces_and_sliding_seen(sliding: Simulation) -> None:
    """The weight is 98.1 mN, friction 0.2 of it, and the cube loses 0.2 g h in a step."""
    sliding.step()
    observation = sliding.observe()
    assert observation.contact_counts == {("cube", "floor"): 4}
    assert observation.normal_forces["cube", "floor"] == pytest.approx(98.1, rel=1e-6)
    assert observation.friction_forces["cube", "floor"] == pytest.approx(0.2 * 98.1, rel=1e-6)
    assert observation.slip_speeds["cube", "floor"] == pytest.approx(1000.0 - 0.2 * 98.1, rel=1e-3)


def test_contacts_carry_their_bodies(sliding: Simulation) -> None:
    """Four corners stand on the floor; together the cube presses it down by its weight and drags it along."""
    report = sliding.step()
    assert report.contact_pairs == (("cube", "floor"),) * 4
    points, forces = (
        seen["cube", "floor"] for seen in (report.observation.contact_points, report.observation.contact_forces)
    )
    np.testing.assert_allclose(np.sort(points[:, 0]), [-10.0, -10.0, 10.0, 10.0], atol=1e-9)
    np.testing.assert_allclose(forces.sum(axis=0), [0.0, 0.2 * 98.1, -98.1], rtol=1e-6, atol=1e-6)


def test_points_and_forces_of_a_pair_are_its_own() -> None:
    """Two cubes on one floor: each has the contacts below it, which carry its weight."""
    cubes = {
        name: {"box": [20, 20, 20], "mass": mass, "position": [x, 0, 10.2]}
        for name, mass, x in (("left", 0.01, -50.0), ("right", 0.03, 50.0))
    }
    floor = {"plane": {"point": [0, 0, 0], "normal": [0, 0, 1]}}
    simulation = Simulation(scene_from_dict({"rigid_bodies": cubes, "obstacles": {"floor": floor}}))
    report = simulation.step()
    for name, mass, x in (("left", 0.01, -50.0), ("right", 0.03, 50.0)):
        seen, pair = report.observation, (name, "floor")
        assert seen.contact_points[pair][:, 0].mean() == pytest.approx(x)
        assert seen.contact_forces[pair][:, 2].sum() == pytest.approx(-9810.0 * mass, rel=1e-6)
        mine = [one == pair for one in report.contact_pairs]
        np.testing.assert_array_equal(report.contact_points[mine], seen.contact_points[pair])


def test_what_sticks_does_not_slip(sliding: Simulation) -> None:
    for _ in range(60):
        sliding.step()
    assert np.abs(sliding.state.rigid_velocity).max() < 1e-3
    assert sliding.observe().slip_speeds["cube", "floor"] < sliding.model.scene.contact.tolerance
    assert sliding.observe().contact_counts["cube", "floor"] == 4


def test_objects_are_seen_with_pose_and_velocity(sliding: Simulation) -> None:
    sliding.step()
    observation, state = sliding.observe(), sliding.state
    np.testing.assert_array_equal(observation.object_positions["cube"], state.rigid_position[0])
    np.testing.assert_array_equal(observation.object_rotations["cube"], state.rigid_rotation[0])
    np.testing.assert_array_equal(observation.object_velocities["cube"], state.rigid_velocity[0])
    np.testing.assert_array_equal(observation.object_angular_velocities["cube"], state.rigid_angular_velocity[0])


def arrays(observation: Observation) -> dict[str, np.ndarray]:
    """All arrays of an observation, by field and name."""
    found = {}
    for one in fields(observation):
        field, value = one.name, getattr(observation, one.name)
        values = value if isinstance(value, Mapping) else {"": value}
        found |= {f"{field} {name}": one for name, one in values.items() if isinstance(one, np.ndarray)}
    return found


def test_arrays_belong_to_the_observation_and_changing_them_changes_nothing_else(
    simulation: Simulation, sliding: Simulation
) -> None:
    """Whoever asks gets arrays that can be written to, since compiled functions refuse others: scipy's rotations do."""
    seen: set[str] = set()
    for one in (simulation, sliding):
        report = one.step()
        before = one.state.copy()
        for mine in (one.observe(), report.observation):
            unchanged = {key: values.copy() for key, values in arrays(one.observe()).items()}
            assert all(values.flags.writeable for values in arrays(mine).values())
            for values in arrays(mine).values():
                values += 1.0
            for key, values in arrays(one.observe()).items():
                np.testing.assert_array_equal(values, unchanged[key])
            seen |= unchanged.keys()
        assert one.state == before
    assert {key.split()[0] for key in seen} == {
        name for name, kind in get_type_hints(Observation).items() if "ndarray" in str(kind)
    }


@pytest.mark.parametrize("seen_or_asked", [Observation, Control])
def test_a_controller_has_one_unit_of_angle(seen_or_asked: type) -> None:
    """Every angle that it sees or asks for says that it is in radians; what is not in its own units names none."""
    text = " ".join((seen_or_asked.__doc__ or "").split("Attributes:")[1].split())
    described = dict(re.findall(r"(\w+): (.*?)(?= \w+: |$)", text))
    angles = [name for name in described if re.search("angle|angular|base_rotation", name)]
    assert len(angles) >= 2
    assert all("[rad]" in described[name] or "[rad/s]" in described[name] for name in angles)
    assert "degree" not in text


def test_rotations_are_taken_by_scipy(simulation: Simulation, sliding: Simulation) -> None:
    simulation.step(Control(base_rotation=np.array([0.0, 0.0, 0.1])))
    assert Rotation.from_rotvec(simulation.observe().base_rotation).magnitude() == pytest.approx(0.1)
    sliding.step()
    turning = Rotation.from_rotvec(sliding.observe().object_angular_velocities["cube"])
    assert turning.magnitude() == pytest.approx(0.0, abs=1e-6)


def test_the_base_is_seen_where_it_is_not_where_it_shall_be(block: Callable[..., str]) -> None:
    scene = {"gravity": [0, 0, 0], "soft_bodies": {"beam": beam(block)}, "limits": {"base_speed": 100.0}}
    simulation = Simulation(scene_from_dict(scene))
    simulation.step(Control(base_translation=np.array([10.0, 0, 0])))
    np.testing.assert_allclose(simulation.observe().base_translation, [1, 0, 0], rtol=1e-12)


def test_the_whole_state_is_seen_and_nothing_of_it_is_printed_or_copied(simulation: Simulation) -> None:
    """It is the simulation's own state, of which a controller can change nothing; what is printed stays short."""
    simulation.step(Control(pressure={"beam.air": 1.0}))
    observation = simulation.observe()
    assert observation.state is simulation.state
    assert replace(observation, step=7).state is simulation.state
    assert copy(observation).state is simulation.state
    with pytest.raises(ValueError, match="read-only"):
        observation.state.position[0] = 0.0
    assert "state=" not in repr(observation) and len(repr(observation)) < 2000
    assert "state=" not in repr(simulation.report) and len(repr(simulation.report)) < 2000


def test_a_report_that_is_kept_keeps_one_state_seen_or_not(simulation: Simulation) -> None:
    """An observation adds no memory for nodes to a report, and none to the state of the step after it."""
    reports = [simulation.step() for _ in range(3)]
    states = {id(report.observation.state) for report in reports}
    assert len(states) == 3
    assert all(report.observation is report.observation for report in reports)
    for report in reports:
        assert not any(isinstance(value, Observation) for value in vars(report.observation.state).values())
