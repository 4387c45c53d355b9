"""Many futures of one state, for controllers that plan: `rollouts` makes them, in processes that stay ready."""

import pickle
import queue
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from taichisoft.base.worker import Link, Worker, WorkerLost
from taichisoft.contact.model import Model
from taichisoft.control.control import Control
from taichisoft.control.observation import ObservedFigure, find_figure
from taichisoft.errors import SimulationDiverged, TaichisoftError, nearest
from taichisoft.mechanics.state import State
from taichisoft.running.simulation import Simulation, check_simulation
from taichisoft.step.divergence import EVERY
from taichisoft.step.time_stepper import TimeStepper

# One future of a state: the same steps in whichever process makes them.


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


# Processes that make rollouts: each has the model and stays ready for the next call.

WORK = "taichisoft.running.rollouts:make_rollouts"
ONE_THREAD = {"TAICHISOFT_THREADS": "1"}
"""A process for each core is faster than threads, which wait for one another in every step."""


class Receiver(Protocol):
    """Takes the outcomes of samples, from any thread.

    Attributes:
        cancelled: whether nobody wants them any more.
    """

    cancelled: bool

    def add(self, index: int, outcome: RolloutOutcome | None) -> None:
        """Take what became of a sample; None if it was cancelled."""

    def fail(self, index: int, error: TaichisoftError) -> None:
        """Take the error by which a sample has no outcome."""


@dataclass(frozen=True)
class Task:
    """A sample to be made, and who takes its outcome."""

    model: Model
    sample: RolloutSample
    index: int
    receiver: Receiver


class RolloutProcesses:
    """A number of processes that share one queue of samples."""

    def __init__(self, count: int):
        """Start the threads that speak with the processes; each process starts with its first sample."""
        self._tasks: queue.SimpleQueue[Task | None] = queue.SimpleQueue()
        self._processes = [RolloutProcess(self._tasks) for _ in range(count)]

    def submit(self, tasks: Sequence[Task]) -> None:
        """Have samples made, after those submitted before."""
        for task in tasks:
            self._tasks.put(task)

    def cancel(self, receiver: Receiver) -> None:
        """End the samples of a receiver that are being made; its others are left out when their turn comes."""
        for process in self._processes:
            process.cancel(receiver)

    def close(self) -> None:
        """End the processes; what they have not finished fails."""
        for process in self._processes:
            process.close()
        for _ in self._processes:
            self._tasks.put(None)


class RolloutProcess:
    """A process, and the thread that hands it one sample after the other."""

    def __init__(self, tasks: "queue.SimpleQueue[Task | None]"):
        """Start the thread."""
        self._tasks = tasks
        self._worker: Worker | None = None
        self._model: Model | None = None
        self._running: Task | None = None
        self._closed = False
        self._sending = threading.Lock()
        threading.Thread(target=self._serve, name="rollouts", daemon=True).start()

    def cancel(self, receiver: Receiver) -> None:
        """End the sample that is being made if it is the receiver's."""
        with self._sending:
            if self._running is not None and self._running.receiver is receiver and self._worker is not None:
                self._worker.send(("cancel", id(self._running)))

    def close(self) -> None:
        """End the process at once."""
        with self._sending:
            self._closed = True
            if self._worker is not None:
                self._worker.process.kill()

    def _serve(self) -> None:
        while self._serve_next():
            pass
        if self._worker is not None:
            self._worker.end()

    def _serve_next(self) -> bool:
        """Wait for a task and do it; False when none will come. Between two tasks nothing refers to the first."""
        task = self._tasks.get()
        if task is None:
            return False
        try:
            task.receiver.add(task.index, None if task.receiver.cancelled else self._make(task))
        except TaichisoftError as error:
            task.receiver.fail(task.index, error)
        except Exception as error:  # a lost process; a control that cannot be pickled
            text = " ".join(str(error).split())
            task.receiver.fail(task.index, TaichisoftError(f"sample {task.index} of the rollouts: {text}"))
        return True

    def _make(self, task: Task) -> RolloutOutcome | None:
        with self._sending:
            if self._closed:
                raise TaichisoftError("the rollouts were ended by `Simulation.close`")
            worker = self._ready_worker()
            if self._model is not task.model:
                worker.send(("model", task.model))
                self._model = task.model
            worker.send(("sample", (id(task), task.sample)))
            self._running = task
        try:
            outcome: RolloutOutcome | None = worker.receive()
        except WorkerLost as error:
            if self._closed:
                raise TaichisoftError("the rollouts were ended by `Simulation.close`") from error
            raise
        finally:
            with self._sending:
                self._running = None
        return outcome

    def _ready_worker(self) -> Worker:
        """The process; another one where that was lost."""
        if self._worker is not None and not self._worker.alive:
            self._worker.end()
            self._worker = None
        if self._worker is None:
            self._worker, self._model = Worker(WORK, ONE_THREAD), None
        return self._worker


def make_rollouts(link: Link) -> None:
    """What a process does: it takes models and samples, and answers with the outcome of each sample."""
    simulation: TimeStepper | None = None
    with suppress(EOFError):  # the parent wants nothing more
        while True:
            kind, content = link.receive()
            if kind == "model":
                simulation = TimeStepper(content)
            elif kind == "sample":
                assert simulation is not None
                number, sample = content
                try:
                    link.send(roll_out(simulation, sample, _Cancellation(link, number)))
                except TaichisoftError as error:
                    link.fail(error)


class _Cancellation:
    """Whether the parent has cancelled a sample; while one is being made nothing else arrives."""

    def __init__(self, link: Link, number: int):
        self._link, self._number = link, number

    def __call__(self) -> bool:
        cancelled = False
        while self._link.has_message:
            message: tuple[str, Any] = self._link.receive()
            cancelled = cancelled or message == ("cancel", self._number)
        return cancelled


class Rollouts:
    """Futures of one state: what becomes of it under each of several sequences of controls.

    All arrays have a row for each sample, in the order of the controls. Reading a result waits for it; `done` and
    `cancel` do not wait.

    Attributes:
        sample_count: number of samples.
        step_count: number of steps of each sample.
        figures: names of the figures, by which `rollouts["object_positions.cube"]` gives arrays.
        times: time at the end of each step [s], shape (step_count,).
    """

    def __init__(self, arrivals: "Arrivals", times: np.ndarray):
        """Read what arrives."""
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
            asked = nearest(str(figure), self.figures, "there are")
            raise TaichisoftError(f"figures: '{figure}' was not asked for; {asked}")
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
        """Largest stretch of each sample over that up to which the body's law holds [-], shape (sample_count,).

        Above 1 it is beyond, and forces are not realistic. It is looked at after every 20th step of the simulation and
        at the end of the sample; 0 where no law has a known range, NaN for a sample that was cancelled.
        """
        self.wait()
        return self._arrivals.stretch_over_law.copy()

    @property
    def done(self) -> np.ndarray:
        """Whether a sample has ended by now, shape (sample_count,)."""
        return self._arrivals.ended.copy()

    def wait(self, time_limit: float | None = None) -> bool:
        """Wait until all samples have ended; returns whether they have. Ctrl and c cancels them.

        The first time that a simulation's samples leave the range of a law, it warns.

        Args:
            time_limit: longest time to wait [s]; None: as long as it takes.

        Raises:
            ControlError: a control asks for something impossible.
            TaichisoftError: a process was lost, or the simulation was closed.
        """
        try:
            ended = self._arrivals.wait(time_limit)
        except KeyboardInterrupt:
            self.cancel()
            raise
        self._arrivals.warn_beyond_law()
        return ended

    def cancel(self) -> None:
        """End what is not done yet, after at most a step; the results so far stay."""
        self._arrivals.cancel()


class Arrivals:
    """The results of samples as they arrive, from any thread.

    Attributes:
        values: values of each figure by its name, each of shape (sample_count, step_count, ...).
        states: the last state of each sample.
        errors: why each sample ended early, or None.
        stretch_over_law: see `Rollouts`, shape (sample_count,).
        complete, ended: whether all steps of a sample were made; whether it has ended; shape (sample_count,).
        cancelled: whether nobody wants the rest.
    """

    def __init__(self, simulation: Simulation, samples: Sequence[RolloutSample]):
        """Prepare the arrays."""
        first, now = samples[0], simulation.observe()
        size = len(samples), len(first.controls) * first.steps_per_control
        self.values = {one.name: np.full((*size, *one.of(now).shape), np.nan) for one in first.figures}
        self.states: list[State] = [first.start] * len(samples)
        self.errors: list[SimulationDiverged | None] = [None] * len(samples)
        self.complete, self.ended = np.zeros(len(samples), dtype=bool), np.zeros(len(samples), dtype=bool)
        self.stretch_over_law = np.full(len(samples), np.nan)
        self._complaints: dict[int, str] = {}
        self.cancelled = False
        self._simulation = simulation  # which ends the processes when it is deleted
        self._failure: TaichisoftError | None = None
        self._change = threading.Condition()
        self._processes: RolloutProcesses | None = None

    def make_here(self, samples: Sequence[RolloutSample]) -> None:
        """Make the samples in this process, one after the other."""
        own = TimeStepper(self._simulation.model)
        for index, sample in enumerate(samples):
            try:
                self.add(index, roll_out(own, sample, lambda: self.cancelled))
            except TaichisoftError as error:
                self.fail(index, error)

    def make_in(self, processes: RolloutProcesses, samples: Sequence[RolloutSample]) -> None:
        """Have the samples made by processes."""
        self._processes, model = processes, self._simulation.model
        processes.submit([Task(model, sample, index, self) for index, sample in enumerate(samples)])

    def wait(self, time_limit: float | None) -> bool:
        """Wait until all have ended; returns whether they have.

        Raises:
            TaichisoftError: a sample failed.
        """
        with self._change:
            ended = self._change.wait_for(lambda: bool(self.ended.all()), time_limit)
        if self._failure is not None:
            raise self._failure
        return ended

    def cancel(self) -> None:
        """End the samples that are being made, and leave out the others."""
        self.cancelled = True
        if self._processes is not None:
            self._processes.cancel(self)

    def warn_beyond_law(self) -> None:
        """Warn of the first sample beyond a law, unless that of an earlier call was told."""
        with self._change:
            first = min(self._complaints.items(), default=None)
        if first is not None:
            self._simulation.warn_of_rollouts(f"rollouts: sample {first[0]}: {first[1]}")

    def add(self, index: int, outcome: RolloutOutcome | None) -> None:
        """Take what became of a sample; None if it was cancelled."""
        with self._change:
            if outcome is not None:
                for column, values in zip(self.values.values(), outcome.values, strict=False):  # none after no step
                    column[index, : len(values)] = values
                self.states[index] = outcome.state.changed(**vars(outcome.state))  # read-only, also from a process
                self.errors[index] = SimulationDiverged(*outcome.diverged) if outcome.diverged else None
                self.complete[index] = outcome.diverged is None
                self.stretch_over_law[index] = outcome.stretch_over_law
                if outcome.complaint is not None:
                    self._complaints[index] = outcome.complaint
            self.ended[index] = True
            self._change.notify_all()

    def fail(self, index: int, error: TaichisoftError) -> None:
        """Take the error by which a sample has no outcome; the others are cancelled."""
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
    """Make futures of the present state of a simulation, which stays where it is.

    The first call starts the processes, which takes seconds; they stay ready until `Simulation.close`, or until the
    simulation is deleted. The call returns at once, and what it returns waits when a result is read. The bits do not
    depend on the number of workers.

    Args:
        simulation: the simulation.
        controls: a sequence of controls for each sample, all of the same length; what a control does not mention stays
            as it is.
        workers: number of processes, one for each free core; 0 makes the samples in this process before it returns.
        figures: what to keep of every step: fields of `Observation` ("tip_positions", "object_positions.cube",
            "pressures.finger1.cavity", "normal_forces.finger1|cube") and of `State` ("state.position").
        steps_per_control: number of steps for which each control stands.

    Raises:
        TaichisoftError: an argument is not valid, or a figure has another name. Errors of the samples are raised when
            their results are read.
    """
    check_simulation(simulation)
    samples = _samples(simulation, controls, figures, steps_per_control)
    if isinstance(workers, bool) or not isinstance(workers, int) or workers < 0:
        raise TaichisoftError(f"workers = {workers!r}: must be a whole number of processes, or 0 for none")
    arrivals = Arrivals(simulation, samples)
    if workers == 0:
        arrivals.make_here(samples)
    else:
        _refuse_what_cannot_be_sent(samples)
        arrivals.make_in(simulation.keep(("rollouts", workers), lambda: RolloutProcesses(workers)), samples)
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
    found = tuple(find_figure(name, observation, bodies) for name in names)
    return [RolloutSample(simulation.state, row, steps_per_control, found) for row in rows]


def _refuse_what_cannot_be_sent(samples: Sequence[RolloutSample]) -> None:
    for number, sample in enumerate(samples):
        try:
            pickle.dumps(sample.controls)
        except Exception as error:
            raise TaichisoftError(
                f"controls: sample {number} cannot be sent to a process: {error}; plain dictionaries and arrays can"
            ) from error
