"""A varied model is that of a scene with the other values: bit for bit where an inertia is scaled by a power of two."""

import numpy as np
import pytest

from taichisoft import Control, Model, Scene, Simulation, State, make_model, scene_from_dict
from taichisoft.errors import SceneError
from taichisoft.scene import apply_override, scene_to_toml


def squeezed(model: Model) -> State:
    return squeeze(Simulation(model))


def squeeze(simulation: Simulation) -> State:
    for step in range(40):
        pressure = 0.3 * step
        simulation.step(Control(pressure={"left.cavity": pressure, "right.cavity": pressure}))
    assert len(simulation.state.contact_point)
    return simulation.state


def test_friction_and_masses_of_a_varied_model(taichisoft_scene: Scene) -> None:
    table = taichisoft_scene.model_dump(mode="json", exclude_none=True)
    for override in ("contact.friction=0.3", "rigid_bodies.cube.mass=0.002"):
        apply_override(table, override)
    scene = scene_from_dict(table)
    model = make_model(taichisoft_scene)
    varied = model.varied(friction=0.3, masses={"cube": 0.002})
    assert scene_to_toml(varied.scene) == scene_to_toml(scene)
    assert squeezed(varied) == squeezed(make_model(scene))
    assert varied.elasticity is model.elasticity
    assert (model.friction == 0.6).all()
    assert model.rigid_mass.tolist() == [0.001]
    with pytest.raises(ValueError, match="read-only"):
        varied.friction[0, 0] = 1.0


def test_a_simulation_goes_from_variant_to_variant_as_if_it_were_made_of_each(taichisoft_scene: Scene) -> None:
    table = taichisoft_scene.model_dump(mode="json", exclude_none=True)
    pushed = {"body": "cube", "start": 0.1, "duration": 0.1, "force": [3.0, 0.0, 0.0]}
    table["external_forces"] = [pushed]  # an acceleration that depends on the mass
    model = make_model(scene_from_dict(table))
    variants = [
        model.varied(friction=0.2),
        model.varied(masses={"cube": 0.003}),
        model,
        model.varied(0.7, {"cube": 0.0005}),
    ]
    ends = [squeezed(variant) for variant in variants]
    assert all(ends[0] != end for end in ends[1:])
    simulation = Simulation(model)
    for variant, end in zip(variants, ends, strict=True):
        simulation.change_model(variant)
        simulation.restore(variant.initial_state())
        assert squeeze(simulation) == end
        assert simulation.model is variant


def test_the_model_of_something_else_is_refused(taichisoft_scene: Scene) -> None:
    simulation = Simulation(make_model(taichisoft_scene))
    with pytest.raises(SceneError, match="takes a variant"):
        simulation.change_model(make_model(taichisoft_scene))


def test_the_inertia_of_a_varied_body_follows_its_mass(taichisoft_scene: Scene) -> None:
    varied = make_model(taichisoft_scene).varied(masses={"cube": 0.003})
    assert np.allclose(varied.rigid_inertia[0], np.eye(3) * 0.003 * 10.0**2 / 6.0)


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"masses": {"cub": 1.0}}, "no rigid body is called 'cub'; did you mean 'cube'"),
        ({"masses": {"cube": 0.0}}, r"masses\['cube'\] = 0.0: must be above 0"),
        ({"friction": -0.1}, "friction = -0.1: must be 0 or more"),
    ],
)
def test_what_no_model_can_be_is_refused(taichisoft_scene: Scene, change: dict, problem: str) -> None:
    with pytest.raises(SceneError, match=problem):
        make_model(taichisoft_scene).varied(**change)
