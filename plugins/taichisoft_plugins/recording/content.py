"""What is in the HDF5 file of a recording, read as it stands at a moment; what cannot be read is one line."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from taichisoft_plugins.recording.layout import LAYOUT, UNFINISHED, RecordingError
from taichisoft_plugins.recording.still_file import StillFile
from taichisoft_plugins.recording.texts import read_text

PATIENCE = 2.0
"""How long what a run in progress is just writing is read again [s]; a write takes milliseconds."""
PAUSE = 0.02

Value = TypeVar("Value")


class DamagedContent(ValueError):
    """Something in the file is not what was written."""


WHAT_DAMAGE_RAISES = (OSError, RuntimeError, ValueError, KeyError, TypeError, AttributeError, OverflowError)
"""By h5py, and by those who make sense of what it gives."""


class Content:
    """An open file, opened again where a run writes into it."""

    def __init__(self, path: Path, patience: float):
        """Open the file; what a run may be writing is read again for so long [s].

        Raises:
            RecordingError: it is missing, no HDF5, no recording, or of another layout.
        """
        self.path, self._patience = path, patience
        self._file: Any = None
        self._datasets: dict[str, Any] = {}
        if not path.is_file():
            raise RecordingError(f"{path}: no such recording; `taichisoft run` writes one into its output folder")
        self._still = self._opened()
        try:
            self._file = self._as_hdf5()
        except WHAT_DAMAGE_RAISES as error:
            self._still.close()
            raise RecordingError(f"{path}: not readable as HDF5: {_one_line(error)}; {self._advice()}") from error
        try:
            _check_layout(path, self._file, self._advice())
        except RecordingError:
            self.close()
            raise

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._datasets.clear()
            self._file.close()
            self._file = None
        self._still.close()

    def dataset(self, path: str) -> Any:
        """A dataset of the open file, for functions that `read` calls; it is looked up once, as that takes its time."""
        if path not in self._datasets:
            self._datasets[path] = self._file[path]
        return self._datasets[path]

    def open_again(self) -> None:
        """See what has been written since.

        Raises:
            RecordingError: the file can no longer be opened.
        """
        self.close()
        self._still = self._opened()
        self.read(lambda file: file["frames"])

    def progress(self) -> tuple[str, int]:
        """The outcome, and how many frames count.

        Raises:
            RecordingError: there is none, or it is damaged.
        """
        return self.read(_progress)

    def read(self, function: Callable[[Any], Value]) -> Value:
        """What a function makes of the open HDF5 file.

        Raises:
            RecordingError: what it reads is damaged. If a run may be writing it, it has been tried again for a while.
        """
        deadline = time.monotonic() + self._patience
        while True:
            try:
                if self._file is None:
                    self._file = self._as_hdf5()
                return function(self._file)
            except WHAT_DAMAGE_RAISES as error:
                if not self._still.is_marked or time.monotonic() > deadline:
                    raise RecordingError(f"{self.path}: damaged: {_one_line(error)}; {self._advice()}") from error
            time.sleep(PAUSE)
            self.close()
            self._still = self._opened()

    def _opened(self) -> StillFile:
        try:
            return StillFile(self.path)
        except OSError as error:
            raise RecordingError(f"{self.path}: cannot be read: {error.strerror or error}") from error

    def _as_hdf5(self) -> Any:
        import h5py

        return h5py.File(self._still, "r")

    def _advice(self) -> str:
        return f"taichisoft repair {self.path} -o NEW.h5 rescues all frames that are whole"


def _progress(file: Any) -> tuple[str, int]:
    outcome = bytes(file["outcome"][()]).decode(errors="replace")  # first: when it is there, no more frames come
    count, check = (int(number) for number in file["frames"][:])
    if check != -count or count < 1:
        raise DamagedContent("how many frames there are is not known")
    return outcome or UNFINISHED, count


def _check_layout(path: Path, file: Any, advice: str) -> None:
    try:
        version, layout = read_text(file.attrs, "taichisoft_version"), file.attrs.get("layout", "none")
    except KeyError as error:
        raise RecordingError(f"{path}: not a recording of taichisoft: {_one_line(error)}") from error
    except WHAT_DAMAGE_RAISES as error:
        raise RecordingError(f"{path}: damaged: {_one_line(error)}; {advice}") from error
    if layout != LAYOUT:
        raise RecordingError(
            f"{path}: taichisoft {version} wrote it in layout {layout}, this version reads layout {LAYOUT}; run the "
            "scene again"
        )


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split()).strip("'\"") or type(error).__name__
