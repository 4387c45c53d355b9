"""The output "recording": everything that a run computed, in one file that survives a killed run."""

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from taichisoft.base import named_os_errors, warn_caller
from taichisoft.errors import TaichisoftError
from taichisoft.mechanics import ACTUATOR_KINDS
from taichisoft.running import Output
from taichisoft_outputs.recording.bodies import write_constants
from taichisoft_outputs.recording.layout import (
    CONTROLS,
    FILE_NAME,
    OF_PAIRS,
    QUANTITIES,
    SIGNAL_COUNT,
    RecordingError,
    group_of,
)
from taichisoft_outputs.recording.recording_file import RunningFile, constants_image, finish
from taichisoft_outputs.run_figures import Slipping

if TYPE_CHECKING:
    from taichisoft.contact import Model
    from taichisoft.mechanics import Actuators, State
    from taichisoft.running import Session
    from taichisoft.step import StepReport

# The rows of a recording: what is written about each instant of a run.


@dataclass
class SolverFigures:
    """How the solver fared in all steps since the last instant.

    Attributes:
        steps: number of these steps.
        iterations, residual, max_penetration: the largest of these steps, see `StepReport`.
        converged: whether all of them converged.
        seconds: time of all of them together [s].
    """

    steps: int = 0
    iterations: int = 0
    residual: float = 0.0
    max_penetration: float = 0.0
    converged: bool = True
    seconds: float = 0.0

    def add(self, report: "StepReport") -> None:
        """Take a step into account."""
        self.steps += 1
        self.iterations = max(self.iterations, report.iterations)
        self.residual = max(self.residual, report.residual)
        self.max_penetration = max(self.max_penetration, report.max_penetration)
        self.converged = self.converged and report.converged
        self.seconds += report.step_time


def controls_of(state: "State", actuators: "Actuators") -> dict[str, np.ndarray]:
    """What a controller acted through in the step to a state, by the paths of `layout.CONTROLS`."""
    return {path: QUANTITIES[path].of(state, actuators) for path in CONTROLS}


@dataclass(frozen=True)
class Instant:
    """A state and how it came about; states never change, so nothing is copied.

    Attributes:
        state: the state at the end of the step.
        report: the report of the step; None for the state before the first one.
        solver: figures of the steps since the last instant.
        slide: way of each rigid body against what holds it since the last instant [mm], shape (rigid_count, 3).
        controller: what the controller remembers after the step, as JSON; empty where it does not save.
        controls: `controls_of` the steps since the last instant, without its own.
    """

    state: "State"
    report: "StepReport | None"
    solver: SolverFigures
    slide: np.ndarray
    controller: str = ""
    controls: Sequence[Mapping[str, np.ndarray]] = ()


class RowMaker:
    """Makes the rows of instants.

    Attributes:
        pairs: bodies of the columns of `normal_force`, `peak_pressure` and the like: all that could touch.
        signals: names of the columns of `signals`, of those that the controller has had by now.
    """

    def __init__(self, model: "Model"):
        self._model = model
        self.pairs = list(combinations_with_replacement(model.body_names, 2))
        self.signals: list[str] = []
        self._left_out: set[str] = set()
        # A pair may come with its bodies the other way round.
        self._pair_column = {(second, first): column for column, (first, second) in enumerate(self.pairs)}
        self._pair_column |= {pair: column for column, pair in enumerate(self.pairs)}

    def rows(self, instant: Instant, has_state: bool) -> dict[str, np.ndarray]:
        """The rows of an instant by the paths of `layout.QUANTITIES`: one of `steps`, any number of the other groups.

        Args:
            has_state: whether a run can go on from it without the steps before.
        """
        solver, state, actuators = instant.solver, instant.state, self._model.actuators
        coordinates = actuators.own_coordinates(state)
        rows = {path: self._of_state(path, instant, has_state) for path in QUANTITIES if QUANTITIES[path].state_field}
        memory = np.frombuffer(instant.controller.encode(), np.uint8)
        figures = {
            "controllers/saved": memory,
            "steps/controller_count": len(memory),
            "steps/state_count": int(has_state),
            "steps/control_count": len(instant.controls),
            "steps/contact_count": len(state.contact_point),
            **{
                f"steps/{kind.coordinate.name}": actuators.of(kind, coordinates)
                for kind in ACTUATOR_KINDS
                if kind.coordinate.observed
            },
            **self._of_pairs(instant),
            "steps/slide": instant.slide,
            "steps/signals": self._signals(instant.report),
            "steps/max_penetration": float(solver.max_penetration),
            "steps/iterations": int(solver.iterations),
            "steps/residual": float(solver.residual),
            "steps/converged": bool(solver.converged),
            "steps/step_time": solver.seconds / max(solver.steps, 1),
        }
        return rows | {path: np.asarray(value) for path, value in figures.items()}

    def _of_state(self, path: str, instant: Instant, has_state: bool) -> np.ndarray:
        values, group = np.asarray(QUANTITIES[path].of(instant.state, self._model.actuators)), group_of(path)
        if group == "controls":
            controls = np.empty((len(instant.controls), *values.shape), values.dtype)
            for row, step in zip(controls, instant.controls, strict=True):
                row[...] = step[path]
            return controls
        if group == "states":
            return values[None][: int(has_state)]
        return values.astype(np.float32) if QUANTITIES[path].single else values

    def _signals(self, report: "StepReport | None") -> np.ndarray:
        """The controller's signals in their columns; NaN where it has none."""
        row = np.full(SIGNAL_COUNT, np.nan)
        for name, value in (report.signals if report is not None else {}).items():
            if name not in self.signals and len(self.signals) < SIGNAL_COUNT:
                self.signals.append(name)
            if name in self.signals:
                row[self.signals.index(name)] = value
            elif name not in self._left_out:
                self._left_out.add(name)
                warn_caller(
                    f"the recording has room for {SIGNAL_COUNT} signals of the controller; '{name}' is left out"
                )
        return row

    def _of_pairs(self, instant: Instant) -> dict[str, np.ndarray]:
        """The figures of pairs in their columns; a pair without contacts has 0."""
        seen, rows = None, {f"steps/{figure.name}": np.zeros(len(self.pairs)) for figure in OF_PAIRS}
        if instant.report is not None:
            seen = instant.report.observation.truth
        elif len(instant.state.contact_body_pair):
            from taichisoft.control import Observer

            # A run that goes on from a recorded state begins with contacts and without a report.
            seen = Observer(self._model).truth(instant.state)
        for figure in OF_PAIRS if seen is not None else ():
            for pair, value in figure.values(seen).items():
                rows[f"steps/{figure.name}"][self._pair_column[pair]] = value
        return rows


BEFORE = "recording-before.h5"
"""Name of the recording that a full one becomes."""
USUAL_LIMIT = 2.0
"""Room for the recording of a run without an end [GB]: nine minutes or so of a gripper at real time."""
STEPS_BETWEEN_STATES = 10
"""Steps after which an instant has a whole state again; going on from between two makes them again."""


class RecordingOutput(Output):
    """Writes `recording.h5` into the folder of a run."""

    def __init__(self, folder: Path, every: int = 1, limit: float | None = None):
        """Prepare a recording.

        Args:
            folder: folder of the run.
            every: steps from instant to instant; the last one before the run ends or starts again is one in any case.
            limit: most room of the recording [GB]: when half of it is full, the file becomes `recording-before.h5`, in
                place of an older one, and another begins. None for `USUAL_LIMIT` in runs without an end, and none in
                others.
        """
        if limit is not None and not limit > 0.0:
            raise RecordingError(f"--record-limit {limit:g}: must be a positive number of gigabytes")
        if every < 1:
            raise RecordingError(f"--every {every}: must be at least 1, the number of steps from instant to instant")
        self.path = Path(folder) / FILE_NAME
        self.limit = limit
        self._every, self._part_count = every, 1
        self._file: RunningFile | None = None
        self._last: Instant | None = None
        self._solver, self._slide = SolverFigures(), np.zeros((0, 3))
        self._controls: list[dict[str, np.ndarray]] = []
        self._steps_since_state = 0

    def begin(self, model: "Model", state: "State") -> None:
        """Write scene and bodies; the state before the first step becomes instant 0."""
        self._model = model
        self._rows = RowMaker(model)
        self._slipping = Slipping(len(model.scene.soft_bodies), state)
        self._begin_file(self._first_instant(state))
        with named_os_errors(self.path, RecordingError):
            self._before.unlink(missing_ok=True)

    def record(self, state: "State", report: "StepReport") -> None:
        """Take a step; the step before it is written if it is to be an instant."""
        self._write_or_skip_last()
        self._solver.add(report)
        self._slide = self._slide + self._slipping.add(state)
        self._last = Instant(state, report, self._solver, self._slide, self.save_controller(), self._controls)

    def restart(self, state: "State") -> None:
        """The instants go on with the first state again; what came before stays."""
        self._write_last(has_state=True)
        self._slipping.restart(state)
        self._last = self._first_instant(state)
        self._write_last(has_state=True)

    def end(self, outcome: str) -> None:
        """Write the last step and how the run ended, close the file in any case, and make an HDF5 file of it."""
        if self._file is None:
            return
        file, is_whole = self._file, False
        try:
            self._write_last(has_state=True)
            is_whole = file.is_whole
        finally:
            self._file = None
            file.close(outcome)
        if is_whole:
            self._finish()

    def _finish(self) -> None:
        """Make HDF5 files; where that cannot be done, what was recorded stays as it is."""
        for path in [self._before, self.path][self._part_count == 1 :]:
            try:
                finish(path)
            except RecordingError as error:
                makes = f"`taichisoft recording repair {path} -o NEW.h5` makes one"
                warn_caller(f"{error}; the recording is whole, but not yet an HDF5 file: {makes}")

    def _first_instant(self, state: "State") -> Instant:
        self._begin_next_instant(state)
        return Instant(state, None, self._solver, self._slide, self.save_controller())

    def _begin_next_instant(self, state: "State") -> None:
        self._solver, self._slide, self._controls = SolverFigures(), np.zeros_like(state.rigid_position), []

    def _write_or_skip_last(self) -> None:
        """Make an instant of the last step if it is due, now that another step follows."""
        if self._last is None:
            return
        if self._solver.steps < self._every:
            self._controls.append(controls_of(self._last.state, self._model.actuators))
        else:
            is_due = self._steps_since_state + self._solver.steps >= STEPS_BETWEEN_STATES
            is_full = self.limit is not None and self._file is not None and self._file.size > 0.5e9 * self.limit
            instant = self._last
            self._write_last(is_due or is_full)
            if is_full:
                self._begin_next_part(instant)

    def _write_last(self, has_state: bool) -> None:
        instant, self._last = self._last, None
        if instant is None or self._file is None:
            return
        self._steps_since_state = 0 if has_state else self._steps_since_state + instant.solver.steps
        self._begin_next_instant(instant.state)
        self._file.append(self._rows.rows(instant, has_state), self._rows.signals)

    @property
    def _before(self) -> Path:
        return self.path.with_name(BEFORE)

    def _begin_file(self, first: Instant) -> None:
        rows = self._rows.rows(first, has_state=True)
        constants = constants_image(self._describe)
        self._file = RunningFile(self.path, constants, rows, self._rows.signals)

    def _begin_next_part(self, instant: Instant) -> None:
        """Go on in another file, whose first instant is the last one of this."""
        assert self._file is not None
        if self._part_count <= 2:
            dropped = "; what was there before is dropped" if self._part_count == 2 else ""
            warn_caller(
                f"{self.path}: half of {self.limit:g} GB is full: it is {BEFORE} now, and another one begins{dropped}; "
                "--record-limit allows more, --every records less"
            )
        self._part_count += 1
        file, self._file = self._file, None
        file.close("continued in another recording")
        with named_os_errors(self.path, RecordingError):
            self._name_full_file()
        self._begin_file(replace(instant, controls=()))

    def _name_full_file(self) -> None:
        """Give the full file its second name; it has the first one until the next file takes that, so one is there."""
        linked = self.path.with_name(f".{FILE_NAME}.full.partial")
        linked.unlink(missing_ok=True)
        try:
            os.link(self.path, linked)
        except OSError:  # a file system without hard links
            self.path.replace(self._before)
        else:
            linked.replace(self._before)

    def _describe(self, root: Any) -> None:
        rows = self._rows
        pairs = ["|".join(pair) for pair in rows.pairs]
        materials = list(self._model.material_names)
        actuators = {kind.plural: self._model.actuators.names_of(kind) for kind in ACTUATOR_KINDS}
        air = self._model.scene.air
        network = {"air_nodes": air.nodes, "air_parts": list(air.parts), "air_drives": air.drives}
        columns = {**actuators, **network, "pairs": pairs, "materials": materials}
        write_constants(root, self._model, self._every, columns)


def limit_endless_recordings(session: "Session") -> None:
    """Give the recordings of a run without an end the usual limit, unless they have one."""
    for output in session.outputs:
        if isinstance(output, RecordingOutput) and output.limit is None and math.isinf(session.step_count):
            output.limit = USUAL_LIMIT


class RecordingNeeded(TaichisoftError):
    """An output of a run needs the recording, which the run does not write."""


class NeededRecording:
    """The recording of a run, for an output that reads it at the end and must know before the first step that it comes.

    Attributes:
        path: place of the file.
    """

    def __init__(self, folder: Path):
        """Look into the folder of a run before any output has begun: a recording that is there now is an older one."""
        self.path = Path(folder) / FILE_NAME
        self._before = self._stamp()

    def require(self, output: str) -> None:
        """See that the recording is being written; to be called when the output begins."""
        if self._stamp() in (None, self._before):
            raise RecordingNeeded(f"output '{output}' needs the output 'recording' before it: recording,{output}")

    def _stamp(self) -> tuple[int, int, int] | None:
        if not self.path.is_file():
            return None
        about = self.path.stat()
        return about.st_mtime_ns, about.st_size, about.st_ino
