"""Outputs that need the recording at the end know before the first step whether the run writes one."""

from pathlib import Path

from taichisoft.errors import TaichisoftError
from taichisoft_plugins.recording.layout import FILE_NAME


class RecordingNeeded(TaichisoftError):
    """An output of a run needs the recording, which the run does not write."""


class NeededRecording:
    """The recording of a run, for an output that reads it at the end.

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
