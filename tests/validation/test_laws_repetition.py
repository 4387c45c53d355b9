"""The same run gives the same numbers, bit for bit: again, resumed, and on another number of threads."""

import os
import subprocess
import sys
from pathlib import Path

import falling_finger
import pytest
from conftest import PATIENCE

from taichisoft import Model, Simulation, State, make_model
from taichisoft.runtime.language import THREADS


@pytest.fixture(scope="module")
def model() -> Model:
    """A scene with soft bodies, cavities, a rigid body and contacts."""
    return make_model(falling_finger.make_scene())


@pytest.fixture(scope="module")
def last_state(model: Model) -> State:
    """The state at the end of an uninterrupted run, in which contacts carried load."""
    simulation = Simulation(model)
    falling_finger.advance(simulation, falling_finger.STEPS)
    assert simulation.report is not None
    assert sum(simulation.report.observation.normal_forces.values()) > 10.0
    return simulation.state


def test_a_second_run_is_the_same(last_state: State) -> None:
    """With a model of its own, so that nothing is left over from the first."""
    again = Simulation(falling_finger.make_scene())
    falling_finger.advance(again, falling_finger.STEPS)
    assert again.state == last_state


def test_a_resumed_run_is_the_same(model: Model, last_state: State, tmp_path: Path) -> None:
    """Saved in the middle and loaded into another simulation; a model keeps nothing from step to step."""
    half = falling_finger.STEPS // 2 + 3
    first = Simulation(model)
    falling_finger.advance(first, half)
    first.state.save(tmp_path / "half.npz")
    falling_finger.advance(first, 1)  # whatever this leaves in the model's buffers must not matter
    resumed = Simulation(model)
    resumed.state = State.load(tmp_path / "half.npz")
    falling_finger.advance(resumed, falling_finger.STEPS - half)
    assert resumed.state == last_state


def test_threads_do_not_change_a_bit(last_state: State) -> None:
    """One and two threads, in processes of their own but for the number that this one has: every sum is gathered in a
    fixed order by one owner."""
    children = [
        subprocess.Popen(
            [sys.executable, falling_finger.__file__],
            env={**os.environ, "TAICHISOFT_THREADS": threads},
            stdout=subprocess.PIPE,
            text=True,
        )
        for threads in ("1", "2")
        if threads != str(THREADS)
    ]
    printed = [child.communicate(timeout=PATIENCE)[0].split()[-1] for child in children]
    assert printed
    assert set(printed) == {falling_finger.digest(last_state)}
