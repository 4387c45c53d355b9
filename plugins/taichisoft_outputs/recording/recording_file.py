"""The file of a recording: written record by record during the run, and rewritten as plain HDF5 at its end.

Nothing that was written is written again but the outcome, in its own place: a process that is killed, or a disk that is
full, costs the record that was begun. The first records have the outcome, what does not change, as the image of an HDF5
file, and the types of all numbers; then every instant has a record of figures and one of fields.

Every byte of the HDF5 file is under one of HDF5's own checksums: its format 1.10 has them for metadata, and its filter
`fletcher32` for datasets.
"""

import glob
import io
import json
import math
import os
import struct
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from pathlib import Path
from typing import Any, Self
from zlib import crc32

import numpy as np

from taichisoft.base import atomic_file, named_os_errors, warn_caller
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
    """What a record has; the number of figures and fields is that of their instant."""

    OUTCOME, CONSTANTS, FORMAT, SIGNALS, FIGURES, FIELDS = range(6)


class InstantFormat:
    """The types of an instant's numbers.

    Attributes:
        types: numpy's name of the type, and the shape of a row, of each quantity by path.
    """

    def __init__(self, types: Mapping[str, tuple[str, Sequence[int]]]):
        self.types = {path: (name, tuple(shape)) for path, (name, shape) in types.items()}
        self.figures = np.dtype([(path, *self.types[path]) for path in QUANTITIES if path not in FIELDS])

    @classmethod
    def of_rows(cls, rows: Mapping[str, np.ndarray]) -> Self:
        """The format of the rows of an instant, as `rows.RowMaker` makes them."""
        return cls({path: (row.dtype.str, row.shape[group_of(path) != "steps" :]) for path, row in rows.items()})

    def encoded(self, rows: Mapping[str, np.ndarray]) -> tuple[bytes, bytes]:
        """The figures and the fields of an instant."""
        figures = np.zeros((), self.figures)
        for path in self.figures.names or ():
            figures[path] = rows[path]
        fields = [np.ascontiguousarray(rows[path], self.types[path][0]).tobytes() for path in FIELDS]
        return figures.tobytes(), b"".join(fields)

    def fields(self, figures: np.void, content: bytes) -> dict[str, np.ndarray]:
        """The fields of an instant with these figures, by path, shape (row_count, ...)."""
        rows, place = {}, 0
        for path in FIELDS:
            name, shape = self.types[path]
            count = 1 if group_of(path) == "steps" else int(figures[COUNTS[group_of(path)]])
            rows[path] = np.frombuffer(content, name, count * math.prod(shape), place).reshape(count, *shape)
            place += rows[path].nbytes
        return rows


class RunningFile:
    """Writes the instants of a run, each as soon as it is given.

    Attributes:
        path: place of the file.
        instant_count: instants that were written.
        size: length of the file [bytes].
        is_whole: whether all instants that were given are in it.
    """

    def __init__(self, path: Path, constants: bytes, rows: Mapping[str, np.ndarray], signals: Sequence[str] = ()):
        """Make a new file, or replace the one that is there when the first instant is in the new one.

        Args:
            path: place of the file; its folder is made when it does not exist.
            constants: image of an HDF5 file with what does not change.
            rows, signals: the first instant, as for `append`.
        """
        self.path, self.instant_count, self.size, self.is_whole = path, 0, 0, True
        self._format, self._signals = InstantFormat.of_rows(rows), 0
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
        """Add an instant.

        Args:
            rows: by path, the row of a quantity of `steps`, and all rows of one of another group.
            signals: names of the columns of signals that have one by now.
        """
        self.is_whole = False
        if not self._is_in_place():
            raise RecordingError(f"{self.path}: was removed or replaced while the run went on; its instants are lost")
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
        number = self.instant_count
        self._write(_record(RecordKind.FIGURES, number, figures) + _record(RecordKind.FIELDS, number, fields))
        self.instant_count += 1

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
        format: the types of the numbers of an instant.
        outcome: how the run ended.
        instant_count: instants that were written.
        size: length of the file [bytes].
        signals: names of the columns of signals.
    """

    def __init__(self, file: io.BufferedReader):
        """Take an open file and find its records."""
        import h5py

        self._file, self.size = file, os.fstat(file.fileno()).st_size
        self._records: dict[tuple[int, int], tuple[int, int, int]] = {}
        self._find_records()
        self.constants = h5py.File(io.BytesIO(self._content(RecordKind.CONSTANTS)), "r")
        self.format = InstantFormat(json.loads(self._content(RecordKind.FORMAT)))
        self.outcome = self._outcome()
        numbers = [number for kind, number in self._records if kind == RecordKind.FIELDS]
        self.instant_count = 1 + max(numbers, default=-1)

    @property
    def signals(self) -> list[str]:
        """Names of the columns of signals."""
        return json.loads(self._content(RecordKind.SIGNALS)) if (RecordKind.SIGNALS, 0) in self._records else []

    def close(self) -> None:
        """Close the file."""
        self.constants.close()
        self._file.close()

    def rows(self, path: str, first: int, end: int) -> np.ndarray:
        """A quantity in the instants from `first` to before `end`: a row for each, or all rows that belong to them."""
        rows: np.ndarray = self._fields(first, end)[path] if path in FIELDS else self._figures(first, end)[path]
        return rows

    def all_rows(self, first: int, end: int) -> dict[str, np.ndarray]:
        """All quantities in these instants by path."""
        figures = self._figures(first, end)
        return {path: figures[path] for path in figures.dtype.names or ()} | self._fields(first, end)

    def _figures(self, first: int, end: int) -> np.ndarray:
        contents = [self._content(RecordKind.FIGURES, number) for number in range(first, end)]
        return np.frombuffer(b"".join(contents), self.format.figures)

    def _fields(self, first: int, end: int) -> dict[str, np.ndarray]:
        instants = [
            self.format.fields(figures, self._content(RecordKind.FIELDS, number))
            for number, figures in zip(range(first, end), self._figures(first, end), strict=True)
        ]
        return {path: np.concatenate([instant[path] for instant in instants]) for path in FIELDS}

    def _outcome(self) -> str:
        with suppress(DamagedContent):  # it may just be written
            return self._content(RecordKind.OUTCOME).rstrip(b"\0").decode(errors="replace")
        return UNFINISHED

    def _content(self, kind: RecordKind, number: int = 0) -> bytes:
        name = kind.name.lower() if kind < RecordKind.FIGURES else f"{kind.name.lower()} of instant {number}"
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


# The file of a recording whose run has ended: plain HDF5.

FORMAT = ("v110", "v110")
"""The oldest of HDF5's formats with checksums of all metadata, which HDF5 1.10 and later read."""
END_OF_FILE = struct.Struct("<28xQ")
"""Where an HDF5 file has its length."""
INSTANTS_PER_CHUNK = 20
CHUNK = 512
"""Bytes of a chunk of rows of which an instant has any number: one that fills later is written anew."""
LARGEST_CHUNK = 2**20
"""Most bytes of a chunk: HDF5 reads and unpacks whole ones."""
METADATA = 2**23
"""More than HDF5 writes beside the instants [bytes]."""
WHAT_DAMAGE_RAISES = (OSError, RuntimeError, ValueError, KeyError, TypeError, AttributeError, OverflowError)
"""By h5py, and where its answers are used."""


def write_array(group: Any, name: str, values: Any) -> None:
    """Write an array into a new dataset."""
    values = np.asarray(values)
    rows = min(len(values), LARGEST_CHUNK // max(values[:1].nbytes, 1))
    group.create_dataset(name, data=values, **(_stored(values.shape[1:], rows) if values.size else {}))


def write_texts(group: Any, name: str, texts: Sequence[str]) -> None:
    """Write texts into a new dataset."""
    write_array(group, name, _encoded(texts))


def write_text(attributes: Any, name: str, text: str) -> None:
    """Write a short text into an attribute."""
    attributes.create(name, _encoded([text])[0], dtype=_encoded([text]).dtype)


def _encoded(texts: Sequence[str]) -> np.ndarray:
    """Texts of a fixed length: HDF5 keeps others where it has no checksum."""
    import h5py

    encoded = [text.encode(errors="replace") for text in texts]
    return np.array(encoded, h5py.string_dtype("utf-8", max([1, *map(len, encoded)])))


def _stored(row: Sequence[int], rows: int) -> dict[str, Any]:
    """How a dataset is stored whose rows have a shape, with so many in a chunk.

    A page of zeros has the right fletcher32, but cannot be unpacked.
    """
    chunks = (max(rows, 1), *(max(side, 1) for side in row))
    return {"chunks": chunks, "shuffle": True, "compression": "gzip", "compression_opts": 1, "fletcher32": True}


def constants_image(describe: Callable[[Any], None]) -> bytes:
    """An HDF5 file with what `describe` writes, in memory."""
    import h5py

    image = io.BytesIO()  # an image of the core driver has a wrong checksum before HDF5 2
    with h5py.File(image, "w", libver=FORMAT) as file:
        describe(file)
    return image.getvalue()


def finish(path: Path) -> None:
    """Put an HDF5 file in the place of that of a run that has just ended."""
    with named_os_errors(path, RecordingError), path.open("rb") as file:
        running = RunningRecording(file)
        try:
            rescue = convert(running, path)
        finally:
            running.close()
    if rescue.damage:
        warn_caller(f"{path}: {len(rescue.whole)} of {rescue.instant_count} instants are whole: {rescue.damage}")


@dataclass(frozen=True)
class Rescue:
    """What of a recording is in a new file.

    Attributes:
        instant_count: instants that the recording says it has.
        whole: numbers of those that are whole, which the new file has.
        damage: what is wrong with the first one that is not; empty where all are whole.
    """

    instant_count: int
    whole: list[int]
    damage: str


def convert(source: "RunningRecording | FinishedRecording", path: Path) -> Rescue:
    """Write an HDF5 file with every instant of a recording that is whole."""
    import h5py

    capacity = source.size + source.size // 16 + METADATA
    with atomic_file(path, RecordingError) as begun:
        # HDF5 crashes the process when a write fails: a full disk has to show before.
        _reserve(begun, capacity)
        with h5py.File(begun, "w", libver=FORMAT, locking=False) as file:
            _reserve(begun, capacity)
            for name in source.constants:
                if name not in ("steps", *COUNTS):
                    source.constants.copy(name, file)
            for name, value in source.constants.attrs.items():
                file.attrs.create(name, value, dtype=source.constants.attrs.get_id(name).dtype)
            file["columns"].pop("signals", None)
            write_texts(file["columns"], "signals", source.signals)
            whole, damage = _copy_instants(source, file)
            count = source.instant_count
            outcome = f"repaired: {len(whole)} of {count} instants were whole" if damage else source.outcome
            write_text(file.attrs, "outcome", outcome)
            file.flush()
            used = file.id.get_filesize()
        os.truncate(begun, used)
        if not whole:
            raise RecordingError(f"{path}: not written: none of the {count} instants is whole: {damage}")
    return Rescue(count, whole, damage)


def _reserve(path: Path, length: int) -> None:
    with path.open("ab") as file:
        if hasattr(os, "posix_fallocate"):
            os.posix_fallocate(file.fileno(), 0, length)


def _copy_instants(source: "RunningRecording | FinishedRecording", file: Any) -> tuple[list[int], str]:
    """Copy what is whole, and give the numbers of these instants and what is wrong with the first other one."""
    whole: list[int] = []
    damage = ""
    datasets: dict[str, Any] = {}
    lengths: Counter[str] = Counter()
    for first in range(0, source.instant_count, INSTANTS_PER_CHUNK):
        end = min(first + INSTANTS_PER_CHUNK, source.instant_count)
        parts = [(first, end)]
        while parts:
            start, stop = parts.pop()
            try:
                rows = source.all_rows(start, stop)
            except WHAT_DAMAGE_RAISES as error:
                if stop - start > 1:
                    parts += [(number, number + 1) for number in reversed(range(start, stop))]
                else:
                    damage = damage or f"instant {start}: {one_line(error)}"
            else:
                _append(file, rows, datasets, lengths)
                whole += range(start, stop)
        file.flush()  # so that what is cut off at the end costs the last instants
    return whole, damage


def _append(file: Any, rows: dict[str, np.ndarray], datasets: dict[str, Any], lengths: Counter[str]) -> None:
    """Add the rows of instants; `lengths` are those of the datasets of each group before."""
    count = len(rows["steps/time"])
    starts = {group: np.cumsum(rows[path]) - rows[path] + lengths[group] for group, path in COUNTS.items()}
    for path, values in [*rows.items(), *((offset_path(group), start) for group, start in starts.items())]:
        if path not in datasets:
            datasets[path] = _create(file, path, values.shape[1:], values.dtype)
        if len(values):
            before = lengths[group_of(path)]
            datasets[path].resize(before + len(values), axis=0)
            if values.size:
                datasets[path][before:] = values
    lengths.update({group: int(rows[path].sum()) for group, path in COUNTS.items()}, steps=count)


def _create(file: Any, path: str, shape: tuple[int, ...], dtype: np.dtype) -> Any:
    row_bytes = max(math.prod(shape) * dtype.itemsize, 1)
    rows = min(INSTANTS_PER_CHUNK, LARGEST_CHUNK // row_bytes) if group_of(path) == "steps" else CHUNK // row_bytes
    unlimited = (None, *(side or None for side in shape))
    dataset = file.create_dataset(path, (0, *shape), dtype, maxshape=unlimited, **_stored(shape, rows))
    dataset.attrs["unit"] = QUANTITIES[path].unit if path in QUANTITIES else "1"
    return dataset


def offset_path(group: str) -> str:
    """The dataset with the first row of each instant in a group of `layout.COUNTS`."""
    return f"steps/{group[:-1]}_offset"


def one_line(error: BaseException) -> str:
    """What an error says, or its kind where it says nothing."""
    return " ".join(str(error).split()).strip("'\"") or type(error).__name__


class FinishedRecording:
    """Reads a finished file.

    Attributes:
        constants: the open HDF5 file.
        size: length of the file [bytes].
    """

    def __init__(self, path: Path):
        """Open a file."""
        import h5py

        self._datasets: dict[str, Any] = {}
        self.size = path.stat().st_size
        try:
            self.constants = h5py.File(path, "r", locking=False, rdcc_nbytes=8 * LARGEST_CHUNK)
        except OSError as error:
            if "truncated" not in str(error):
                raise
            content = path.read_bytes()  # HDF5 opens no file whose end is missing
            (length,) = END_OF_FILE.unpack_from(content)
            self.constants = h5py.File(io.BytesIO(content.ljust(length, b"\0")), "r")

    @cached_property
    def outcome(self) -> str:
        """How the run ended."""
        return str(self.constants.attrs["outcome"].decode())

    @cached_property
    def signals(self) -> list[str]:
        """Names of the columns of signals."""
        return list(self.constants["columns/signals"].asstr()[:])

    @cached_property
    def instant_count(self) -> int:
        """Number of instants."""
        return len(self._dataset("steps/time"))

    def close(self) -> None:
        """Close the file."""
        self._datasets = {}
        self.constants.close()

    def rows(self, path: str, first: int, end: int) -> np.ndarray:
        """A quantity in the instants from `first` to before `end`: a row for each, or all rows that belong to them."""
        try:
            group = group_of(path)
            if group != "steps" and end > first:
                offset = self._dataset(offset_path(group))
                first, end = int(offset[first]), int(offset[end - 1] + self._dataset(COUNTS[group])[end - 1])
            rows: np.ndarray = self._dataset(path)[first:end]
        except WHAT_DAMAGE_RAISES as error:
            raise DamagedContent(f"{path} is not what was written: {one_line(error)}") from error
        return rows

    def all_rows(self, first: int, end: int) -> dict[str, np.ndarray]:
        """All quantities in these instants by path."""
        return {path: self.rows(path, first, end) for path in QUANTITIES}

    def _dataset(self, path: str) -> Any:
        """A dataset, looked up once: that takes its time."""
        if path not in self._datasets:
            self._datasets[path] = self.constants[path]
        return self._datasets[path]


def open_recording(path: Path) -> RunningRecording | FinishedRecording:
    """What is in a file, in whichever form it is."""
    file = path.open("rb")
    try:
        if file.read(len(RUNNING_MARK)) == RUNNING_MARK:
            return RunningRecording(file)
    except BaseException:
        file.close()
        raise
    file.close()
    return FinishedRecording(path)
