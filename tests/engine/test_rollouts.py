"""Many futures of one state: the same bits in this thread and in others, arrays, and an end when it is wanted."""

import gc
import re
import threading
import time
import warnings
from dataclasses import fields

import numpy as np
import pytest
from conftest import PATIENCE

import taichisoft.running.rollouts
from taichisoft import Control, Force, Observation, Simulation, load_scene, rollouts
from taichisoft.control import FIGURES, PAIRS
from taichisoft.errors import ControlError, SimulationDiverged, TaichisoftError
from taichisoft.pytest_fixtures import TINY_GRIPPER

TAKEN = ("object_positions.cube", "normal_forces.cube|left", "pressures", "state.velocity", "time")


@pytest.fixture(scope="module")
def grasp():
    """The pads press on the cube, and nothing limits their pressure."""
    without_limits = ("limits.highest_pressure=1e9", "limits.pressure_rate=1e12")
    simulation = Simulation(load_scene(TINY_GRIPPER, without_limits))
    for pressure in np.linspace(0.0, 9.0, 30):
        simulation.step(squeeze(pressure))
    yield simulation
    simulation.close()


def squeeze(pressure, height=0.0):
    both = {"left.cavity": pressure, "right.cavity": pressure}
    return Control(pressure=both, base_translation=np.array([0.0, 0.0, height]))


def lifts(count, length):
    """Samples that lift the base, each faster than the one before."""
    return [[squeeze(9.0 + index, 0.1 * index * step) for step in range(length)] for index in range(count)]


@pytest.mark.parametrize("steps_per_control", [1, 3])
def test_futures_equal_runs_in_any_process(grasp, steps_per_control):
    """By hand, in this process, in two processes of one thread each; and the simulation stays where it is."""
    start, controls = grasp.state, lifts(4, 5)
    here = rollouts(grasp, controls, 0, TAKEN, steps_per_control)
    apart = rollouts(grasp, controls, 2, TAKEN, steps_per_control)
    assert grasp.state is start and here["normal_forces.cube|left"].max() > 0.0
    by_hand = Simulation(grasp.model)
    for index, sample in enumerate(controls):
        by_hand.restore(start)
        for step in range(5 * steps_per_control):
            by_hand.step(None if step % steps_per_control else sample[step // steps_per_control])
            seen = by_hand.observe()
            assert seen.time == here.times[step] == here["time"][index, step]
            assert np.array_equal(here["object_positions.cube"][index, step], seen.object_positions["cube"])
            assert np.array_equal(here["state.velocity"][index, step], by_hand.state.velocity)
            assert here["normal_forces.cube|left"][index, step] == seen.normal_forces["left", "cube"]
        assert here.states[index] == by_hand.state
    assert apart.states == here.states and apart.complete.all() and apart.errors == (None,) * 4
    assert all(np.array_equal(here[name], apart[name]) for name in TAKEN)
    assert here["pressures"].shape == (4, 5 * steps_per_control, 2)


def test_pushes_of_futures_are_those_of_steps(grasp):
    """One that acts for four steps, over controls of three, and one in own axes on a pad until it is ended."""
    tip = Force([0.0, 2.0, 0.0], point=grasp.model.soft_bodies[0].rest_position[-1], axes="own")
    forces = ({"cube": Force([5.0, 0.0, 0.0], steps=4), "left": tip}, {}, {"left": None})
    sample, figures = [Control(forces=one) for one in forces], ("object_positions.cube", "external_forces")
    here = rollouts(grasp, [sample] * 2, 2, figures, 3)
    by_hand = Simulation(grasp.model)
    by_hand.restore(grasp.state)
    for step in range(9):
        by_hand.step(None if step % 3 else sample[step // 3])
        seen = by_hand.observe()
        assert np.array_equal(here["object_positions.cube"][1, step], seen.object_positions["cube"])
        assert seen.external_forces["cube"].tolist() == [5.0 * (step < 4), 0.0, 0.0]
        assert (np.linalg.norm(seen.external_forces["left"]) > 1.9) == (step < 6)


def test_state_from_a_process_can_be_restored(grasp):
    (state,) = rollouts(grasp, lifts(1, 3), 2).states
    simulation = Simulation(grasp.model)
    simulation.restore(state)
    simulation.step()
    with pytest.raises(ValueError, match="read-only"):
        state.position[0] = 0.0


def test_diverged_future_stops_no_others(grasp):
    controls = [[squeeze(9.0)] * 6, [squeeze(9.0)] * 2 + [squeeze(1e7)] * 4]
    made = rollouts(grasp, controls, 2, ["pressures"])
    good, bad = made.errors
    assert good is None and isinstance(bad, SimulationDiverged) and bad.step >= 32
    assert made.complete.tolist() == [True, False]
    steps = bad.step - 30
    assert np.isfinite(made["pressures"][0]).all() and np.isfinite(made["pressures"][1, :steps]).all()
    assert np.isnan(made["pressures"][1, steps:]).all() and steps < 6
    assert made.states[1].step == bad.step


@pytest.mark.parametrize("workers", [0, 2])
def test_samples_beyond_a_law_warn_once(grasp, workers):
    """The field has every sample's largest stretch; a run that goes there itself is told of apart."""
    simulation = Simulation(grasp.model)
    simulation.restore(grasp.state)
    controls = [[squeeze(9.0)] * 20, [squeeze(min(9.0 + 5.0 * step, 60.0)) for step in range(20)]]
    with pytest.warns(UserWarning, match=r"^rollouts: sample 1: '(left|right)' is stretched") as warned:
        within, beyond = rollouts(simulation, controls, workers).stretch_over_law
    assert 0.0 < within < 1.0 < beyond and len(warned) == 1
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert rollouts(simulation, controls, workers).stretch_over_law[1] == beyond
    with pytest.warns(UserWarning, match="is stretched"):
        for control in controls[1]:
            simulation.step(control)
    simulation.close()


@pytest.mark.parametrize("workers", [0, 2])
def test_wrong_control_is_an_error_of_the_results(grasp, workers):
    made = rollouts(grasp, [[Control(pressure={"middle": 1.0})], *lifts(3, 1)], workers)
    with pytest.raises(ControlError, match="middle"):
        made.wait()
    assert rollouts(grasp, lifts(2, 1), workers).complete.all(), "and the next call works"


def test_cancelled_futures_keep_what_is_done(grasp):
    expected = rollouts(grasp, lifts(2, 3), 0, ["pressures"])
    made = rollouts(grasp, [*lifts(2, 3), *lifts(6, 3)], 2, ["pressures"])
    made.wait()
    long = rollouts(grasp, lifts(6, 1), 2, ["pressures"], steps_per_control=100_000)
    assert not long.wait(0.3)
    began = time.monotonic()
    long.cancel()
    assert long.wait(PATIENCE) and time.monotonic() - began < PATIENCE / 10
    assert not long.complete.any() and long.done.all() and np.isnan(long["pressures"]).all()
    again = rollouts(grasp, lifts(2, 3), 2, ["pressures"])
    assert np.array_equal(again["pressures"], expected["pressures"]) and again.states == expected.states
    made.cancel()
    assert made.complete.all(), "what was done stays"


def test_threads_take_another_model(grasp):
    """Friction 0: the cube slides out of the pads that rise."""
    model, figures = grasp.model, ["object_positions.cube"]
    (before,) = rollouts(grasp, lifts(2, 8)[1:], 2, figures)["object_positions.cube"]
    try:
        grasp.change_model(model.varied(friction=0.0))
        after = [rollouts(grasp, lifts(2, 8), workers, figures) for workers in (0, 2)]
    finally:
        grasp.change_model(model)
    assert after[0].states == after[1].states
    assert after[0]["object_positions.cube"][1, -1, 2] < before[-1, 2] - 0.01


def test_failure_of_a_sample_is_reported(grasp, monkeypatch):
    def fail(*_arguments):
        raise ZeroDivisionError("by\nzero")

    monkeypatch.setattr(taichisoft.running.rollouts, "roll_out", fail)
    with pytest.raises(TaichisoftError, match=r"sample . of the rollouts: ZeroDivisionError: by zero"):
        rollouts(grasp, lifts(2, 1), 2).wait()
    monkeypatch.undo()
    assert rollouts(grasp, lifts(2, 1), 2).complete.all()


def test_threads_end_with_their_simulation():
    simulation = Simulation(load_scene(TINY_GRIPPER))
    before = set(threading.enumerate())
    made = rollouts(simulation, [[squeeze(1.0)]], 1)
    assert made.complete.all()
    (thread,) = set(threading.enumerate()) - before
    del simulation, made
    gc.collect()
    thread.join(PATIENCE)
    assert not thread.is_alive()


def test_closed_simulation_ends_threads():
    simulation = Simulation(load_scene(TINY_GRIPPER))
    made = rollouts(simulation, [[squeeze(1.0)]] * 2, 1, steps_per_control=1_000_000)
    assert not made.wait(0.2)
    simulation.close()
    with pytest.raises(TaichisoftError, match=r"ended by `Simulation.close`"):
        made.wait()
    assert rollouts(simulation, [[squeeze(1.0)]], 0).complete.all()


def test_fields_of_fixed_shape_are_figures(grasp):
    seen = grasp.observe()
    pairs = [figure.field for figure in FIGURES if figure.per is PAIRS]
    others = (*pairs, "contact_points", "contact_forces", "clipped", "exact", "state")
    names = [one.name for one in fields(Observation) if one.name not in others] + ["tip_speeds", "object_speeds"]
    made = rollouts(grasp, [[Control()]], 0, names)
    grasp_after = Simulation(grasp.model)
    grasp_after.restore(made.states[0])
    seen = grasp_after.observe()
    for name in names:
        value = getattr(seen, name)
        expected = list(value.values()) if hasattr(value, "values") else value
        assert np.array_equal(made[name][0, 0], np.array(expected, dtype=float)), name
    for pair in pairs:
        (values,) = rollouts(grasp, [[Control()]], 0, [f"{pair}.cube|left"])[f"{pair}.cube|left"]
        assert values.tolist() == [getattr(seen, pair)["left", "cube"]]
    assert rollouts(grasp, [[Control()]], 0, ["slip_speeds.left|right"])["slip_speeds.left|right"].tolist() == [[0.0]]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"controls": []}, "controls: must have a sample or more"),
        ({"controls": [[]]}, "controls: must have a sample or more, each with a control or more"),
        ({"controls": [[Control()], []]}, "controls: sample 1 has 0, sample 0 has 1"),
        ({"controls": [[{"pressure": 1.0}]]}, "controls: sample 0: {'pressure': 1.0} must be a taichisoft.Control"),
        ({"controls": [Control(), Control()]}, "controls: must be a sequence of samples, each a sequence of controls"),
        (
            {"simulation": load_scene(TINY_GRIPPER)},
            "a Scene is not a simulation; taichisoft.Simulation(scene)",
        ),
        ({"workers": -1}, "workers = -1: must be a whole number"),
        ({"workers": 1.5}, "workers = 1.5: must be a whole number"),
        ({"steps_per_control": 0}, "steps_per_control = 0: must be a whole number"),
        ({"figures": "pressures"}, "figures = 'pressures': must be a sequence of names"),
        ({"figures": ["pressure"]}, "'pressure': not a field of an observation with a fixed shape; did you mean 'pres"),
        ({"figures": ["contact_points"]}, "not a field of an observation with a fixed shape"),
        ({"figures": ["pressures.left"]}, "pressures has no 'left'; there are: left.cavity, right.cavity"),
        ({"figures": ["time.now"]}, "time has no 'now'; leave out what follows time"),
        ({"figures": ["state"]}, "state has no ''"),
        ({"figures": ["state.contact_point"]}, "state has no 'contact_point'"),
        ({"figures": ["normal_forces"]}, "name two bodies, as in normal_forces.finger1|cube"),
        ({"figures": ["normal_forces.left|cub"]}, "no body is called 'cub'; did you mean 'cube'?"),
    ],
)
def test_wrong_arguments_are_one_line(grasp, arguments, message):
    with pytest.raises(TaichisoftError, match=re.escape(message)) as refused:
        rollouts(**{"simulation": grasp, "controls": [[Control()]], "workers": 0, **arguments})
    assert "\n" not in str(refused.value)


def test_missing_figure_is_named(grasp):
    with pytest.raises(TaichisoftError, match="'pressure' was not asked for; did you mean 'pressures'"):
        rollouts(grasp, [[Control()]], 0, ["pressures"])["pressure"]
