"""The HDF5 file of a recording while it is written: frames are added, and what was added stays readable."""

import glob
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from taichisoft.atomic_file import atomic_file, named_os_errors
from taichisoft_plugins.recording.checksums import CHECKSUMS, checksums
from taichisoft_plugins.recording.layout import OUTCOME_LENGTH, QUANTITIES, SIGNAL_NAMES, UNFINISHED, RecordingError
from taichisoft_plugins.recording.still_file import SUPERBLOCK
from taichisoft_plugins.recording.texts import as_bytes, as_signal_names, write_texts

ROWS_PER_CHUNK = 100
CONTACTS_PER_CHUNK = 512
LARGE = 100
"""A dataset with this many numbers in a row is large, such as one with numbers for every node. Its chunks are single
rows: none is written twice, which could leave half a packed one, and a frame is read without its neighbours."""

PACKING = {"compression": "gzip", "compression_opts": 1, "shuffle": True}
CACHED = 2**16
"""What HDF5 may keep of each dataset [bytes]; otherwise 8 MB."""
CACHED_METADATA = 2**21
"""What it may keep of its indices [bytes]."""
METADATA = 2**18
"""More than HDF5 writes beside the rows of one call of `append` [bytes]."""


class RecordingFile:
    """Adds frames in HDF5's single-writer-multiple-reader mode.

    A process that is killed, or a disk that is full, leaves a file that opens, with all frames that `append` has
    written; it can be read while it is written. The file gets its name with the first frames in it: who is killed
    before leaves an older file as it was.

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
            rows: the first frames, as for `append`.
            compress: whether large datasets are packed.

        Raises:
            RecordingError: the file cannot be made.
        """
        import h5py

        self.path = path
        self.frame_count = self.contact_count = 0
        with named_os_errors(path, RecordingError):
            path.parent.mkdir(parents=True, exist_ok=True)
            _remove_begun_files(path)
        with atomic_file(path, RecordingError) as begun:
            # Written by Python and then opened by HDF5, which would crash if it ran out of room here.
            begun.write_bytes(_empty_recording(describe, rows, PACKING if compress else {}))
            self._room = _ReservedRoom(begun)
            self._room.reach(begun.stat().st_size + METADATA)
            self._root = h5py.File(begun, "r+", libver="latest", locking=False, rdcc_nbytes=CACHED)
            _limit_cache(self._root)
            self._root.swmr_mode = True
            self._datasets = {name: self._root[name] for name in ["frames", "outcome", CHECKSUMS, SIGNAL_NAMES, *rows]}
            self._signal_count = 0
            self._one_chunk = sum(_chunk_bytes(dataset) for dataset in self._datasets.values())
            self._append(rows)

    def append(self, rows: Mapping[str, np.ndarray], signals: Sequence[str] = ()) -> None:
        """Add frames, by paths of datasets; they count when everything about them is in the file.

        Args:
            rows: the frames.
            signals: names of the columns of signals that have one by now; none for those that `describe` wrote.

        Raises:
            RecordingError: the frames cannot be written; those before them stay.
        """
        if not self._room.is_file(self.path):
            raise RecordingError(f"{self.path}: was removed or replaced while the run went on; its frames are lost")
        if len(signals) > self._signal_count:  # what has a place in the file already needs no room
            self._signal_count = len(signals)
            self._datasets[SIGNAL_NAMES][:] = as_signal_names(signals)
        self._append(rows)

    @property
    def size(self) -> int:
        """Length of the file [bytes]."""
        return int(self._root.id.get_filesize())

    def close(self, outcome: str) -> None:
        """Say how the run ended; a file that nobody closes says that it has not ended."""
        self._datasets["outcome"][()] = as_bytes(outcome, OUTCOME_LENGTH)
        self._root.close()
        self._room.give_back()

    def _append(self, rows: Mapping[str, np.ndarray]) -> None:
        rows = {path: np.ascontiguousarray(values, self._datasets[path].dtype) for path, values in rows.items()}
        length = sum(values.nbytes for values in rows.values()) + self._one_chunk + METADATA
        with named_os_errors(self.path, RecordingError):
            self._room.reach(self.size + length)
        for path, values in rows.items():
            before = self.frame_count if path.startswith("steps") else self.contact_count
            _extend(self._datasets[path], before, values)
        _extend(self._datasets[CHECKSUMS], self.frame_count, checksums(rows, self.contact_count))
        self._root.flush()
        self.frame_count += len(rows["steps/time"])
        self.contact_count += len(rows["contacts/point"])
        self._datasets["frames"][:] = (self.frame_count, -self.frame_count)
        self._root.flush()


def _remove_begun_files(path: Path) -> None:
    """Remove what those left who were killed before their file had its name."""
    for begun in path.parent.glob(f".{glob.escape(path.name)}.*.partial"):
        begun.unlink(missing_ok=True)


def _limit_cache(file: Any) -> None:
    """Keep HDF5 from caching more and more of its indices: a run may last for hours."""
    settings = file.id.get_mdc_config()
    settings.set_initial_size, settings.initial_size = True, CACHED_METADATA
    settings.min_size = settings.max_size = CACHED_METADATA
    file.id.set_mdc_config(settings)


def _empty_recording(
    describe: Callable[[Any], None], rows: Mapping[str, np.ndarray], packing: Mapping[str, Any]
) -> bytes:
    """The file before the first frame."""
    import h5py

    with h5py.File("recording", "w", driver="core", backing_store=False, libver="latest") as file:
        describe(file)
        file["frames"] = np.zeros(2, dtype=np.int64)
        file["outcome"] = np.array(as_bytes(UNFINISHED), dtype=f"S{OUTCOME_LENGTH}")
        for path, values in rows.items():
            _create(file, path, values, packing)
            file[path].attrs["unit"] = np.bytes_(QUANTITIES[path].unit)
        _create(file, CHECKSUMS, np.zeros((0, len(QUANTITIES)), dtype=np.uint32), {})
        write_texts(file[CHECKSUMS].attrs, "quantities", list(QUANTITIES))
        file.flush()
        image: bytes = file.id.get_file_image()
    return image


def _create(file: Any, path: str, rows: np.ndarray, packing: Mapping[str, Any]) -> None:
    shape = rows.shape[1:]
    large = int(np.prod(shape)) >= LARGE
    per_chunk = 1 if large else CONTACTS_PER_CHUNK if path.startswith("contacts") else ROWS_PER_CHUNK
    chunks = (per_chunk, *(max(length, 1) for length in shape))
    maximum = (None, *(length or None for length in shape))  # a chunk may not exceed the maximum
    file.create_dataset(path, (0, *shape), rows.dtype, maxshape=maximum, chunks=chunks, **(packing if large else {}))


def _extend(dataset: Any, before: int, values: np.ndarray) -> None:
    """Add rows to those `before`, by HDF5's own calls: h5py's slices take three times as long for small rows."""
    from h5py import h5s

    dataset.id.set_extent((before + len(values), *values.shape[1:]))
    if values.size:
        place = dataset.id.get_space()
        place.select_hyperslab((before, *(0 for _ in values.shape[1:])), values.shape)
        dataset.id.write(h5s.create_simple(values.shape), place, values)


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

    def reach(self, end: int) -> None:
        """Make the file at least `end` bytes long; what is in it stays. HDF5 cuts off what it has not used.

        Raises:
            OSError: there is no room.
        """
        before = os.fstat(self._file.fileno()).st_size
        if end <= before:
            return
        if hasattr(os, "posix_fallocate"):
            os.posix_fallocate(self._file.fileno(), before, end - before)
        else:
            self._file.seek(before)
            self._file.write(bytes(end - before))
            self._file.flush()

    def is_file(self, path: Path) -> bool:
        """Whether it still has this path."""
        try:
            return os.path.samestat(path.stat(), os.fstat(self._file.fileno()))
        except OSError:
            return False

    def give_back(self) -> None:
        """Cut off what HDF5, which has closed the file, did not need; reserve no more."""
        self._file.seek(0)
        _, _, _, _, marks, _, _, end, _ = SUPERBLOCK.unpack(self._file.read(SUPERBLOCK.size))
        if marks == 0:
            self._file.truncate(end)
        self._file.close()
