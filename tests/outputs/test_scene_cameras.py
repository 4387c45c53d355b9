"""Cameras of a scene: colour, depth and segmentation agree with where everything is."""

import numpy as np
import pytest

from taichisoft import Control, Simulation, load_scene
from taichisoft.errors import SceneError
from taichisoft.pytest_fixtures import TINY_GRIPPER

CAMERA = "cameras.eye={eye=[0.0, 60.0, 40.0], target=[0.0, 0.0, 5.2], size=[96, 72], follows='base'}"


def test_a_pixel_leads_to_the_surface_that_it_says() -> None:
    """K^-1 (u, v, 1) depth, turned into the world, is a point of the body that is seen: cube, or floor at z = 0.

    Depth has 24 bits or so between the planes near and far, and a pixel's middle is where the surface is.
    """
    simulation = Simulation(load_scene(TINY_GRIPPER, [CAMERA]))
    shift = np.array([2.0, -3.0, 1.0])
    frame, names = simulation.observe().cameras["eye"], simulation.model.body_names
    assert frame.colour.shape == (72, 96, 3) and frame.depth.shape == frame.segmentation.shape == (72, 96)
    v, u = np.indices(frame.depth.shape) + 0.5
    rays = np.stack([u, v, np.ones_like(u)], axis=-1) @ np.linalg.inv(frame.intrinsics).T
    is_seen = np.isfinite(frame.depth)
    points = np.where(is_seen, frame.depth, 0.0)[..., None] * rays @ frame.rotation + frame.eye
    cube, floor = (frame.segmentation == names.index(name) for name in ("cube", "floor"))
    assert cube.sum() > 50 and floor.sum() > 500 and np.array_equal(is_seen, frame.segmentation >= 0)
    assert np.abs(points[floor][:, 2]).max() < 1e-3
    # Nearest the surface of a cube: the largest distance from its middle along an axis is half of its side.
    away = np.abs(points[cube] - simulation.state.rigid_position[0]).max(axis=1)
    assert np.abs(away - 5.0).max() < 0.02
    assert {names[number] for number in np.unique(frame.segmentation[frame.segmentation >= 0])} >= {"left", "right"}

    # It moves with the base, whose points it keeps seeing at the same place.
    for _ in range(30):
        simulation.step(Control(base_translation=shift))
    moved = simulation.look("eye")
    assert np.allclose(moved.eye, frame.eye + shift) and np.allclose(moved.rotation, frame.rotation)
    assert moved.segmentation.tobytes() != frame.segmentation.tobytes()
    simulation.close()


def test_cameras_that_make_no_sense_are_refused() -> None:
    with pytest.raises(SceneError, match="eye and target are one point"):
        load_scene(TINY_GRIPPER, ["cameras.eye={eye=[0, 0, 0], target=[0, 0, 0]}"])
    with pytest.raises(SceneError, match=r"cameras\.eye\.follows is 'arm', which is not a frame; there are: base"):
        load_scene(TINY_GRIPPER, ["cameras.eye={eye=[0, 0, 1], target=[0, 0, 0], follows='arm'}"])
    simulation = Simulation(load_scene(TINY_GRIPPER, [CAMERA]))
    with pytest.raises(SceneError, match="there is no 'eve'; did you mean 'eye'"):
        simulation.look("eve")
