"""An arm's joints as actions of an environment: the base is where they bring it."""

from typing import Any

import numpy as np
import pytest
from arms import STANDING

from taichisoft import Scene, load_scene
from taichisoft.errors import SceneError
from taichisoft.pytest_fixtures import TINY_GRIPPER

pytest.importorskip("gymnasium", reason="needs the extra 'gym'")
pytest.importorskip("yourdfpy", reason="needs the extra 'arm'")

from taichisoft_arm.mounted_arm import motion_of_base
from taichisoft_gym import ArmTravel, SoftRobotEnvironment

PERIOD = 0.05


def carried() -> Scene:
    scene = load_scene(TINY_GRIPPER).model_dump(exclude_unset=True)
    return Scene.model_validate({**scene, "controller": {"name": "arm", "settings": STANDING}, "limits": {}})


class Follow(SoftRobotEnvironment):
    """A task whose reward nobody looks at."""

    usual_pressure = (0.0, 10.0)
    travel = ArmTravel(share=0.2)
    observations = ("actuators", "base", "joints")

    def reward(self, seen: Any) -> float:
        return 0.0


@pytest.fixture(scope="module")
def follow() -> Follow:
    return Follow(scene=carried(), control_period=PERIOD)


def test_joints_follow_their_script_and_carry_the_base(follow: Follow) -> None:
    """In a period a joint goes its speed times the period; base and observation follow from all joints."""
    assert [channel.unit for channel in follow.action_channels] == ["kPa", "kPa", *["rad/s"] * 6]
    readings, _ = follow.reset(seed=0)
    first = readings[-6:].astype(float)
    action = np.array([0.0, 0.0, 1.0, -0.5, 0.25, 0.0, 1.0, -1.0])
    speeds = np.array([channel.high for channel in follow.action_channels[2:]])
    for period in range(1, 4):
        readings, *_ = follow.step(action)
        joints = follow.actuation.arm.values(  # type: ignore[union-attr]
            follow.simulation.state.base_translation,
            follow.simulation.state.base_rotation,
            follow.simulation.model.base_pivot,
        )
        assert joints == pytest.approx(first + period * PERIOD * speeds * action[2:], abs=1e-6)
        assert readings[-6:] == pytest.approx(joints, abs=1e-6)
    arm, state = follow.actuation.arm._arm, follow.simulation.state  # type: ignore[union-attr]
    motion = motion_of_base(state.base_translation, state.base_rotation, follow.simulation.model.base_pivot)
    assert motion == pytest.approx(arm.motions(joints)[-1], abs=1e-6)
    assert np.linalg.norm(state.base_translation) > 1.0


def test_an_episode_may_begin_where_the_arm_has_been(follow: Follow) -> None:
    """The joints are found from the pose of the base; the way goes on with the same readings."""
    follow.reset(seed=0)
    action = np.array([-1.0, -1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    follow.step(action)
    between = follow.simulation.state
    there, *_ = follow.step(action)
    follow.reset(seed=1)
    follow.reset(options={"state": between})
    again, *_ = follow.step(action)
    assert again == pytest.approx(there, abs=1e-5)


def test_joints_stop_at_their_limits(follow: Follow) -> None:
    follow.reset(seed=0)
    arm = follow.actuation.arm
    assert arm is not None
    most = arm.control(np.full(6, 1e6), follow.simulation.state, follow.simulation.model.base_pivot, PERIOD)
    assert np.isfinite(most["base_velocity"]).all()
    assert arm._values == pytest.approx(arm._arm.chain.highest)


def test_what_has_no_arm_is_refused() -> None:
    with pytest.raises(SceneError, match='needs a scene whose controller is "arm"'):
        Follow(scene=TINY_GRIPPER)
    Follow.travel = ArmTravel(share=2.0)
    with pytest.raises(SceneError, match=r"share=2\): must be above 0 and at most 1"):
        Follow(scene=carried())
    Follow.travel = ArmTravel(share=0.2)
