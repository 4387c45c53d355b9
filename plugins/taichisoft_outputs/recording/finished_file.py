"""The file of a recording whose run has ended: HDF5 with a checksum of every page, so that HDF5 sees no damaged byte.

HDF5 leaves room for others at the beginning of a file, its user block. The checksums stand there.
"""

import io
import math
import os
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np

from taichisoft.atomic_file import atomic_file, named_os_errors
from taichisoft_outputs.recording.layout import COUNTS, QUANTITIES, DamagedContent, RecordingError, group_of
from taichisoft_outputs.recording.running_file import MARK as RUNNING_MARK
from taichisoft_outputs.recording.running_file import FrameFormat, RunningRecording

MARK = b"taichisoft recording\n"
HEAD = struct.Struct(f"<{len(MARK)}sQQ")
"""Mark, length of the user block, length of the whole file; checksums of the pages behind the block follow, then one of
all this."""
PAGE = 4096
FRAMES_PER_CHUNK = 20
LARGEST_CHUNK = 2**20
"""Most bytes of a chunk: HDF5 reads and unpacks whole ones."""
PACKING = {"compression": "gzip", "compression_opts": 1, "shuffle": True}
METADATA = 2**23
"""More than HDF5 writes beside the frames [bytes]."""


def constants_image(describe: Callable[[Any], None]) -> bytes:
    """An HDF5 file with what `describe` writes, in memory."""
    import h5py

    image = io.BytesIO()  # an image of the core driver has a wrong checksum before HDF5 2
    with h5py.File(image, "w", libver="latest") as file:
        describe(file)
    return image.getvalue()


def copy_constants(source: Any, target: Any) -> None:
    """Copy what does not change from one open HDF5 file to another."""
    target.attrs.update(source.attrs)
    for name in source:
        if name not in ("outcome", "steps", *COUNTS):
            source.copy(name, target)
    for group in ("steps", "contacts"):
        target.require_group(group).attrs.update(source[group].attrs)


def finish(path: Path) -> None:
    """Put an HDF5 file in the place of that of a run that has just ended.

    Raises:
        RecordingError: it cannot be written; what was there is as it was.
    """
    with named_os_errors(path, RecordingError), path.open("rb") as file:
        running = RunningRecording(file)
        try:
            _write(running, path)
        finally:
            running.close()


def _write(running: RunningRecording, path: Path) -> None:
    import h5py

    room = running.size + running.size // 16 + METADATA
    block = 2 ** (HEAD.size + 4 * (room // PAGE + 2)).bit_length()
    with atomic_file(path, RecordingError) as begun:
        # HDF5 crashes the process when a write fails: a full disk has to show before.
        _reserve(begun, room + block)
        with h5py.File(begun, "w", libver="latest", userblock_size=block, locking=False) as file:
            _reserve(begun, room + block)
            copy_constants(running.constants, file)
            file["outcome"] = running.outcome
            file["steps"].attrs.create("signals", running.signals, dtype=h5py.string_dtype())
            _write_frames(running, file)
            file.flush()
            used = file.id.get_filesize()
        with begun.open("r+b") as written:
            written.truncate(min(used, begun.stat().st_size))
            written.write(user_block(written, block))


def _reserve(path: Path, length: int) -> None:
    with path.open("ab") as file:
        if hasattr(os, "posix_fallocate"):
            os.posix_fallocate(file.fileno(), 0, length)


def _write_frames(running: RunningRecording, file: Any) -> None:
    count = running.frame_count
    offsets: dict[str, np.ndarray] = {"steps": np.arange(count + 1)}
    for group, path in COUNTS.items():
        offsets[group] = np.concatenate([[0], np.cumsum(running.rows(path, 0, count))])
        file[offset_path(group)] = offsets[group][:-1]
        file[offset_path(group)].attrs["unit"] = "1"
    datasets = {path: _create(file, path, int(offsets[group_of(path)][-1]), running.format) for path in QUANTITIES}
    file.flush()  # now and after each bundle of frames, so that what is cut off at the end costs the last frames
    for first in range(0, count, FRAMES_PER_CHUNK):
        end = min(first + FRAMES_PER_CHUNK, count)
        for path, rows in running.all_rows(first, end).items():
            if rows.size:
                offset = offsets[group_of(path)]
                datasets[path][offset[first] : offset[end]] = rows
        file.flush()


def _create(file: Any, path: str, length: int, format: FrameFormat) -> Any:
    name, shape = format.types[path]
    row_bytes = max(math.prod(shape) * np.dtype(name).itemsize, 1)
    # States hardly pack: the last bits of doubles of a moving mesh are noise.
    most = 1 if group_of(path) == "states" else max(1, min(length, FRAMES_PER_CHUNK, LARGEST_CHUNK // row_bytes))
    settings = {"chunks": (most, *shape), **({} if group_of(path) == "states" else PACKING)}
    dataset = file.create_dataset(path, (length, *shape), name, **(settings if length * math.prod(shape) else {}))
    dataset.attrs["unit"] = QUANTITIES[path].unit
    return dataset


def offset_path(group: str) -> str:
    """The dataset with the first row of each frame in a group of `layout.COUNTS`."""
    return f"steps/{group[:-1]}_offset"


def user_block(file: io.BufferedRandom, block: int) -> bytes:
    """The beginning of a file whose user block is so long [bytes]: the checksums of what is behind it."""
    file.seek(block)
    sums = [crc32(page) for page in iter(lambda: file.read(PAGE), b"")]
    head = HEAD.pack(MARK, block, file.tell()) + np.array(sums, "<u4").tobytes()
    file.seek(0)
    return head + struct.pack("<I", crc32(head))


class CheckedFile(io.RawIOBase):
    """The bytes of a finished file, for h5py's driver "fileobj": a page that is not as it was written is an error."""

    def __init__(self, file: io.BufferedReader):
        """Take an open file.

        Raises:
            OSError: it cannot be read.
            DamagedContent: its checksums are not what was written.
        """
        self._file, self._place = file, 0
        head = os.pread(file.fileno(), HEAD.size, 0).ljust(HEAD.size)
        _, self._block, self._size = HEAD.unpack(head)
        length = 4 * (-(-(self._size - self._block) // PAGE))
        if not 0 <= length < self._block <= self._size:
            raise DamagedContent("the checksums are not what was written")
        sums = os.pread(file.fileno(), length + 4, HEAD.size)
        if sums[length:] != struct.pack("<I", crc32(head + sums[:length])):
            raise DamagedContent("the checksums are not what was written")
        self._sums = np.frombuffer(sums[:length], "<u4")

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Go to a place; the end is that of the file when it was whole."""
        self._place = offset + {os.SEEK_SET: 0, os.SEEK_CUR: self._place, os.SEEK_END: self._size}[whence]
        return self._place

    def readinto(self, buffer) -> int:  # type: ignore[no-untyped-def] # any writable buffer
        """Fill the whole buffer.

        Raises:
            OSError: a page is missing, or not what was written.
        """
        view = memoryview(buffer).cast("B")
        first = max(self._place - self._block, 0) // PAGE
        start = self._block + first * PAGE if self._place >= self._block else self._place
        end = min(start + -(-(self._place + len(view) - start) // PAGE) * PAGE, self._size)
        content = os.pread(self._file.fileno(), max(end - start, 0), start)
        if start >= self._block:
            for number in range(-(-len(content) // PAGE)):
                page = content[number * PAGE : (number + 1) * PAGE]
                if crc32(page) != self._sums[first + number]:
                    raise OSError(f"the {PAGE} bytes from {start + number * PAGE} on are not what was written")
        part = content[self._place - start :][: len(view)]
        if len(part) < len(view):
            raise OSError(f"the file ends at byte {start + len(content)}")
        view[:] = part
        self._place += len(view)
        return len(view)


class FinishedRecording:
    """Reads a finished file.

    Attributes:
        constants: the open HDF5 file.
        outcome: how the run ended.
        frame_count: number of frames.
        signals: names of the columns of signals.
    """

    def __init__(self, file: io.BufferedReader):
        """Take an open file.

        Raises:
            OSError, KeyError: it is damaged.
            DamagedContent: its checksums are damaged.
        """
        import h5py

        self._file = file
        self.constants = h5py.File(CheckedFile(file), "r", rdcc_nbytes=8 * LARGEST_CHUNK)
        self._datasets: dict[str, Any] = {}
        self.outcome = self.constants["outcome"][()].decode()
        self.signals = [str(name) for name in self.constants["steps"].attrs["signals"]]
        self.frame_count = len(self._dataset("steps/time"))

    def close(self) -> None:
        """Close the file."""
        self._datasets = {}
        self.constants.close()
        self._file.close()

    def rows(self, path: str, first: int, end: int) -> np.ndarray:
        """A quantity in the frames from `first` to before `end`: a row for each, or all rows that belong to them."""
        group = group_of(path)
        if group != "steps" and end > first:
            offset = self._dataset(offset_path(group))
            first, end = int(offset[first]), int(offset[end - 1] + self._dataset(COUNTS[group])[end - 1])
        rows: np.ndarray = self._dataset(path)[first:end]
        return rows

    def _dataset(self, path: str) -> Any:
        """A dataset, looked up once: that takes its time."""
        if path not in self._datasets:
            self._datasets[path] = self.constants[path]
        return self._datasets[path]


def open_recording(file: io.BufferedReader) -> RunningRecording | FinishedRecording | None:
    """What is in an open file, in whichever form it begins; None where it is neither.

    Raises:
        OSError, ValueError, KeyError: it is damaged.
    """
    start = os.pread(file.fileno(), len(MARK), 0)
    if start == MARK:
        return FinishedRecording(file)
    return RunningRecording(file) if start.startswith(RUNNING_MARK) else None
