"""Where the surfaces of bodies are in a state, found without kernels."""

import numpy as np
import pytest

from taichisoft import Control, Scene, Simulation
from taichisoft.base import matrices_from_quaternions
from taichisoft.contact import MovingSurfaces
from taichisoft.mechanics import body_surfaces, planes_of
from taichisoft.scene import scene_from_dict

BODIES = {name: {"box": [1.0, 1.0, 1.0], "mass": 1.0} for name in ("ball", "cube")}


def test_surfaces_are_where_contact_finds_them(taichisoft_scene: Scene) -> None:
    """After steps in which the pads bend and the base turns; contact moves its own vertices with kernels."""
    simulation = Simulation(taichisoft_scene)
    model = simulation.model
    for _ in range(5):
        simulation.step(Control(pressure={"left.cavity": 5.0}, base_velocity=np.array([0.0, 10.0, 20.0])))
    state = simulation.state
    surfaces = body_surfaces(model.soft_bodies, model.rigid_bodies, model.obstacles)
    assert [(surface.name, surface.kind) for surface in surfaces] == [
        ("left", "soft"),
        ("left.cavity", "cavity"),
        ("right", "soft"),
        ("right.cavity", "cavity"),
        ("cube", "rigid"),
    ]
    moving = MovingSurfaces(model.surfaces)
    moving.update(state.position, state.rigid_position, matrices_from_quaternions(state.rigid_rotation))
    found = [surface.vertices(state) for surface in surfaces if surface.kind != "cavity"]
    np.testing.assert_allclose(np.vstack(found), moving.moved.position, atol=1e-12)
    (floor,) = planes_of(model.obstacles)
    assert floor.name == "floor" and floor.normal.tolist() == [0.0, 0.0, 1.0]


@pytest.mark.parametrize(
    ("gravity", "up"), [([-9810.0, 0.0, 0.0], [1.0, 0.0, 0.0]), ([0.0, 3.0, -4.0], [0.0, -0.6, 0.8])]
)
def test_up_is_against_gravity(gravity: list[float], up: list[float]) -> None:
    assert scene_from_dict({"gravity": gravity, "rigid_bodies": BODIES}).up.tolist() == pytest.approx(up)


def test_up_is_z_without_gravity() -> None:
    assert scene_from_dict({"gravity": [0.0, 0.0, 0.0], "rigid_bodies": BODIES}).up.tolist() == [0.0, 0.0, 1.0]


def test_the_main_object_is_that_of_the_goal_or_the_first() -> None:
    assert scene_from_dict({"rigid_bodies": BODIES}).main_object == "ball"
    assert scene_from_dict({"rigid_bodies": BODIES, "goal": {"object": "cube"}}).main_object == "cube"
    soft = {"finger": {"mesh": "m", "mass": 1.0, "young_modulus": 500.0, "poisson_ratio": 0.3}}
    assert Scene.model_validate({"soft_bodies": soft}).main_object is None
