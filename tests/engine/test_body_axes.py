"""The axes of bodies go with them: those of a soft body turn as the rotation that fits its nodes best."""

from types import SimpleNamespace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from taichisoft import Scene
from taichisoft.mechanics import axes_of_bodies
from taichisoft.mechanics.body_geometry import RigidAxes, SoftAxes, best_rotation

ANGLES = st.tuples(*3 * [st.floats(-3.0, 3.0)])
POINTS = np.random.default_rng(1).normal(size=(20, 3)) * [30.0, 10.0, 5.0]


@given(ANGLES)
def test_the_rotation_of_what_only_turned_and_moved_is_found(angles: tuple[float, float, float]) -> None:
    turn = Rotation.from_rotvec(angles).as_matrix()
    np.testing.assert_allclose(best_rotation(POINTS, POINTS @ turn.T + [5.0, 6.0, 7.0]), turn, atol=1e-9)


@given(ANGLES, st.integers(0, 1000))
def test_it_is_a_rotation_that_no_other_near_it_betters(angles: tuple[float, float, float], seed: int) -> None:
    """Also of mirrored and noisy points: what is left is a minimum over 20 small turns."""
    noise = np.random.default_rng(seed).normal(size=(20, *POINTS.shape))
    after = POINTS @ Rotation.from_rotvec(angles).as_matrix().T * [1.0, 1.0, -1.0] + noise[0]
    found = best_rotation(POINTS, after)
    np.testing.assert_allclose(found @ found.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(found) > 0.0

    def left(turn: np.ndarray) -> float:
        return float((((POINTS - POINTS.mean(0)) @ turn.T - (after - after.mean(0))) ** 2).sum())

    for small in 0.01 * noise[:, 0]:
        assert left(Rotation.from_rotvec(small).as_matrix() @ found) >= left(found) * (1.0 - 1e-12)


def test_a_body_that_was_placed_and_then_moved_has_the_axes_of_its_mesh() -> None:
    placement, turn = (Rotation.from_euler("xyz", angles, degrees=True) for angles in ([30, 40, 50], [0, 0, 90]))
    rest = placement.apply(POINTS) + np.array([1.0, 2.0, 3.0])
    position = np.vstack([np.zeros((4, 3)), turn.apply(rest) + np.array([0.0, 0.0, 9.0])])
    axes = SoftAxes(slice(4, 24), rest, placement.as_matrix())
    origin, *directions = axes.place(SimpleNamespace(position=position))  # type: ignore[arg-type]
    np.testing.assert_allclose(origin, position[4:].mean(axis=0))
    np.testing.assert_allclose(directions, (turn * placement).as_matrix().T, atol=1e-9)


def test_only_bodies_of_which_the_scene_wants_them_have_axes() -> None:
    soft = {"mesh": "m", "mass": 1.0, "young_modulus": 500.0, "poisson_ratio": 0.3}
    rigid = {"box": [1.0, 1.0, 1.0], "mass": 1.0}
    scene = Scene.model_validate(
        {
            "soft_bodies": {"a": soft, "b": {**soft, "axes": True}},
            "rigid_bodies": {"c": rigid, "d": {**rigid, "axes": True}},
        }
    )
    bodies = [SimpleNamespace(name=name, nodes=slice(0, 4), rest_position=POINTS[:4]) for name in "ab"]
    axes = axes_of_bodies(scene, bodies)
    assert list(axes) == ["b", "d"] and axes["d"] == RigidAxes(1)
    quaternion = Rotation.from_euler("z", 90, degrees=True).as_quat()[[3, 0, 1, 2]]
    poses = SimpleNamespace(rigid_position=np.array([[0, 0, 0], [1, 2, 3]]), rigid_rotation=np.array([quaternion] * 2))
    expected = [[1, 2, 3], [0, 1, 0], [-1, 0, 0], [0, 0, 1]]
    np.testing.assert_allclose(axes["d"].place(poses), expected, atol=1e-12)  # type: ignore[arg-type]
