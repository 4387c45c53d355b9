"""The file of a recording: written record by record during the run, and rewritten as plain HDF5 at its end.

Nothing that was written is written again but the outcome, in its own place: a process that is killed, or a disk that is
full, costs the record that was begun. The first records have the outcome, what does not change, as the image of an HDF5
file, and the types of all numbers; then every frame has a record of figures and one of fields.
"""

import glob
import io
import json
import math
import os
import struct
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from enum import IntEnum
from pathlib import Path
from typing import Any, Self
from zlib import crc32

import numpy as np

from taichisoft.base import atomic_file, named_os_errors
from taichisoft_outputs.recording.layout import (
    COUNTS,
    FIELDS,
    QUANTITIES,
    UNFINISHED,
    DamagedContent,
    RecordingError,
    group_of,
)

# The file of a recording while its run goes on: records one behind the other, each with a checksum.

RUNNING_MARK = b"\x93taichi\n"
"""Every record begins with it."""
HEADER = struct.Struct("<8sIIQII")
"""Mark, kind, number, length, checksum of the content, checksum of the header before."""
OUTCOME_LENGTH = 2000
"""Bytes of the outcome, which is written in place."""
SEARCHED = 2**20
"""Bytes that are searched at a time for the next record behind a damaged one."""


class RecordKind(IntEnum):
    """What a record has; the number of figures and fields is that of their frame."""

    OUTCOME, CONSTANTS, FORMAT, SIGNALS, FIGURES, FIELDS = range(6)


class FrameFormat:
    """The types of a frame's numbers.

    Attributes:
        types: numpy's name of the type, and the shape of a row, of each quantity by path.
    """

    def __init__(self, types: Mapping[str, tuple[str, Sequence[int]]]):
        self.types = {path: (name, tuple(shape)) for path, (name, shape) in types.items()}
        self.figures = np.dtype([(path, *self.types[path]) for path in QUANTITIES if path not in FIELDS])

    @classmethod
    def of_frame(cls, rows: Mapping[str, np.ndarray]) -> Self:
        """The format of the rows of a frame, as `rows.RowMaker` makes them."""
        return cls({path: (row.dtype.str, row.shape[group_of(path) != "steps" :]) for path, row in rows.items()})

    def encoded(self, rows: Mapping[str, np.ndarray]) -> tuple[bytes, bytes]:
        """The figures and the fields of a frame."""
        figures = np.zeros((), self.figures)
        for path in self.figures.names or ():
            figures[path] = rows[path]
        fields = [np.ascontiguousarray(rows[path], self.types[path][0]).tobytes() for path in FIELDS]
        return figures.tobytes(), b"".join(fields)

    def fields(self, figures: np.void, content: bytes) -> dict[str, np.ndarray]:
        """The fields of a frame with these figures, by path, shape (row_count, ...)."""
        rows, place = {}, 0
        for path in FIELDS:
            name, shape = self.types[path]
            count = 1 if group_of(path) == "steps" else int(figures[COUNTS[group_of(path)]])
            rows[path] = np.frombuffer(content, name, count * math.prod(shape), place).reshape(count, *shape)
            place += rows[path].nbytes
        return rows


class RunningFile:
    """Writes the frames of a run, each as soon as it is given.

    Attributes:
        path: place of the file.
        frame_count: frames that were written.
        size: length of the file [bytes].
        is_whole: whether all frames that were given are in it.
    """

    def __init__(self, path: Path, constants: bytes, rows: Mapping[str, np.ndarray], signals: Sequence[str] = ()):
        """Make a new file, or replace the one that is there when the first frame is in the new one.

        Args:
            path: place of the file; its folder is made when it does not exist.
            constants: image of an HDF5 file with what does not change.
            rows, signals: the first frame, as for `append`.

        Raises:
            RecordingError: the file cannot be made.
        """
        self.path, self.frame_count, self.size, self.is_whole = path, 0, 0, True
        self._format, self._signals = FrameFormat.of_frame(rows), 0
        with named_os_errors(path, RecordingError):
            path.parent.mkdir(parents=True, exist_ok=True)
            for begun in path.parent.glob(f".{glob.escape(path.name)}.*.partial"):  # of processes that were killed
                begun.unlink(missing_ok=True)
        with atomic_file(path, RecordingError) as begun:
            self._file = begun.open("xb", buffering=0)
            try:
                self._write(_outcome(UNFINISHED) + _record(RecordKind.CONSTANTS, 0, constants))
                self._write(_record(RecordKind.FORMAT, 0, json.dumps(self._format.types).encode()))
                self._append(rows, signals)
            except BaseException:
                self._file.close()
                raise

    def append(self, rows: Mapping[str, np.ndarray], signals: Sequence[str] = ()) -> None:
        """Add a frame.

        Args:
            rows: by path, the row of a quantity of `steps`, and all rows of one of another group.
            signals: names of the columns of signals that have one by now.

        Raises:
            RecordingError: the frame cannot be written; those before it stay.
        """
        self.is_whole = False
        if not self._is_in_place():
            raise RecordingError(f"{self.path}: was removed or replaced while the run went on; its frames are lost")
        with named_os_errors(self.path, RecordingError):
            self._append(rows, signals)
        self.is_whole = True

    def close(self, outcome: str) -> None:
        """Say how the run ended; a file that nobody closes says that it has not ended."""
        with self._file, suppress(OSError):  # its place is there already: this needs no room
            os.pwrite(self._file.fileno(), _outcome(outcome), 0)

    def _append(self, rows: Mapping[str, np.ndarray], signals: Sequence[str]) -> None:
        if len(signals) > self._signals:
            self._signals = len(signals)
            self._write(_record(RecordKind.SIGNALS, 0, json.dumps(list(signals)).encode()))
        figures, fields = self._format.encoded(rows)
        number = self.frame_count
        self._write(_record(RecordKind.FIGURES, number, figures) + _record(RecordKind.FIELDS, number, fields))
        self.frame_count += 1

    def _write(self, content: bytes) -> None:
        """Write all of it: a system may write a part, and refuse the rest when it is asked for."""
        rest = memoryview(content)
        while rest:
            rest = rest[self._file.write(rest) or 0 :]
        self.size += len(content)

    def _is_in_place(self) -> bool:
        try:
            return os.path.samestat(self.path.stat(), os.fstat(self._file.fileno()))
        except OSError:
            return False


def _record(kind: RecordKind, number: int, content: bytes) -> bytes:
    header = HEADER.pack(RUNNING_MARK, kind, number, len(content), crc32(content), 0)[:-4]
    return header + struct.pack("<I", crc32(header)) + content


def _outcome(text: str) -> bytes:
    return _record(RecordKind.OUTCOME, 0, text.encode(errors="replace")[:OUTCOME_LENGTH].ljust(OUTCOME_LENGTH, b"\0"))


class RunningRecording:
    """Reads such a file as it stands when it is opened.

    Attributes:
        constants: the open HDF5 file with what does not change.
        format: the types of the numbers of a frame.
        outcome: how the run ended.
        frame_count: frames that were written.
        size: length of the file [bytes].
        signals: names of the columns of signals.
    """

    def __init__(self, file: io.BufferedReader):
        """Take an open file and find its records.

        Raises:
            OSError: it cannot be read.
            DamagedContent: what does not change is damaged.
        """
        import h5py

        self._file, self.size = file, os.fstat(file.fileno()).st_size
        self._records: dict[tuple[int, int], tuple[int, int, int]] = {}
        self._find_records()
        self.constants = h5py.File(io.BytesIO(self._content(RecordKind.CONSTANTS)), "r")
        self.format = FrameFormat(json.loads(self._content(RecordKind.FORMAT)))
        self.outcome = self._outcome()
        self.frame_count = 1 + max((number for kind, number in self._records if kind == RecordKind.FIELDS), default=-1)

    @property
    def signals(self) -> list[str]:
        """Names of the columns of signals."""
        return json.loads(self._content(RecordKind.SIGNALS)) if (RecordKind.SIGNALS, 0) in self._records else []

    def close(self) -> None:
        """Close the file."""
        self.constants.close()
        self._file.close()

    def rows(self, path: str, first: int, end: int) -> np.ndarray:
        """A quantity in the frames from `first` to before `end`: a row for each, or all rows that belong to them.

        Raises:
            DamagedContent: it is not what was written.
        """
        rows: np.ndarray = self._fields(first, end)[path] if path in FIELDS else self._figures(first, end)[path]
        return rows

    def all_rows(self, first: int, end: int) -> dict[str, np.ndarray]:
        """All quantities in these frames by path."""
        figures = self._figures(first, end)
        return {path: figures[path] for path in figures.dtype.names or ()} | self._fields(first, end)

    def _figures(self, first: int, end: int) -> np.ndarray:
        contents = [self._content(RecordKind.FIGURES, number) for number in range(first, end)]
        return np.frombuffer(b"".join(contents), self.format.figures)

    def _fields(self, first: int, end: int) -> dict[str, np.ndarray]:
        frames = [
            self.format.fields(figures, self._content(RecordKind.FIELDS, number))
            for number, figures in zip(range(first, end), self._figures(first, end), strict=True)
        ]
        return {path: np.concatenate([frame[path] for frame in frames]) for path in FIELDS}

    def _outcome(self) -> str:
        with suppress(DamagedContent):  # it may just be written
            return self._content(RecordKind.OUTCOME).rstrip(b"\0").decode(errors="replace")
        return UNFINISHED

    def _content(self, kind: RecordKind, number: int = 0) -> bytes:
        name = kind.name.lower() if kind < RecordKind.FIGURES else f"{kind.name.lower()} of frame {number}"
        if (kind, number) not in self._records:
            raise DamagedContent(f"{name} are missing")
        place, length, checksum = self._records[kind, number]
        content = os.pread(self._file.fileno(), length, place)
        if len(content) < length or crc32(content) != checksum:
            raise DamagedContent(f"{name} are not what was written")
        return content

    def _find_records(self) -> None:
        """Go from header to header; where one is damaged, on to the next mark."""
        place, size = 0, self.size
        while place + HEADER.size <= size:
            header = os.pread(self._file.fileno(), HEADER.size, place)
            mark, kind, number, length, checksum, of_header = HEADER.unpack(header)
            if mark != RUNNING_MARK or crc32(header[:-4]) != of_header:
                place = self._next_mark(place + 1)
                continue
            place += HEADER.size
            if place + length <= size:
                self._records[kind, number] = place, length, checksum
            place += length

    def _next_mark(self, place: int) -> int:
        """Where the next mark is from a place on; behind the end of the file where none is."""
        while found := os.pread(self._file.fileno(), SEARCHED, place):
            if (offset := found.find(RUNNING_MARK)) >= 0:
                return place + offset
            place += max(len(found) - len(RUNNING_MARK) + 1, 1)
        return place + HEADER.size


# The file of a recording whose run has ended: HDF5 with a checksum of every page, so that HDF5 sees no damaged byte.
#
# HDF5 leaves room for others at the beginning of a file, its user block. The checksums stand there.

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
