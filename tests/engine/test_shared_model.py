"""A model never changes: simulations share it, also in threads; a varied one is that of a scene with other values."""

import io
import pickle
from collections.abc import Callable
from dataclasses import replace
from threading import Event, Thread

import numpy as np
import pytest

from taichisoft import Control, Model, Scene, Simulation, State, StepReport, make_model, scene_from_dict
from taichisoft.errors import SceneError
from taichisoft.scene import apply_override, scene_to_toml

# A model never changes: simulations share it, one after the other and from threads at once.

STEPS = 15


@pytest.fixture
def model(block: Callable[..., str]) -> Model:
    """A hollow soft block between a floor and a falling box."""
    body = {"mesh": block((3, 3, 3), (20.0, 20.0, 20.0), hollow=True), "mass": 0.01}
    silicone = {"young_modulus": 100, "poisson_ratio": 0.3, "cavities": {"air": {"group": "cavity"}}}
    box = {"box": [10.0, 10.0, 10.0], "mass": 0.01, "position": [3.0, 1.0, 27.0], "velocity": [0.0, 0.0, -100.0]}
    scene = {
        "soft_bodies": {"block": {**body, **silicone, "translation": [0.0, 0.0, 11.5]}},
        "rigid_bodies": {"box": box},
        "obstacles": {"floor": {"plane": {"point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}}},
    }
    return make_model(scene_from_dict({"gravity": [0.0, 0.0, -9810.0], **scene}))


def squeeze(pressure: float) -> Control:
    return Control(pressure={"block.air": pressure})


def alone(model: Model, pressure: float) -> State:
    """The last state of a simulation that has the model for itself."""
    simulation = Simulation(model)
    for _ in range(STEPS):
        simulation.step(squeeze(pressure))
    assert len(simulation.state.contact_point)
    return simulation.state


def test_simulations_in_turn_give_the_bits_of_two_alone(model: Model) -> None:
    expected = [alone(model, pressure) for pressure in (1.0, 4.0)]
    first, second = Simulation(model), Simulation(model)
    for _ in range(STEPS):
        first.step(squeeze(1.0))
        second.step(squeeze(4.0))
    assert [first.state, second.state] == expected


def test_changed_stiffness_leaves_other_simulations_alone(model: Model) -> None:
    """One softens and stiffens its block while the other goes on; the first gets the bits of one alone as well."""

    def softened(step: int) -> Control:
        return Control(young_modulus={"block": 60.0 + 5.0 * step}, pressure={"block.air": 1.0})

    expected = alone(model, 4.0)
    lonely = Simulation(model)
    for step in range(STEPS):
        lonely.step(softened(step))
    first, second = Simulation(model), Simulation(model)
    for step in range(STEPS):
        first.step(softened(step))
        second.step(squeeze(4.0))
    assert [first.state, second.state] == [lonely.state, expected]
    assert lonely.state.position.tobytes() != alone(model, 1.0).position.tobytes()


def test_threads_give_the_bits_of_simulations_alone(model: Model) -> None:
    pressures = (1.0, 2.0, 3.0, 4.0)
    expected = [alone(model, pressure) for pressure in pressures]
    simulations = [Simulation(model) for _ in pressures]
    failures: list[BaseException] = []

    def run(simulation: Simulation, pressure: float) -> None:
        try:
            for _ in range(STEPS):
                simulation.step(squeeze(pressure))
        except BaseException as error:
            failures.append(error)

    threads = [Thread(target=run, args=pair) for pair in zip(simulations, pressures, strict=True)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not failures
    assert [simulation.state for simulation in simulations] == expected


def test_who_observes_from_another_thread_changes_no_bit(model: Model) -> None:
    """As a live page does: the report of a step is looked into while the next ones are made."""
    expected = alone(model, 4.0)
    simulation, reports, over = Simulation(model), list[StepReport](), Event()

    def look() -> None:
        while not over.is_set():
            for report in reports[-3:]:
                assert Simulation.observe(simulation).volumes and replace(report).observation.flows

    watcher = Thread(target=look)
    watcher.start()
    for _ in range(STEPS):
        reports.append(simulation.step(squeeze(4.0)))
    over.set()
    watcher.join()
    assert simulation.state == expected


def test_all_arrays_of_a_model_are_read_only(model: Model) -> None:
    """Whatever a model has in it, as pickle finds it: a simulation that wrote to it would change all the others."""
    found: list[np.ndarray] = []

    class Collector(pickle.Pickler):
        def persistent_id(self, part: object) -> None:
            if isinstance(part, np.ndarray):
                found.append(part)

    Collector(io.BytesIO()).dump(model)
    assert model.elasticity is not None
    parts = (model.friction, model.elasticity.lame, model.cavities.rest_value, model.surfaces.edge_range)
    assert {id(array) for array in parts} <= {id(array) for array in found}
    assert not any(array.flags.writeable for array in found)


def test_a_state_is_read_only(model: Model) -> None:
    """What was computed from it would no longer be true: its arrays refuse to change."""
    simulation = Simulation(model)
    simulation.step()
    for array in vars(simulation.state).values():
        if isinstance(array, np.ndarray):
            with pytest.raises(ValueError, match="read-only"):
                array[...] = 0


# A varied model is that of a scene with the other values: bit for bit where an inertia is scaled by a power of two.


def squeezed(model: Model) -> State:
    return press(Simulation(model))


def press(simulation: Simulation) -> State:
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


def test_changed_model_equals_a_new_simulation(taichisoft_scene: Scene) -> None:
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
        assert press(simulation) == end
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
