"""The output "recording": everything that a run computed, in one file that survives a killed run."""

import math
import os
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from taichisoft.actuators import ACTUATOR_KINDS
from taichisoft.atomic_file import named_os_errors
from taichisoft.caller_warnings import warn_caller
from taichisoft.errors import TaichisoftError
from taichisoft.session import Output
from taichisoft_outputs.recording.bodies import write_constants
from taichisoft_outputs.recording.finished_file import constants_image, finish
from taichisoft_outputs.recording.layout import FILE_NAME, RecordingError
from taichisoft_outputs.recording.rows import Frame, RowMaker, SolverFigures, controls_of
from taichisoft_outputs.recording.running_file import RunningFile
from taichisoft_outputs.slipping import Slipping

if TYPE_CHECKING:
    from taichisoft.model import Model
    from taichisoft.session import Session
    from taichisoft.state import State
    from taichisoft.step import StepReport

BEFORE = "recording-before.h5"
"""Name of the recording that a full one becomes."""
USUAL_LIMIT = 2.0
"""Room for the recording of a run without an end [GB]: nine minutes or so of a gripper at real time."""
STEPS_BETWEEN_STATES = 10
"""Steps after which a frame has a whole state again; going on from between two makes them again."""


class RecordingOutput(Output):
    """Writes `recording.h5` into the folder of a run."""

    def __init__(self, folder: Path, every: int = 1, limit: float | None = None):
        """Prepare a recording.

        Args:
            folder: folder of the run.
            every: steps from frame to frame; the last step before the run ends or starts again is a frame in any case.
            limit: most room of the recording [GB]: when half of it is full, the file becomes `recording-before.h5`, in
                place of an older one, and another begins. None for `USUAL_LIMIT` in runs without an end, and none in
                others.

        Raises:
            RecordingError: `every` is less than 1, or `limit` not positive.
        """
        if limit is not None and not limit > 0.0:
            raise RecordingError(f"--record-limit {limit:g}: must be a positive number of gigabytes")
        if every < 1:
            raise RecordingError(f"--every {every}: must be at least 1, the number of steps from frame to frame")
        self.path = Path(folder) / FILE_NAME
        self.limit = limit
        self._every, self._part_count = every, 1
        self._file: RunningFile | None = None
        self._last: Frame | None = None
        self._solver, self._slide = SolverFigures(), np.zeros((0, 3))
        self._controls: list[dict[str, np.ndarray]] = []
        self._steps_since_state = 0

    def begin(self, model: "Model", state: "State") -> None:
        """Write scene and bodies; the state before the first step becomes frame 0.

        Raises:
            RecordingError: the file cannot be written.
        """
        self._model = model
        self._rows = RowMaker(model)
        self._slipping = Slipping(len(model.scene.soft_bodies), state)
        self._begin_file(self._first_frame(state))
        with named_os_errors(self.path, RecordingError):
            self._before.unlink(missing_ok=True)

    def record(self, state: "State", report: "StepReport") -> None:
        """Take a step; the step before it is written if it is to be a frame.

        Raises:
            RecordingError: the file cannot be written.
        """
        self._write_or_skip_last()
        self._solver.add(report)
        self._slide = self._slide + self._slipping.add(state)
        self._last = Frame(state, report, self._solver, self._slide, self.save_controller(), self._controls)

    def restart(self, state: "State") -> None:
        """The frames go on with the first state again; what came before stays."""
        self._write_last(has_state=True)
        self._slipping.restart(state)
        self._last = self._first_frame(state)
        self._write_last(has_state=True)

    def end(self, outcome: str) -> None:
        """Write the last step and how the run ended, and make an HDF5 file of it; the file is closed whatever happens.

        Raises:
            RecordingError: the file cannot be written.
        """
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

    def _first_frame(self, state: "State") -> Frame:
        """The frame of a first state, from which the steps go on."""
        self._begin_next_frame(state)
        return Frame(state, None, self._solver, self._slide, self.save_controller())

    def _begin_next_frame(self, state: "State") -> None:
        self._solver, self._slide, self._controls = SolverFigures(), np.zeros_like(state.rigid_position), []

    def _write_or_skip_last(self) -> None:
        """Make a frame of the last step if it is due, now that another step follows."""
        if self._last is None:
            return
        if self._solver.steps < self._every:
            self._controls.append(controls_of(self._last.state, self._model.actuators))
        else:
            is_due = self._steps_since_state + self._solver.steps >= STEPS_BETWEEN_STATES
            is_full = self.limit is not None and self._file is not None and self._file.size > 0.5e9 * self.limit
            frame = self._last
            self._write_last(is_due or is_full)
            if is_full:
                self._begin_next_part(frame)

    def _write_last(self, has_state: bool) -> None:
        """Make a frame of the last step, whatever its number."""
        frame, self._last = self._last, None
        if frame is None or self._file is None:
            return
        self._steps_since_state = 0 if has_state else self._steps_since_state + frame.solver.steps
        self._begin_next_frame(frame.state)
        self._file.append(self._rows.rows(frame, has_state), self._rows.signals)

    @property
    def _before(self) -> Path:
        return self.path.with_name(BEFORE)

    def _begin_file(self, first: Frame) -> None:
        rows = self._rows.rows(first, has_state=True)
        constants = constants_image(self._describe)
        self._file = RunningFile(self.path, constants, rows, self._rows.signals)

    def _begin_next_part(self, frame: Frame) -> None:
        """Go on in another file, whose first frame is the last one of this."""
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
        self._begin_file(replace(frame, controls=()))

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
        columns = {**actuators, "pairs": pairs, "materials": materials}
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
        """See that the recording is being written; to be called when the output begins.

        Raises:
            RecordingNeeded: no output has begun to write it.
        """
        if self._stamp() in (None, self._before):
            raise RecordingNeeded(f"output '{output}' needs the output 'recording' before it: recording,{output}")

    def _stamp(self) -> tuple[int, int, int] | None:
        if not self.path.is_file():
            return None
        about = self.path.stat()
        return about.st_mtime_ns, about.st_size, about.st_ino
