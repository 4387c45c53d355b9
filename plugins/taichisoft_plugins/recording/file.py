"""The HDF5 file of a recording while it is written: frames are added, and what was added stays readable."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from taichisoft_plugins.recording.layout import CONTACT_QUANTITIES, OPENED, STEP_QUANTITIES, Quantity, RecordingError
from taichisoft_plugins.recording.reserved_room import ReservedRoom

ROWS_PER_CHUNK = 100
CONTACTS_PER_CHUNK = 512
FRAMES_PER_CHUNK = 10
"""Of what has a number for every node: a packed chunk is read as a whole, so short ones give a frame sooner."""
LARGE = 100
"""Numbers in a row from which on it counts as such."""

PACKING = {"compression": "gzip", "compression_opts": 1, "shuffle": True}
METADATA = 2**18
"""More than HDF5 writes beside the rows of one call of `append` [bytes]."""


class RecordingFile:
    """Adds frames in HDF5's single-writer-multiple-reader mode.

    A process that is killed, or a disk that is full, leaves a file that opens, with all frames that `append` has
    written; it can be read while it is written.

    Attributes:
        path: where it is.
        frame_count, contact_count: rows that were written.
    """

    def __init__(
        self,
        path: Path,
        describe: Callable[[Any], None],
        rows: Mapping[str, np.ndarray],
        contacts: Mapping[str, np.ndarray],
        compress: bool = False,
    ):
        """Make a new file, or replace the one that is there.

        Args:
            path: its folder is made when it does not exist.
            describe: writes into the open HDF5 file what does not change.
            rows: one for each dataset of `steps`, shape (any, ...); they are not written.
            contacts: the same for `contacts`.
            compress: pack what has a number for every node.

        Raises:
            RecordingError: it cannot be made.
        """
        import h5py

        self.path = path
        self.frame_count = self.contact_count = 0
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            # Written by Python and then opened by HDF5, which would crash if it ran out of room here.
            path.write_bytes(_empty_recording(describe, rows, contacts, PACKING if compress else {}))
            self._room = ReservedRoom(path)
            self._room.reach(path.stat().st_size + METADATA)
            self._root = h5py.File(path, "r+", **OPENED)
        except OSError as error:
            raise RecordingError(f"{path}: cannot be written: {_reason(error)}") from error
        self._root.swmr_mode = True
        self._datasets = {name: self._root[name] for name in ["frames", *_paths(rows, contacts)]}
        self._one_chunk = sum(_chunk_bytes(dataset) for dataset in self._datasets.values())

    def append(self, rows: Mapping[str, np.ndarray], contacts: Mapping[str, np.ndarray]) -> None:
        """Add frames; they count when everything about them is in the file.

        Raises:
            RecordingError: they cannot be written; those before them stay.
        """
        added = [*rows.values(), *contacts.values()]
        length = sum(values.nbytes for values in added) + self._one_chunk + METADATA
        try:
            self._room.reach(self._root.id.get_filesize() + length)
        except OSError as error:
            raise RecordingError(f"{self.path}: cannot be written: {_reason(error)}") from error
        for path, values in _paths(rows, contacts).items():
            before = self.frame_count if path.startswith("steps") else self.contact_count
            _extend(self._datasets[path], before, values)
        self._root.flush()
        self.frame_count += len(next(iter(rows.values())))
        self.contact_count += len(next(iter(contacts.values()), ()))
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
    describe: Callable[[Any], None],
    rows: Mapping[str, np.ndarray],
    contacts: Mapping[str, np.ndarray],
    packing: Mapping[str, Any],
) -> bytes:
    """The file before the first frame."""
    import h5py

    with h5py.File("recording", "w", driver="core", backing_store=False, libver="latest") as file:
        describe(file)
        file["frames"] = np.zeros(1, dtype=np.int64)
        for path, values in _paths(rows, contacts).items():
            _create(file, path, values, packing)
        file.flush()
        image: bytes = file.id.get_file_image()
    return image


def _create(file: Any, path: str, rows: np.ndarray, packing: Mapping[str, Any]) -> None:
    group, name = path.split("/")
    quantities: dict[str, Quantity] = STEP_QUANTITIES if group == "steps" else CONTACT_QUANTITIES
    shape = rows.shape[1:]
    large = int(np.prod(shape)) >= LARGE
    per_chunk = FRAMES_PER_CHUNK if large else ROWS_PER_CHUNK if group == "steps" else CONTACTS_PER_CHUNK
    chunks = (per_chunk, *(max(length, 1) for length in shape))
    maximum = (None, *(length or None for length in shape))  # a chunk may not exceed the maximum
    dataset = file.create_dataset(
        path, (0, *shape), rows.dtype, maxshape=maximum, chunks=chunks, **(packing if large else {})
    )
    dataset.attrs["unit"] = quantities[name].unit


def _extend(dataset: Any, before: int, values: np.ndarray) -> None:
    """Add rows to those `before`, by HDF5's own calls: h5py's slices take three times as long for small rows."""
    from h5py import h5s

    dataset.id.set_extent((before + len(values), *values.shape[1:]))
    if values.size:
        place = dataset.id.get_space()
        place.select_hyperslab((before, *(0 for _ in values.shape[1:])), values.shape)
        dataset.id.write(h5s.create_simple(values.shape), place, np.ascontiguousarray(values, dataset.dtype))


def _paths(rows: Mapping[str, np.ndarray], contacts: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Where in the file they go."""
    steps = {f"steps/{name}": values for name, values in rows.items()}
    return steps | {f"contacts/{name}": values for name, values in contacts.items()}


def _chunk_bytes(dataset: Any) -> int:
    return int(np.prod(dataset.chunks or dataset.shape)) * dataset.dtype.itemsize


def _reason(error: OSError) -> str:
    return error.strerror or str(error)
