"""A model never changes: simulations share it, one after the other and from threads at once."""

import io
import pickle
from collections.abc import Callable
from dataclasses import replace
from threading import Event, Thread

import numpy as np
import pytest

from taichisoft import Control, Model, Simulation, State, StepReport, make_model, scene_from_dict

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


def test_two_simulations_that_step_in_turn_give_the_bits_of_two_alone(model: Model) -> None:
    expected = [alone(model, pressure) for pressure in (1.0, 4.0)]
    first, second = Simulation(model), Simulation(model)
    for _ in range(STEPS):
        first.step(squeeze(1.0))
        second.step(squeeze(4.0))
    assert [first.state, second.state] == expected


def test_who_changes_the_stiffness_of_a_body_changes_no_bit_of_the_others(model: Model) -> None:
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


def test_two_simulations_in_two_threads_give_the_bits_of_two_alone(model: Model) -> None:
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
