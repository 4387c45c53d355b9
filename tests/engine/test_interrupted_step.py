"""A step that lasts long is interrupted within, and leaves the state of the last whole step."""

import signal
from typing import Any

import pytest

from taichisoft import Control, Controller, Output, Simulation, load_scene, run
from taichisoft.contact import contact_solver
from taichisoft.pytest_fixtures import TINY_GRIPPER

HOPELESS = ("contact.tolerance=1e-15",)
"""A tolerance below the rounding: every step with a contact takes all Newton steps."""


class Inflate(Controller):
    """Until both fingers press."""

    def control(self, observation: Any) -> Control:
        return Control(pressure=dict.fromkeys(observation.pressures, 0.5 * (observation.step + 1)))


class Steps(Output):
    """Which were recorded."""

    def __init__(self) -> None:
        self.made: list[int] = []

    def record(self, state: Any, report: Any) -> None:
        self.made.append(report.step)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_newton_steps_are_interrupted_and_the_step_is_not_made(monkeypatch: pytest.MonkeyPatch, number: int) -> None:
    """The signal comes in the tenth launch of a step; no other follows, and what goes on has the same bits."""
    simulation = Simulation(load_scene(TINY_GRIPPER, HOPELESS))
    launches: list[int] = []
    step_and_sweep = contact_solver.kernels.step_and_sweep

    def launched(*arguments: Any) -> None:
        step_and_sweep(*arguments)
        launches.append(simulation.state.step)
        if launches.count(launches[-1]) == 10:
            signal.raise_signal(number)

    for beside in ("_follow_interior_points", "choose_smallest"):  # their kernels take long to load
        monkeypatch.setattr(contact_solver.ContactSolver, beside, lambda *_: None)
    steps = Steps()
    with monkeypatch.context() as patch:
        patch.setattr(contact_solver.kernels, "step_and_sweep", launched)
        assert run(simulation, Inflate(), [steps], duration=1.0) == "interrupted"
    last = simulation.state.step
    assert launches[-1] == last and launches.count(last) == 10
    assert steps.made == list(range(last))
    control = Inflate().control(simulation.observe())
    simulation.step(control)
    again = Simulation(simulation.model)
    for _ in range(last + 1):
        again.step(Inflate().control(again.observe()))
    assert simulation.state == again.state
