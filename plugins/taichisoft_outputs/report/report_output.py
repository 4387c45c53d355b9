"""The output "report": one page with the pictures, plots and figures of a run, made at its end."""

import time
from pathlib import Path
from typing import TYPE_CHECKING

from taichisoft.atomic_file import atomic_file
from taichisoft.errors import TaichisoftError
from taichisoft.session import Output
from taichisoft_outputs.recording.reader import read_recording
from taichisoft_outputs.recording.recording_output import NeededRecording
from taichisoft_outputs.report.contents import collect
from taichisoft_outputs.report.report_page import report_page

if TYPE_CHECKING:
    from taichisoft.model import Model
    from taichisoft.state import State
    from taichisoft.step import StepReport

FILE_NAME = "report.html"


class ReportError(TaichisoftError):
    """A report cannot be written."""


class ReportOutput(Output):
    """Puts together what the outputs before it have left in the run's folder."""

    def __init__(self, folder: Path):
        self._recording = NeededRecording(folder)
        self._began: float | None = None

    def begin(self, model: "Model", state: "State") -> None:
        """Note the time: what is older in the folder belongs to another run.

        Raises:
            RecordingNeeded: this run has no recording.
        """
        self._recording.require("report")
        self._began = time.time()

    def record(self, state: "State", report: "StepReport") -> None:
        """Do nothing: the recording has all steps."""

    def end(self, outcome: str) -> None:
        """Write the page, also of a run that failed, unless it was interrupted or has no recording.

        A recording of an earlier run may lie in the folder.

        Raises:
            ReportError: the page cannot be written.
        """
        if self._began is not None and outcome != "interrupted":
            write_report(self._recording.path, began=self._began)


def write_report(recording: Path, path: Path | None = None, began: float | None = None) -> Path:
    """Write the report of a recording, and return its path.

    Args:
        recording: file of the recording.
        path: file of the report; report.html beside the recording when it is not given.
        began: time at which the run began, see `collect`.

    Raises:
        RecordingError: the recording does not exist.
        ReportError: the page cannot be written, or a picture cannot be read.
    """
    path = path or recording.parent / FILE_NAME
    with read_recording(recording) as opened:
        contents = collect(opened, began)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            page = report_page(contents, path.parent)
        except OSError as error:
            raise ReportError(f"{path}: not written: {error}") from error
    with atomic_file(path, ReportError) as partial:
        partial.write_text(page, encoding="utf-8", errors="replace")  # names of files need not be text
    return path
