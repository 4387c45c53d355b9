"""A checksum of every quantity in every frame, with which a reader tells what is whole.

HDF5's own checksums of chunks would not do: a chunk of small datasets holds many frames and is written again with each
of them, and a writer that is killed in the middle of that would leave a checksum that denies the frames before.
"""

import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np

from taichisoft_plugins.recording.layout import QUANTITIES

CHECKSUMS = "checksums"
"""Name of the dataset."""
COLUMN = {path: column for column, path in enumerate(QUANTITIES)}
"""Column of each quantity."""


def checksum(values: Any) -> int:
    """CRC-32 of the bytes of an array or a number."""
    return zlib.crc32(values.tobytes())


def checksums(rows: Mapping[str, np.ndarray], first_contact: int) -> np.ndarray:
    """CRC-32 of every quantity in each of some frames, shape (frame_count, quantity_count).

    Args:
        rows: the frames, as they stand in the file.
        first_contact: number of contacts that were written before those of these frames.
    """
    start = rows["steps/contact_offset"] - first_contact
    end = start + rows["steps/contact_count"]
    found = np.empty((len(start), len(QUANTITIES)), dtype=np.uint32)
    for path, column in COLUMN.items():
        values = rows[path]
        if path.startswith("steps"):
            found[:, column] = [checksum(row) for row in values]
        else:
            found[:, column] = [checksum(values[i:j]) for i, j in zip(start, end, strict=True)]
    return found
