"""A box that slides on a floor without turning: its corners bear what statics say, at any speed and any spacing."""

import numpy as np
from conftest import examples
from hypothesis import given
from hypothesis import strategies as st
from scenes import FLOOR, GRAVITY, simulate

from taichisoft.base import matrices_from_quaternions

MASS, DISTANCE = 0.01, 1.0
SIGNS = np.array([[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]])


@examples(25)
@given(
    size=st.tuples(*[st.floats(10.0, 50.0)] * 3),
    centre=st.tuples(*[st.floats(-0.05, 0.05)] * 2),
    speed=st.floats(50.0, 4000.0),
    towards=st.floats(0.0, 360.0),
    turn=st.floats(0.0, 90.0),
    friction=st.floats(0.0, 1.0),
    step=st.sampled_from([0.002, 0.005, 0.01]),
    spacing=st.sampled_from([0.0, 1.0, 4.0, 12.0]),
)
def test_corners_of_a_sliding_box_balance_its_weight(
    size: tuple[float, float, float],
    centre: tuple[float, float],
    speed: float,
    towards: float,
    turn: float,
    friction: float,
    step: float,
    spacing: float,
) -> None:
    """Forces and moments balance to 1e-6 of the weight: the smallest forces that do are linear in the place.

    sum N = W, and sum N x = W (c + mu z d) with the corners' places x and the centre of mass c beside their middle, the
    height z of the centre above them, and the way d of the friction's drag. So N = W / 4 (1 + (c + mu z d) . x / x^2).
    """
    friction *= 0.5 * min(size[:2]) / size[2]  # so that no corner lifts
    way, half = np.radians(towards), np.array(size[:2]) / 2
    box = {
        "box": list(size),
        "mass": MASS,
        "centre_of_mass": [*(np.array(centre) * size[:2]), 0.0],
        "inertia": np.diag([1.0, 1.2, 1.5]).tolist(),
        "position": [0.0, 0.0, size[2] / 2 + DISTANCE],
        "rotation": [0.0, 0.0, turn],
        "velocity": [speed * np.cos(way), speed * np.sin(way), 0.0],
    }
    contact = {"friction": friction, "contact_distance": DISTANCE, "spacing": spacing}
    simulation = simulate(
        step, (0.0, 0.0, -GRAVITY), rigid_bodies={"box": box}, obstacles={"floor": FLOOR}, contact=contact
    )
    axes = matrices_from_quaternions(simulation.state.rigid_rotation)[0][:2, :2]
    drag = axes.T @ [np.cos(way), np.sin(way)]
    share = np.array(centre) * size[:2] + friction * size[2] / 2 * drag
    expected = MASS * GRAVITY / 4 * (1.0 + SIGNS @ (share / half))
    for _ in range(6):
        report = simulation.step()
        assert report.converged
        if np.linalg.norm(simulation.state.rigid_velocity[0]) < 2.0 * friction * GRAVITY * step:
            break  # it comes to rest in the next step, or did
        middle = report.contact_points - report.contact_points.mean(axis=0)
        order = np.lexsort(np.round(middle[:, :2] @ axes).T[::-1])
        np.testing.assert_allclose(np.abs(report.contact_forces[order, 2]), expected, atol=1e-6 * MASS * GRAVITY)
