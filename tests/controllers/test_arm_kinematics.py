"""Kinematics of arms: the Jacobian is the derivative of the poses, and poses that are reached are found again."""

import numpy as np
import pytest
from arms import SIX_AXIS, own_arm
from conftest import examples
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from taichisoft_arm.kinematics import KinematicChain, inverse_pose, pose_of, solve, solve_near, turn_between
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
