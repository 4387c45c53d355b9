"""One future of a state: the same steps in whichever process makes them."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from taichisoft.control.control import Control
from taichisoft.control.observed_figures import ObservedFigure
from taichisoft.errors import SimulationDiverged
from taichisoft.state import State
from taichisoft.step.strain_watch import EVERY
from taichisoft.time_stepper import TimeStepper


@dataclass(frozen=True)
class RolloutSample:
    """What a future begins with and is driven by.

    Attributes:
        start: state from which it begins.
        controls: what is asked for, one after the other.
        steps_per_control: number of steps for which each of them stands.
        figures: what is taken from the observation after every step.
    """

    start: State
    controls: tuple[Control, ...]
    steps_per_control: int
    figures: tuple[ObservedFigure, ...]


@dataclass(frozen=True)
class RolloutOutcome:
    """What became of a sample.

    Attributes:
        state: the last state that was reached.
        values: values of each figure after the steps that were made, each of shape (steps_made, ...).
        diverged: the arguments of the `SimulationDiverged` that ended it early, or None.
        stretch_over_law: largest stretch over that up to which the body's law holds [-], see `Rollouts`.
        complaint: line on the first state beyond a law, or None.
    """

    state: State
    values: tuple[np.ndarray, ...]
    diverged: tuple[str, int, str, str] | None
    stretch_over_law: float
    complaint: str | None


def roll_out(simulation: TimeStepper, sample: RolloutSample, is_cancelled: Callable[[], bool]) -> RolloutOutcome | None:
    """Make the steps of a sample; None if it was cancelled on the way.

    Raises:
        ControlError: a control asks for something impossible.
        StateError: the start belongs to another model.
    """
    simulation.restore(sample.start)
    rows: list[list[np.ndarray]] = []
    diverged = complaint = None
    simulation.strain_watch.restart(is_new_run=True)
    watched, largest = -1, 0.0

    def watch_law() -> None:
        nonlocal watched, largest, complaint
        state = simulation.state
        if state.step != watched:
            found = max(simulation.strain_watch.over_law(state).values(), default=0.0)
            watched, largest = state.step, max(largest, found)
            if found > 1.0:
                complaint = complaint or simulation.strain_watch.complaint(state)

    for control in sample.controls:
        for number in range(sample.steps_per_control):
            if is_cancelled():
                return None
            try:
                simulation.step(control if number == 0 else None)
            except SimulationDiverged as error:
                diverged = (error.body, error.step, error.cause, error.advice)
                break
            if simulation.state.step % EVERY == 0:
                watch_law()
            if sample.figures:
                observation = simulation.observe()
                rows.append([figure.of(observation) for figure in sample.figures])
        if diverged:
            break
    watch_law()
    values = tuple(np.array(column) for column in zip(*rows, strict=True))
    return RolloutOutcome(simulation.state, values, diverged, largest, complaint)
