"""Frames beside the base: where they are, what they carry, and what acts on them."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from conftest import Figures
from scenes import silicone
from scipy.spatial.transform import Rotation

from taichisoft import Control, Simulation
from taichisoft.errors import ControlError, SceneError
from taichisoft.scene import scene_from_dict

STEP = 0.01
WEIGHT = 9810.0
MARK = {"box": [2.0, 2.0, 2.0], "collides": False}


def simulate(**tables: Any) -> Simulation:
    return Simulation(scene_from_dict({"time": {"step": STEP}, **tables}))


def moved(pose: Any, pivot: Any, point: Any) -> np.ndarray:
    """A point turned by a rotation vector about a pivot, and shifted."""
    place: np.ndarray = Rotation.from_rotvec(pose[1]).apply(np.subtract(point, pivot)) + pivot + np.array(pose[0])
    return place


def test_a_frame_rides_on_the_one_that_it_follows(figures: Figures) -> None:
    """A hinge on a jaw on the base is where the three poses one after the other lead, at the end of every step."""
    pivots = {"jaw": [10.0, 0.0, 5.0], "lid": [20.0, 3.0, 0.0]}
    simulation = simulate(
        base_pivot=[0.0, 0.0, 40.0],
        frames={
            "lid": {"follows": "jaw", "pivot": pivots["lid"], "hinge": {"axis": [0.0, 2.0, 0.0]}},
            "jaw": {"follows": "base", "pivot": pivots["jaw"]},
        },
        rigid_bodies={"mark": {**MARK, "position": [25.0, 1.0, 2.0], "follows": "lid"}},
    )
    worst = 0.0
    for number in range(1, 20):
        base, jaw = (
            ([number, 2.0, 0.0], [0.0, 0.02 * number, 0.05]),
            ([0.0, 0.3 * number, 1.0], [0.1 * number, 0.0, 0.4]),
        )
        seen = simulation.step(
            Control(
                base_translation=np.array(base[0]),
                base_rotation=np.array(base[1]),
                frame_translation={"jaw": np.array(jaw[0])},
                frame_rotation={"jaw": np.array(jaw[1])},
                frame_angle={"lid": 0.5 * number},  # several turns
            )
        ).observation
        lid = ([0.0, 0.0, 0.0], [0.0, 0.5 * number, 0.0])
        place = moved(base, [0, 0, 40], moved(jaw, pivots["jaw"], moved(lid, pivots["lid"], [25.0, 1.0, 2.0])))
        worst = max(worst, float(np.abs(seen.object_positions["mark"] - place).max()))
        assert seen.frame_angles == {"lid": pytest.approx(0.5 * number, abs=1e-12)}
    figures.at_most("place of what the last frame carries [mm]", worst, 1e-12)


def test_a_servo_keeps_to_its_speed_and_its_stops() -> None:
    """30 degrees/s to the stop at 45 degrees, and back through 0 on the way of the angle, not on the shortest one."""
    hinge = {"axis": [0.0, 1.0, 0.0], "lowest_angle": -200.0, "highest_angle": 45.0}
    simulation = simulate(
        frames={"servo": {"hinge": hinge, "turning_speed": 3000.0}}, rigid_bodies={"mark": {**MARK, "follows": "servo"}}
    )
    angles, clipped = [], []
    for asked in (90.0, 90.0, 90.0, *[-190.0] * 9):
        seen = simulation.step(Control(frame_angle={"servo": np.radians(asked)})).observation
        angles.append(np.degrees(seen.frame_angles["servo"]))
        clipped.append("servo_rotation" in seen.clipped)
    expected = [30.0, 45.0, 45.0, 15.0, -15.0, -45.0, -75.0, -105.0, -135.0, -165.0, -190.0, -190.0]
    np.testing.assert_allclose(angles, expected, atol=1e-9)
    assert clipped == [angle not in (-190.0,) for angle in expected]


def test_a_belt_on_its_path_takes_a_cube_along(figures: Figures) -> None:
    """A cube that sticks to a belt moves as its path says; the belt bears the cube's weight and what speeds it up."""
    path = {"times": [0.2, 0.4, 0.6], "translations": [[0, 0, 0], [8.0, 0, 0], [8.0, 4.0, 0]]}
    simulation = simulate(
        contact={"friction": 0.9, "contact_distance": 0.2, "alarm_distance": 2.0},
        frames={"belt": {"path": path, "pivot": [7.0, 0.0, 0.0]}},
        rigid_bodies={
            "belt": {"box": [80.0, 80.0, 10.0], "position": [0.0, 0.0, -5.0], "follows": "belt"},
            "cube": {"box": [20.0, 20.0, 20.0], "mass": 0.05, "position": [0.0, 0.0, 10.2]},
        },
    )
    worst = 0.0
    for number in range(70):
        velocity = simulation.state.rigid_velocity[1]
        seen = simulation.step().observation
        time = (number + 1) * STEP
        expected = [np.interp(time, path["times"], axis) for axis in np.transpose(path["translations"])]
        np.testing.assert_allclose(seen.frame_translations["belt"], expected, atol=1e-12)
        change = (simulation.state.rigid_velocity[1] - velocity) / STEP
        bears = 0.05 * (np.array([0.0, 0.0, -WEIGHT]) - change)
        worst = max(worst, float(np.abs(seen.frame_forces["belt"] - bears).max()) / (0.05 * WEIGHT))
    figures.at_most("force on the belt against m (g - a) [of the weight]", worst, 1e-6)
    # 40 mm/s at once is more than friction gives in a step: 0.9 g h = 88 mm/s, so it does stick.
    figures.close("way of the cube [mm]", float(simulation.state.rigid_position[1, 0]), 8.0, 1e-3)
    with pytest.raises(ControlError, match=r"control.frame_translation\['belt'\]: this frame moves on its path"):
        simulation.step(Control(frame_translation={"belt": np.zeros(3)}))


def jaws(block: Callable[..., str], **tables: Any) -> Simulation:
    """Two soft pads on jaws that slide along x on the base, and a cube of 20 g between them."""
    mesh = block((2, 2, 2), (8.0, 20.0, 20.0))
    pads, frames = {}, {}
    for name, side in (("left", -1.0), ("right", 1.0)):
        back = {
            "box": [[-4.0, -10.0, -10.0], [-4.0, 10.0, 10.0]] if side < 0 else [[4.0, -10.0, -10.0], [4.0, 10.0, 10.0]]
        }
        pads[name] = silicone(mesh, translation=[15.0 * side, 0.0, 0.0], anchors=[back], follows=name)
        frames[name] = {"follows": "base", "speed": 20.0}
    return simulate(
        contact={"friction": 0.8, "contact_distance": 0.2, "alarm_distance": 2.0},
        frames=frames,
        soft_bodies=pads,
        rigid_bodies={"cube": {"box": [20.0, 20.0, 20.0], "mass": 0.02}},
        **tables,
    )


def test_parallel_jaws_lift_a_cube(block: Callable[..., str], figures: Figures) -> None:
    """Jaws close one by one to where they are asked to be, and hold a cube that the base lifts.

    In every step the force on the base is m (g - a) of all that hangs on it, and on each jaw what its pad bears; held
    at rest the jaws are pressed apart by equal forces.
    """
    simulation = jaws(block, gravity=[0.0, 0.0, 0.0])
    close = {"left": np.array([2.0, 0.0, 0.0]), "right": np.array([-2.0, 0.0, 0.0])}
    for _ in range(20):
        simulation.step(Control(frame_translation=close))
    assert simulation.model.elasticity is not None
    masses, worst = np.append(simulation.model.elasticity.node_mass, 0.02), 0.0
    lift, gravity = np.array([0.0, 0.0, 30.0]), np.array([0.0, 0.0, -WEIGHT])
    for number in range(30):
        before = np.vstack([simulation.state.velocity, simulation.state.rigid_velocity])
        motion = {"base_velocity": lift if number < 20 else 0.0 * lift}
        seen = simulation.step(Control(gravity=gravity, **motion)).observation  # type: ignore[arg-type]
        change = (np.vstack([simulation.state.velocity, simulation.state.rigid_velocity]) - before) / STEP
        bears = masses @ (gravity - change)
        worst = max(worst, float(np.abs(seen.base_force - bears).max()) / (masses.sum() * WEIGHT))
        np.testing.assert_allclose(sum(seen.frame_forces.values()), seen.base_force, atol=1e-9)
    figures.at_most("force on the base against the sum of m (g - a) [of the weight]", worst, 1e-6)
    assert simulation.state.rigid_position[0, 2] == pytest.approx(6.0, abs=0.5)
    assert seen.frame_forces["left"][0] == pytest.approx(-seen.frame_forces["right"][0], rel=0.01)
    assert seen.frame_forces["left"][0] < -100.0
    anchored = simulation.state.position[simulation.model.anchored_nodes]
    rest = simulation.model.rest_position[simulation.model.anchored_nodes] + 0.2 * lift
    shift = np.where(rest[:, :1] < 0.0, close["left"], close["right"])
    figures.at_most("anchored nodes against their jaws [mm]", float(np.abs(anchored - rest - shift).max()), 1e-6)


def test_what_springs_of_anchors_pull_is_the_wrench(block: Callable[..., str], figures: Figures) -> None:
    """Springs of 1000 mN/mm in the place of rigid anchors measure force and torque, in motion and with contacts.

    The equations hold at the end of the step; the torque of a single linearisation is off by what elements, taken at
    its start, have about nodes at its end.
    """
    anchor = {"box": [[-20.0, -5.0, -5.0], [-20.0, 5.0, 5.0]], "stiffness": 1000.0}
    for newton, bound in ((1, 0.01), (30, 1e-6)):
        beam = silicone(block((4, 1, 1), (40.0, 10.0, 10.0)), anchors=[anchor], follows="hand", rayleigh_stiffness=0.0)
        simulation = simulate(
            time={"step": STEP, "newton": newton, "newton_tolerance": 1e-9},
            frames={"hand": {"pivot": [-20.0, 0.0, 0.0]}},
            soft_bodies={"beam": beam},
            obstacles={"floor": {"plane": {"point": [0.0, 0.0, -6.5], "normal": [0.0, 0.0, 1.0]}}},
        )
        model, worst, touched = simulation.model, np.zeros(2), 0.0
        for number in range(15):
            turn = {
                "frame_angular_velocity": {"hand": np.array([0.5, 2.0, 0.2])},
                "frame_velocity": {"hand": np.ones(3)},
            }
            seen = simulation.step(Control(**turn)).observation  # type: ignore[arg-type]
            places = model.places(simulation.state)
            node = model.anchored_nodes
            stretch = simulation.state.position[node] - places.moved(model.rest_position[node], 1)
            arm = simulation.state.position[node] - model.frames.pivots(places)[1]
            wrench = 1000.0 * np.array([stretch.sum(axis=0), np.cross(arm, stretch).sum(axis=0)])
            found = np.array([seen.frame_forces["hand"], seen.frame_torques["hand"]])
            off = np.linalg.norm(wrench - found, axis=1) / np.linalg.norm(found, axis=1)
            worst = np.maximum(worst, off if number > 2 else 0.0)
            touched = max(touched, seen.normal_forces.get(("beam", "floor"), 0.0))
        assert touched > 10.0
        figures.at_most(f"force of the springs, newton = {newton} [relative]", float(worst[0]), 1e-6)
        figures.at_most(f"torque of the springs, newton = {newton} [relative]", float(worst[1]), bound)


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"frames": {"base": {}}}, "frames.base: every scene has this frame"),
        (
            {"frames": {"jaw": {"follows": "bas"}}},
            "frames.jaw.follows is 'bas', which is not a frame; there are: base, jaw",
        ),
        ({"frames": {"a": {"follows": "b"}, "b": {"follows": "a"}}}, "frames.a carries itself"),
        ({"frames": {"a": {"path": {"times": [0, 1], "translations": [[1, 0, 0], [0, 0, 0]]}}}}, "it must be 0"),
        ({"frames": {"a": {"path": {"times": [1, 1], "rotations": [[0, 0, 0]] * 2}}}}, "times must rise"),
        ({"frames": {"a": {"hinge": {"axis": [0, 0, 0]}}}}, "has no direction"),
        ({"frames": {"a": {"hinge": {"axis": [1, 0, 0], "lowest_angle": 5.0}}}}, "must not exceed 0"),
        ({"frames": {"a": {"hinge": {"axis": [1, 0, 0]}, "speed": 5.0}}}, "speed would have no effect beside hinge"),
    ],
)
def test_frames_that_make_no_sense_are_refused(tables: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        scene_from_dict({"rigid_bodies": {"mark": {**MARK, "follows": "base"}}, **tables})


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"frame_translation": {"jow": np.zeros(3)}}, "control.frame_translation: no frame is called 'jow'"),
        ({"frame_angle": {"jaw": 1.0}}, "this frame has no hinge"),
        ({"frame_rotation": {"lid": np.zeros(3)}}, "this frame turns about its hinge; ask for frame_angle"),
        ({"frame_angle": {"lid": np.nan}}, r"control.frame_angle\['lid'\] = nan: must be one finite number"),
        ({"frame_velocity": {"jaw": [1.0, 2.0]}}, "must be 3 finite numbers"),
        ({"frame_velocity": {"jaw": np.ones(3)}, "frame_translation": {"jaw": np.ones(3)}}, "are both given"),
        ({"base_velocity": np.ones(3), "frame_velocity": {"base": np.ones(3)}}, "are both given"),
        ({"frame_angle": [1.0]}, "control.frame_angle: must be a dictionary by name"),
    ],
)
def test_motions_that_make_no_sense_are_refused(asked: dict[str, Any], message: str) -> None:
    frames = {"jaw": {}, "lid": {"hinge": {"axis": [1, 0, 0]}}}
    simulation = simulate(frames=frames, rigid_bodies={"mark": {**MARK, "follows": "jaw"}})
    before = simulation.state
    with pytest.raises(ControlError, match=message):
        simulation.step(Control(**asked))
    assert simulation.state is before
