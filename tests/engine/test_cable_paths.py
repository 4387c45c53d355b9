"""Paths of cables without kernels: where their points are, and how friction shares out the tension between them."""

from pathlib import Path

import numpy as np
import pytest
from cable_block import LINK, TENDON, run_cables

from taichisoft.mechanics import segment_efforts


def test_points_have_the_length_that_the_engine_found(tmp_path: Path) -> None:
    """With a base that has turned, a cube that has moved and a pull point that was moved along."""
    simulation = run_cables(tmp_path)
    model, state = simulation.model, simulation.state
    paths = model.cables.lines
    assert [path.name for path in paths] == list(model.cables.names) == [TENDON, LINK]
    points = [path.points(state, model.frames) for path in paths]
    lengths = [np.linalg.norm(np.diff(one, axis=0), axis=1).sum() for one in points]
    assert lengths == pytest.approx(state.actuator_value.tolist(), rel=1e-12)
    np.testing.assert_array_equal(points[0][0], model.placed_pull_points(state)[0])
    assert np.linalg.norm(points[0][0] - model.cables.rest_pull_point[0]) > 1.0, "the base has moved it"
    on_cube = points[1][1] - state.rigid_position[0]
    assert np.linalg.norm(on_cube) == pytest.approx(np.hypot(5.0, 2.0))
    assert np.linalg.norm(on_cube - [-5.0, 0.0, 2.0]) > 0.01, "the cube has turned"


def test_points_at_the_start_are_those_of_the_scene(tmp_path: Path) -> None:
    simulation = run_cables(tmp_path)
    model = simulation.model
    for path, cable in zip(model.cables.lines, model.cables.all, strict=True):
        np.testing.assert_allclose(path.points(model.initial_state(), model.frames), cable.rest_point, atol=1e-12)
        assert path.rest_length == cable.rest_length


def test_the_tension_beyond_a_point_is_what_friction_leaves(tmp_path: Path) -> None:
    simulation = run_cables(tmp_path)
    state, paths = simulation.state, simulation.model.cables.lines
    rubbing, smooth = segment_efforts(paths, state.actuator_effort, state.actuator_loss)
    assert rubbing.tolist() == pytest.approx(
        [state.actuator_effort[0] - state.actuator_loss[:count].sum() for count in range(4)]
    )
    assert rubbing[-1] < 0.95 * rubbing[0]
    assert smooth.tolist() == pytest.approx([60.0])
    twice = segment_efforts(paths, np.stack([state.actuator_effort] * 2), np.stack([state.actuator_loss] * 2))
    np.testing.assert_array_equal(twice[0], [rubbing, rubbing])
