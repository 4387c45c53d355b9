"""The output "recording": everything that a run computed, in one HDF5 file that survives a killed run."""

import math
import os
import time
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from taichisoft.atomic_file import named_os_errors
from taichisoft.session.output import Output
from taichisoft_plugins.recording.bodies import write_constants
from taichisoft_plugins.recording.file import RecordingFile
from taichisoft_plugins.recording.layout import FILE_NAME, SIGNAL_NAMES, RecordingError
from taichisoft_plugins.recording.rows import Frame, RowMaker, SolverFigures
from taichisoft_plugins.recording.texts import as_signal_names, write_texts
from taichisoft_plugins.slipping import Slipping

if TYPE_CHECKING:
    from taichisoft.model import Model
    from taichisoft.session.session import Session
    from taichisoft.state import State
    from taichisoft.step.report import StepReport

BUFFERED_FRAMES = 100
"""Most frames that are kept in memory between two writes, which a killed run loses."""
BEFORE = "recording-before.h5"
"""Name of the recording that a full one becomes."""
USUAL_LIMIT = 4.0
"""Room for the recording of a run without an end [GB]: seven minutes or so of a gripper at real time."""
LONGEST_BUFFERED = 2.0
"""Time [s] after which frames are written in any case, so that a slow run loses less and can be watched."""


class RecordingOutput(Output):
    """Writes `recording.h5` into the folder of a run."""

    def __init__(self, folder: Path, every: int = 1, compress: bool = False, limit: float | None = None):
        """Prepare a recording.

        Args:
            folder: folder of the run.
            every: steps from frame to frame; the last step before the run ends or starts anew is a frame in any case.
            compress: pack what has a number for every node: a quarter smaller, at thirty times the time.
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
        self._every, self._compress = every, compress
        self._part_count = 1
        self._file: RecordingFile | None = None
        self._frames: list[Frame] = []
        self._skipped: Frame | None = None
        self._solver = SolverFigures()
        self._slide = np.zeros((0, 3))

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
        """Keep the step if it is to be a frame, and write when enough are kept.

        Raises:
            RecordingError: the file cannot be written.
        """
        self._solver.add(report)
        self._slide = self._slide + self._slipping.add(state)
        frame = Frame(state, report, self._solver, self._slide)
        if self._solver.steps < self._every:
            self._skipped = frame
            return
        self._keep(frame)
        if self._bundle_is_full() or time.monotonic() - self._written_at > LONGEST_BUFFERED:
            self._write()
            if self.limit is not None and self._file is not None and self._file.size > 0.5e9 * self.limit:
                self._begin_next_part(frame)

    def restart(self, state: "State") -> None:
        """The frames go on with the first state again; what came before stays."""
        self._keep_skipped()
        self._slipping.restart(state)
        self._keep(self._first_frame(state))

    def end(self, outcome: str) -> None:
        """Write what is still in memory and how the run ended; the file is closed whatever happens.

        Raises:
            RecordingError: the file cannot be written.
        """
        if self._file is None:
            return
        try:
            self._keep_skipped()
            self._write()
        finally:
            file, self._file = self._file, None
            file.close(outcome)

    def _first_frame(self, state: "State") -> Frame:
        """The frame of a first state, from which the steps go on."""
        self._solver, self._slide = SolverFigures(), np.zeros_like(state.rigid_position)
        return Frame(state, None, self._solver, self._slide)

    @property
    def _before(self) -> Path:
        return self.path.with_name(BEFORE)

    def _begin_file(self, first: Frame) -> None:
        self._file = RecordingFile(self.path, self._describe, self._rows.rows([first], 0), self._compress)
        self._written_at = time.monotonic()

    def _begin_next_part(self, frame: Frame) -> None:
        """Go on in another file, whose first frame is the last one of this."""
        assert self._file is not None
        if self._part_count <= 2:
            dropped = "; what was there before is dropped" if self._part_count == 2 else ""
            warnings.warn(
                f"{self.path}: half of {self.limit:g} GB is full: it is {BEFORE} now, and another one begins{dropped}; "
                "--record-limit allows more, --every records less",
                stacklevel=2,
            )
        self._part_count += 1
        file, self._file = self._file, None
        file.close("continued in another recording")
        with named_os_errors(self.path, RecordingError):
            self._name_full_file()
        self._begin_file(frame)

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

    def _keep(self, frame: Frame) -> None:
        self._frames.append(frame)
        self._skipped, self._solver = None, SolverFigures()
        self._slide = np.zeros_like(self._slide)

    def _keep_skipped(self) -> None:
        """Keep the last step, whatever its number."""
        if self._skipped is not None:
            self._keep(self._skipped)

    def _bundle_is_full(self) -> bool:
        """Bundles end where chunks do, so that none of these is written twice."""
        written = self._file.frame_count if self._file is not None else 0
        return (written + len(self._frames)) % BUFFERED_FRAMES == 0

    def _describe(self, root: Any) -> None:
        rows = self._rows
        pairs = ["|".join(pair) for pair in rows.pairs]
        materials = list(self._model.material_names)
        columns = {"cavities": rows.cavities, "cables": rows.cables, "pairs": pairs, "materials": materials}
        write_constants(root, self._model, self._every, columns)
        root[SIGNAL_NAMES] = as_signal_names(rows.signals)
        write_texts(root.require_group("contacts").attrs, "names", self._model.body_names)

    def _write(self) -> None:
        """Add the frames that are kept to the file."""
        frames, self._frames = self._frames, []
        self._written_at = time.monotonic()
        if self._file is not None and frames:
            rows = self._rows.rows(frames, self._file.contact_count)
            self._file.append(rows, self._rows.signals)


def limit_endless_recordings(session: "Session") -> None:
    """Give the recordings of a run without an end the usual limit, unless they have one."""
    for output in session.outputs:
        if isinstance(output, RecordingOutput) and output.limit is None and math.isinf(session.step_count):
            output.limit = USUAL_LIMIT
