"""The HDF5 file of a recording while it is written: frames are added, and what was added stays readable."""

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from taichisoft.atomic_file import named_os_errors
from taichisoft_plugins.recording.layout import OPENED, QUANTITIES, RecordingError

ROWS_PER_CHUNK = 100
CONTACTS_PER_CHUNK = 512
LARGE = 100
"""A dataset with this many numbers in a row is large, such as one with numbers for every node."""
LARGE_ROWS_PER_CHUNK = 10
"""The same for large datasets: a packed chunk is read as a whole, so a short one gives a frame sooner."""

PACKING = {"compression": "gzip", "compression_opts": 1, "shuffle": True}
METADATA = 2**18
"""More than HDF5 writes beside the rows of one call of `append` [bytes]."""
SLAB = 4 * 2**20
"""Room on the disk is reserved in pieces of this size [bytes]; a killed run leaves its file too long by one at most."""


class RecordingFile:
    """Adds frames in HDF5's single-writer-multiple-reader mode.

    A process that is killed, or a disk that is full, leaves a file that opens, with all frames that `append` has
    written; it can be read while it is written.

    Attributes:
        path: place of the file.
        frame_count, contact_count: rows that were written.
    """

    def __init__(
        self,
        path: Path,
        describe: Callable[[Any], None],
        rows: Mapping[str, np.ndarray],
        compress: bool = False,
    ):
        """Make a new file, or replace the one that is there.

        Args:
            path: place of the file; its folder is made when it does not exist.
            describe: writes into the open HDF5 file what does not change.
            rows: an array like those that will be added for each of `layout.QUANTITIES`, shape (any, ...).
            compress: whether large datasets are packed.

        Raises:
            RecordingError: the file cannot be made.
        """
        import h5py

        self.path = path
        self.frame_count = self.contact_count = 0
        with named_os_errors(path, RecordingError):
            path.parent.mkdir(parents=True, exist_ok=True)
            # Written by Python and then opened by HDF5, which would crash if it ran out of room here.
            path.write_bytes(_empty_recording(describe, rows, PACKING if compress else {}))
            self._room = _ReservedRoom(path)
            self._room.reach(path.stat().st_size + METADATA)
            self._root = h5py.File(path, "r+", **OPENED)
        self._root.swmr_mode = True
        self._datasets = {name: self._root[name] for name in ["frames", *rows]}
        self._one_chunk = sum(_chunk_bytes(dataset) for dataset in self._datasets.values())

    def append(self, rows: Mapping[str, np.ndarray]) -> None:
        """Add frames, by paths of datasets; they count when everything about them is in the file.

        Raises:
            RecordingError: the frames cannot be written; those before them stay.
        """
        length = sum(values.nbytes for values in rows.values()) + self._one_chunk + METADATA
        with named_os_errors(self.path, RecordingError):
            self._room.reach(self._root.id.get_filesize() + length)
        for path, values in rows.items():
            before = self.frame_count if path.startswith("steps") else self.contact_count
            _extend(self._datasets[path], before, values)
        self._root.flush()
        self.frame_count += len(rows["steps/time"])
        self.contact_count += len(rows["contacts/point"])
        self._datasets["frames"][0] = self.frame_count
        self._root.flush()

    def close(self, outcome: str) -> None:
        """Say how the run ended."""
        import h5py

        self._root.close()
        self._room.close()
        with h5py.File(self.path, "r+", **OPENED) as file:  # HDF5 cuts off the room that was not needed
            file.attrs["outcome"] = outcome


def _empty_recording(
    describe: Callable[[Any], None], rows: Mapping[str, np.ndarray], packing: Mapping[str, Any]
) -> bytes:
    """The file before the first frame."""
    import h5py

    with h5py.File("recording", "w", driver="core", backing_store=False, libver="latest") as file:
        describe(file)
        file["frames"] = np.zeros(1, dtype=np.int64)
        for path, values in rows.items():
            _create(file, path, values, packing)
        file.flush()
        image: bytes = file.id.get_file_image()
    return image


def _create(file: Any, path: str, rows: np.ndarray, packing: Mapping[str, Any]) -> None:
    shape = rows.shape[1:]
    large = int(np.prod(shape)) >= LARGE
    per_chunk = LARGE_ROWS_PER_CHUNK if large else ROWS_PER_CHUNK if path.startswith("steps") else CONTACTS_PER_CHUNK
    chunks = (per_chunk, *(max(length, 1) for length in shape))
    maximum = (None, *(length or None for length in shape))  # a chunk may not exceed the maximum
    dataset = file.create_dataset(
        path, (0, *shape), rows.dtype, maxshape=maximum, chunks=chunks, **(packing if large else {})
    )
    dataset.attrs["unit"] = QUANTITIES[path].unit


def _extend(dataset: Any, before: int, values: np.ndarray) -> None:
    """Add rows to those `before`, by HDF5's own calls: h5py's slices take three times as long for small rows."""
    from h5py import h5s

    dataset.id.set_extent((before + len(values), *values.shape[1:]))
    if values.size:
        place = dataset.id.get_space()
        place.select_hyperslab((before, *(0 for _ in values.shape[1:])), values.shape)
        dataset.id.write(h5s.create_simple(values.shape), place, np.ascontiguousarray(values, dataset.dtype))


def _chunk_bytes(dataset: Any) -> int:
    return int(np.prod(dataset.chunks or dataset.shape)) * dataset.dtype.itemsize


class _ReservedRoom:
    """Lengthens a file before HDF5 writes into it.

    HDF5 does not survive a write that fails: it tries again when it closes the file and then crashes the process. With
    room reserved, a full disk, a quota or a limit of the file's size shows before HDF5 writes anything.
    """

    def __init__(self, path: Path):
        """Open an existing file."""
        self._file = path.open("r+b")
        self._end = path.stat().st_size

    def reach(self, end: int) -> None:
        """Make the file at least `end` bytes long; what is in it stays.

        Raises:
            OSError: there is no room.
        """
        if end <= self._end:
            return
        length = max(end - self._end, SLAB)
        try:
            self._lengthen(length)
        except OSError:  # there may be room for what is needed, if not for a whole slab
            length = end - self._end
            self._lengthen(length)
        self._end += length

    def close(self) -> None:
        """Reserve no more."""
        self._file.close()

    def _lengthen(self, length: int) -> None:
        if hasattr(os, "posix_fallocate"):
            os.posix_fallocate(self._file.fileno(), self._end, length)
        else:
            self._file.seek(self._end)
            self._file.write(bytes(length))
            self._file.flush()
