"""An arm's kinematics and the paths of its joints and tool."""

import numpy as np
import pytest
from arms import SIX_AXIS, own_arm, standing_arm
from conftest import examples
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from taichisoft.errors import ControllerFailed
from taichisoft_arm.arm_paths import PathLimits, TrapezoidalProfile, joint_path, straight_path, within
from taichisoft_arm.kinematics import KinematicChain, inverse_pose, pose_of, solve, solve_near, turn_between
from taichisoft_arm.mounted_arm import MountedArm
from taichisoft_arm.urdf_file import read_arm

SHARES = st.lists(st.floats(0.0, 1.0), min_size=6, max_size=6)


@pytest.fixture(scope="module")
def chain() -> KinematicChain:
    return read_arm(SIX_AXIS).chain


def values(chain: KinematicChain, shares: list[float]) -> np.ndarray:
    """Values of the joints by their shares of the ranges."""
    ranges: np.ndarray = chain.lowest + np.array(shares) * (chain.highest - chain.lowest)
    return ranges


def difference(chain: KinematicChain, at: np.ndarray, step: float) -> np.ndarray:
    """Central differences of the link's place and turn, shape (6, joint_count)."""
    columns = []
    for direction in np.eye(len(at)) * step:
        before, after = chain.link(at - direction), chain.link(at + direction)
        way, turn = after[:3, 3] - before[:3, 3], turn_between(before[:3, :3], after[:3, :3])
        columns.append(np.concatenate([way, turn]) / (2.0 * step))
    return np.array(columns).T


@given(SHARES)
@examples(20)
def test_the_jacobian_is_the_derivative_of_the_pose(chain, shares):
    """Central differences of step h = 1e-5 are off by h^2 and by round-off over h: 1e-6 of the reach of 870 mm."""
    at = values(chain, shares)
    assert chain.jacobian(chain.frames(at)) == pytest.approx(difference(chain, at, 1e-5), abs=1e-6 * chain.reach)


def test_the_jacobian_of_a_sliding_joint(tmp_path):
    chain = read_arm(own_arm(tmp_path)).chain
    at = np.array([0.7, 30.0])
    assert chain.jacobian(chain.frames(at)) == pytest.approx(difference(chain, at, 1e-5), abs=1e-7)
    assert chain.jacobian(chain.frames(at))[:, 1].tolist() == [0.0, 0.0, 1.0, 0.0, 0.0, 0.0]


@given(SHARES)
@examples(10)
def test_frames_are_products_of_the_joints_motions(chain, shares):
    """Each joint by SciPy's rotation about its axis; round-off of six products is below 1e-12 of the reach."""
    at, pose = values(chain, shares), np.eye(4)
    for joint, value in zip(chain.joints, at, strict=True):
        pose = pose @ joint.origin @ pose_of(np.zeros(3), Rotation.from_rotvec(value * joint.axis).as_matrix())
    assert chain.link(at) == pytest.approx(pose @ chain.tip, abs=1e-12 * chain.reach)


@given(SHARES)
@examples(25)
def test_a_pose_that_is_reached_is_found_again(chain, shares):
    """To 1e-9 mm and rad, within the limits; where it has several answers, one of them."""
    pose = chain.link(values(chain, shares))
    found = solve(chain, pose, np.zeros(6))
    assert found is not None
    assert ((chain.lowest <= found) & (found <= chain.highest)).all()
    assert chain.link(found) == pytest.approx(pose, abs=1e-9)


def test_the_answer_is_near_the_start_and_always_the_same(chain):
    """Of all answers the one that the arm reaches soonest; whole turns of the last joint included."""
    at = np.array([0.3, 0.2, -0.4, 0.5, 0.9, 4.0])
    found = solve(chain, chain.link(at), at + 0.05)
    assert found == pytest.approx(at, abs=1e-9)
    again = solve(chain, chain.link(at), at + 0.05)
    assert found.tolist() == again.tolist()
    near = solve_near(chain, chain.link(at), at + 0.05)
    assert near == pytest.approx(at, abs=1e-9)


def test_a_pose_out_of_reach_has_no_answer(chain):
    assert solve(chain, pose_of(np.array([chain.reach + 1.0, 0.0, 0.0]), np.eye(3)), np.zeros(6)) is None


def test_an_arm_of_two_joints_reaches_what_it_can(tmp_path):
    """It turns and slides: its mount moves on a cylinder of radius 120 mm about the z axis."""
    chain = read_arm(own_arm(tmp_path)).chain
    pose = chain.link(np.array([1.2, 150.0]))
    assert np.hypot(*pose[:2, 3]) == pytest.approx(120.0, abs=1e-12)
    assert pose[2] == pytest.approx([0.0, 0.0, -1.0, 50.0 + 150.0 - 10.0], abs=1e-12)
    assert solve(chain, pose, np.zeros(2)) == pytest.approx([1.2, 150.0], abs=1e-9)
    assert solve(chain, pose @ pose_of(np.array([0.0, 0.0, 400.0]), np.eye(3)), np.zeros(2)) is None
    assert inverse_pose(pose) @ pose == pytest.approx(np.eye(4), abs=1e-12)


# Paths of an arm: speeds stay below every limit, trapezoidal in time, and a straight way is straight.

PIVOT = np.array([0.0, 0.0, 100.0])
TOOL = np.array([0.0, 0.0, 10.0])
LIMITS = PathLimits(ramp=0.2, pivot=PIVOT)


@pytest.fixture(scope="module")
def arm() -> MountedArm:
    return standing_arm()


@given(st.floats(0.05, 50.0), st.floats(0.01, 2.0))
@examples(50)
def test_a_profile_is_a_trapezoid_or_a_triangle(rate, ramp):
    """The rate rises by rate / ramp, stays at its highest, and falls likewise; its integral is 1 at the end."""
    profile = TrapezoidalProfile(rate, ramp)
    times = np.linspace(0.0, profile.length, 2001)
    shares = np.array([profile.share(time) for time in times])
    rates, step = np.diff(shares) / np.diff(times), times[1]
    assert (shares[0], shares[-1]) == (0.0, 1.0)
    assert profile.share(0.5 * profile.length) == pytest.approx(0.5, abs=1e-12)
    assert (rates > -1e-9).all() and rates.max() <= rate * (1.0 + 1e-9)
    bends = np.diff(rates) / step
    assert np.abs(bends).max() <= rate / ramp * (1.0 + 1e-6) + 1e-6
    flat = 1.0 / rate - ramp  # how long the highest rate lasts; negative where it is not reached
    assert profile.length == pytest.approx(flat + 2.0 * ramp if flat > 0.0 else 2.0 * np.sqrt(ramp / rate))


def rates(path, count=400):
    """Speeds of the joints along a path, by differences."""
    times = np.linspace(0.0, path.length, count)
    return np.diff([path.at(time) for time in times], axis=0) / times[1]


@given(st.lists(st.floats(0.0, 1.0), min_size=6, max_size=6))
@examples(15)
def test_joints_move_together_within_their_speeds(arm, shares):
    """One joint reaches 0.99 of its speed unless the way is short, none more; all begin and end together."""
    target = arm.chain.lowest + np.array(shares) * (arm.chain.highest - arm.chain.lowest)
    path = joint_path(arm, LIMITS, arm.start, target)
    used = np.abs(rates(path)) / arm.chain.speed
    assert used.max(initial=0.0) <= 0.99 + 1e-9
    assert path.at(0.0).tolist() == arm.start.tolist() and path.at(path.length).tolist() == target.tolist()
    half = 0.5 * (arm.start + target)
    assert path.at(0.5 * path.length) == pytest.approx(half, abs=1e-9)


@pytest.mark.parametrize("speed", [120.0, 5000.0])  # the tool's own speed, or that of the joints, is the limit
def test_a_straight_way_is_straight_and_not_too_fast(arm, speed):
    motion = arm.motions(arm.start)[-1].copy()
    motion[:3, 3] += [150.0, 40.0, 80.0]
    path = straight_path(arm, LIMITS, arm.start, motion, TOOL, (speed, 10.0))
    assert np.abs(rates(path) / arm.chain.speed).max() < 1.0
    times = np.linspace(0.0, path.length, 200)
    motions = np.array([arm.motions(path.at(time))[-1] for time in times])
    places = motions[:, :3, :3] @ TOOL + motions[:, :3, 3]
    along = places - TOOL
    direction = np.array([150.0, 40.0, 80.0]) / np.linalg.norm([150.0, 40.0, 80.0])
    assert along - np.outer(along @ direction, direction) == pytest.approx(0.0, abs=1e-8)
    assert motions[:, :3, :3] == pytest.approx(np.broadcast_to(np.eye(3), (200, 3, 3)), abs=1e-10)
    speeds = np.linalg.norm(np.diff(places, axis=0), axis=1) / times[1]
    assert speeds.max() <= speed * (1.0 + 1e-9)
    if speed == 120.0:
        assert speeds.max() == pytest.approx(120.0, rel=1e-6)
        assert path.length == pytest.approx(np.linalg.norm([150.0, 40.0, 80.0]) / 120.0 + 0.2)


def test_the_base_keeps_within_the_limits_of_the_scene(arm):
    """The pivot's speed and the turning speed of the gripper, by differences of what is asked for."""
    limits = PathLimits(ramp=0.1, pivot=PIVOT, base_speed=40.0, base_turning_speed=0.3)
    target = arm.start + np.array([0.4, 0.0, 0.0, 0.0, 0.0, 1.5])
    path = joint_path(arm, limits, arm.start, target)
    motions = np.array([arm.motions(path.at(time))[-1] for time in np.linspace(0.0, path.length, 400)])
    pivots, step = motions[:, :3, :3] @ PIVOT + motions[:, :3, 3], path.length / 399
    speed = np.linalg.norm(np.diff(pivots, axis=0), axis=1) / step
    cosine = 0.5 * (np.einsum("nij,nij->n", motions[1:, :3, :3], motions[:-1, :3, :3]) - 1.0)
    turning = np.arccos(np.clip(cosine, -1.0, 1.0)) / step
    assert speed.max() <= 40.0 and turning.max() <= 0.3
    assert max(speed.max() / 40.0, turning.max() / 0.3) == pytest.approx(0.99, abs=1e-3)


def test_a_way_in_a_longer_time_is_the_same_way(arm):
    path = joint_path(arm, LIMITS, arm.start, arm.start + 0.3)
    slower = within(path, 2.0 * path.length)
    assert slower.length == pytest.approx(2.0 * path.length)
    assert slower.at(0.7 * slower.length) == pytest.approx(path.at(0.7 * path.length), abs=1e-12)
    with pytest.raises(ControllerFailed, match="the arm needs"):
        within(path, 0.5 * path.length)
    still = joint_path(arm, LIMITS, arm.start, arm.start)
    assert still.length == 0.0 and within(still, 1.0).at(0.5).tolist() == arm.start.tolist()


def test_straight_path_out_of_reach_or_singular_is_refused(arm):
    motion = arm.motions(arm.start)[-1].copy()
    for way, why in {
        (0.0, -600.0, 0.0): r"does not reach \[0\.0, -600\.0, 10\.0\]",
        (120.0, 650.0, 0.0): r'the straight way .* at \[.*take by = "joints"',  # past its own foot
    }.items():
        motion[:3, 3] = way
        with pytest.raises(ControllerFailed, match=why):
            straight_path(arm, LIMITS, arm.start, motion, TOOL, (100.0, 1.0))
