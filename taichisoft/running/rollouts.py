"""Many futures of one state, for controllers that plan, made on threads that stay ready."""

import queue
import threading
import weakref
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from taichisoft.contact.model import Model
from taichisoft.control.control import Control
from taichisoft.control.observation import ObservedFigure, find_figure
from taichisoft.errors import SimulationDiverged, TaichisoftError, nearest
from taichisoft.mechanics.state import State
from taichisoft.running.simulation import Simulation, check_simulation
from taichisoft.runtime.launch import forget_launches_of_thread
from taichisoft.runtime.machine_code import run_loops_alone
from taichisoft.step.divergence import EVERY
from taichisoft.step.time_stepper import TimeStepper


@dataclass(frozen=True)
class RolloutSample:
    """Start and controls of one future.

    Attributes:
        start: its first state.
        controls: requests, one after the other.
        steps_per_control: number of steps with each control.
        figures: what is kept of the observation after every step.
    """

    start: State
    controls: tuple[Control, ...]
    steps_per_control: int
    figures: tuple[ObservedFigure, ...]


@dataclass(frozen=True)
class RolloutOutcome:
    """Result of a sample.

    Attributes:
        state: the last state that was reached.
        values: of each figure after the steps that were made, each of shape (steps_made, ...).
        diverged: the arguments of the `SimulationDiverged` that ended it early, or None.
        stretch_over_law: see `Rollouts` [-].
        complaint: line about the first state beyond a law, or None.
    """

    state: State
    values: tuple[np.ndarray, ...]
    diverged: tuple[str, int, str, str] | None
    stretch_over_law: float
    complaint: str | None


def roll_out(simulation: TimeStepper, sample: RolloutSample, is_cancelled: Callable[[], bool]) -> RolloutOutcome | None:
    """Make the steps of a sample; None if it was cancelled meanwhile.

    Raises:
        ControlError: a control cannot be applied.
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
            over = max(simulation.strain_watch.over_law(state).values(), default=0.0)
            watched, largest = state.step, max(largest, over)
            if over > 1.0:
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


class RolloutThreads:
    """Threads that make samples; a launch does not hold Python's lock, so they run at once."""

    def __init__(self, count: int):
        """Start `count` threads."""
        self._jobs: queue.SimpleQueue[tuple[Arrivals, int, RolloutSample, Model] | None] = queue.SimpleQueue()
        self._arrivals: weakref.WeakSet[Arrivals] = weakref.WeakSet()  # they hold the simulation, which holds this
        self._threads = [threading.Thread(target=self._work, name="rollouts", daemon=True) for _ in range(count)]
        for thread in self._threads:
            thread.start()

    def submit(self, arrivals: "Arrivals", samples: Sequence[RolloutSample], model: Model) -> None:
        """Have samples of a model made, in their order."""
        self._arrivals.add(arrivals)
        for index, sample in enumerate(samples):
            self._jobs.put((arrivals, index, sample, model))

    def close(self) -> None:
        """End the threads; samples that are not done are cancelled, which a later read reports."""
        for arrivals in list(self._arrivals):
            arrivals.stop(TaichisoftError("the rollouts were ended by `Simulation.close`"))
        for _ in self._threads:
            self._jobs.put(None)
        for thread in self._threads:
            if thread is not threading.current_thread():  # which may delete the simulation
                thread.join()

    def _work(self) -> None:
        run_loops_alone()
        stepper: TimeStepper | None = None
        while (job := self._jobs.get()) is not None:
            arrivals, index, sample, model = job
            del job
            try:
                if stepper is None or stepper.model is not model:
                    stepper = TimeStepper(model)
                arrivals.add(index, roll_out(stepper, sample, arrivals.is_cancelled))
            except TaichisoftError as error:
                arrivals.fail(index, error)
            except Exception as error:  # who reads the result must be told
                text = " ".join(f"{type(error).__name__}: {error}".split())
                arrivals.fail(index, TaichisoftError(f"sample {index} of the rollouts: {text}"))
            del arrivals  # holds the simulation
        forget_launches_of_thread()


class Rollouts:
    """Futures of one state under several sequences of controls.

    All arrays have a row for each sample, in the order of the controls. Reading a result waits for it; `done` and
    `cancel` do not wait.

    Attributes:
        sample_count: number of samples.
        step_count: number of steps of each sample.
        figures: names of the figures, by which `rollouts["object_positions.cube"]` gives arrays.
        times: time at the end of each step [s], shape (step_count,).
    """

    def __init__(self, arrivals: "Arrivals", times: np.ndarray):
        """Give access to results as they arrive."""
        self.sample_count, self.step_count = len(arrivals.ended), len(times)
        self.figures = tuple(arrivals.values)
        self.times = times
        self._arrivals = arrivals

    def __getitem__(self, figure: str) -> np.ndarray:
        """Values of a figure after every step, shape (sample_count, step_count, ...); NaN after steps not made.

        Raises:
            TaichisoftError: the figure was not asked for; see `wait` for others.
        """
        if figure not in self.figures:
            raise TaichisoftError(
                f"figures: '{figure}' was not asked for; {nearest(str(figure), self.figures, 'there are')}"
            )
        self.wait()
        return self._arrivals.values[figure]

    @property
    def states(self) -> tuple[State, ...]:
        """The last state that each sample reached: `Simulation.restore` goes on from there."""
        self.wait()
        return tuple(self._arrivals.states)

    @property
    def errors(self) -> tuple[SimulationDiverged | None, ...]:
        """Why a sample ended early, None for one that did not diverge."""
        self.wait()
        return tuple(self._arrivals.errors)

    @property
    def complete(self) -> np.ndarray:
        """Whether all steps of a sample were made, shape (sample_count,): it neither diverged nor was cancelled."""
        self.wait()
        return self._arrivals.complete.copy()

    @property
    def stretch_over_law(self) -> np.ndarray:
        """Largest stretch of each sample over the largest stretch for which the law holds [-], shape (sample_count,).

        Above 1, forces are not realistic. It is evaluated after every 20th step of the simulation and at the end of the
        sample; 0 where no law has a known range, NaN for a sample that was cancelled.
        """
        self.wait()
        return self._arrivals.stretch_over_law.copy()

    @property
    def done(self) -> np.ndarray:
        """Whether a sample has ended by now, shape (sample_count,)."""
        return self._arrivals.ended.copy()

    def wait(self, time_limit: float | None = None) -> bool:
        """Wait until all samples have ended; returns whether they have. Ctrl and c cancels them.

        Warns the first time that samples of a simulation leave the range of a law.

        Args:
            time_limit: longest time to wait [s]; None: no limit.

        Raises:
            ControlError: a control cannot be applied.
            TaichisoftError: the simulation was closed, or a step failed.
        """
        try:
            ended = self._arrivals.wait(time_limit)
        except KeyboardInterrupt:
            self.cancel()
            raise
        self._arrivals.warn_beyond_law()
        return ended

    def cancel(self) -> None:
        """End samples that are not done, within a step; results so far stay."""
        self._arrivals.cancel()


class Arrivals:
    """The results of samples as they arrive, from any thread.

    Attributes:
        values: values of each figure by its name, each of shape (sample_count, step_count, ...).
        states: the last state of each sample.
        errors: why each sample ended early, or None.
        stretch_over_law: see `Rollouts`, shape (sample_count,).
        complete, ended: whether all steps of a sample were made; whether it has ended; shape (sample_count,).
        cancelled: whether the samples were cancelled.
    """

    def __init__(self, simulation: Simulation, samples: Sequence[RolloutSample]):
        """Prepare the arrays."""
        first, now = samples[0], simulation.observe()
        size = len(samples), len(first.controls) * first.steps_per_control
        self.values = {figure.name: np.full((*size, *figure.of(now).shape), np.nan) for figure in first.figures}
        self.states: list[State] = [first.start] * len(samples)
        self.errors: list[SimulationDiverged | None] = [None] * len(samples)
        self.complete, self.ended = np.zeros(len(samples), dtype=bool), np.zeros(len(samples), dtype=bool)
        self.stretch_over_law = np.full(len(samples), np.nan)
        self._complaints: dict[int, str] = {}
        self.cancelled = False
        self._simulation = simulation  # which ends the threads when it is deleted
        self._failure: TaichisoftError | None = None
        self._change = threading.Condition()

    def make_here(self, samples: Sequence[RolloutSample]) -> None:
        """Make the samples in this process, one after the other."""
        stepper = TimeStepper(self._simulation.model)
        for index, sample in enumerate(samples):
            try:
                self.add(index, roll_out(stepper, sample, self.is_cancelled))
            except TaichisoftError as error:
                self.fail(index, error)

    def is_cancelled(self) -> bool:
        """Whether the samples were cancelled."""
        return self.cancelled

    def stop(self, why: TaichisoftError) -> None:
        """Cancel what is not done, which a later read reports."""
        if not self.ended.all():
            self._failure = self._failure or why
        self.cancelled = True

    def wait(self, time_limit: float | None) -> bool:
        """See `Rollouts.wait`."""
        with self._change:
            ended = self._change.wait_for(lambda: bool(self.ended.all()), time_limit)
        if self._failure is not None:
            raise self._failure
        return ended

    def cancel(self) -> None:
        """End the samples that are being made, and skip the others."""
        self.cancelled = True

    def warn_beyond_law(self) -> None:
        """Warn of the first sample beyond a law, unless an earlier call has done so."""
        with self._change:
            first = min(self._complaints.items(), default=None)
        if first is not None:
            self._simulation.warn_of_rollouts(f"rollouts: sample {first[0]}: {first[1]}")

    def add(self, index: int, outcome: RolloutOutcome | None) -> None:
        """Take the result of a sample; None if it was cancelled."""
        with self._change:
            if outcome is not None:
                for column, values in zip(self.values.values(), outcome.values, strict=False):  # none after no step
                    column[index, : len(values)] = values
                self.states[index] = outcome.state
                self.errors[index] = SimulationDiverged(*outcome.diverged) if outcome.diverged else None
                self.complete[index] = outcome.diverged is None
                self.stretch_over_law[index] = outcome.stretch_over_law
                if outcome.complaint is not None:
                    self._complaints[index] = outcome.complaint
            self.ended[index] = True
            self._change.notify_all()

    def fail(self, index: int, error: TaichisoftError) -> None:
        """Take the error of a sample; the others are cancelled."""
        self._failure = self._failure or error
        self.cancel()
        self.add(index, None)


def rollouts(
    simulation: Simulation,
    controls: Sequence[Sequence[Control]],
    workers: int = 2,
    figures: Sequence[str] = (),
    steps_per_control: int = 1,
) -> Rollouts:
    """Make futures of the current state of a simulation, which does not change.

    The first call starts threads, which stay ready until `Simulation.close`, or until the simulation is deleted. A call
    returns at once; reading a result waits for it. The bits do not depend on the number of workers.

    Args:
        simulation: the simulation.
        controls: a sequence of controls for each sample, all of the same length; requests that a control does not
            mention stay.
        workers: number of threads, one for each free core; 0 makes the samples in this thread before it returns.
        figures: what to keep of every step: fields of `Observation` ("tip_positions", "object_positions.cube",
            "pressures.finger1.cavity", "normal_forces.finger1|cube") and of `State` ("state.position").
        steps_per_control: number of steps with each control.

    Raises:
        TaichisoftError: an argument is not valid, or a figure does not exist. Errors of the samples are raised when
            their results are read.
    """
    check_simulation(simulation)
    samples = _samples(simulation, controls, figures, steps_per_control)
    if isinstance(workers, bool) or not isinstance(workers, int) or workers < 0:
        raise TaichisoftError(f"workers = {workers!r}: must be a whole number of threads, or 0 for none")
    arrivals = Arrivals(simulation, samples)
    if workers == 0:
        arrivals.make_here(samples)
    else:
        threads = simulation.keep(("rollouts", workers), lambda: RolloutThreads(workers))
        threads.submit(arrivals, samples, simulation.model)
    steps = simulation.state.step + 1 + np.arange(len(samples[0].controls) * steps_per_control)
    return Rollouts(arrivals, steps * simulation.model.scene.time.step)


def _samples(
    simulation: Simulation, controls: Sequence[Sequence[Control]], names: Sequence[str], steps_per_control: int
) -> list[RolloutSample]:
    if isinstance(steps_per_control, bool) or not isinstance(steps_per_control, int) or steps_per_control < 1:
        raise TaichisoftError(f"steps_per_control = {steps_per_control!r}: must be a whole number, 1 or more")
    if isinstance(names, str):
        raise TaichisoftError(f"figures = '{names}': must be a sequence of names, as in [\"{names}\"]")
    try:
        rows = [tuple(row) for row in controls]
    except TypeError as error:
        message = "controls: must be a sequence of samples, each a sequence of controls: [[first, second], ...]"
        raise TaichisoftError(message) from error
    if not rows or not rows[0]:
        raise TaichisoftError("controls: must have a sample or more, each with a control or more")
    for number, row in enumerate(rows):
        if len(row) != len(rows[0]):
            raise TaichisoftError(
                f"controls: sample {number} has {len(row)}, sample 0 has {len(rows[0])}; all must have as many"
            )
        for control in row:
            if not isinstance(control, Control):
                raise TaichisoftError(f"controls: sample {number}: {control!r} must be a taichisoft.Control")
    observation, bodies = simulation.observe(), simulation.model.body_names
    figures = tuple(find_figure(name, observation, bodies) for name in names)
    return [RolloutSample(simulation.state, row, steps_per_control, figures) for row in rows]
