"""Room on the disk that is taken before it is needed."""

import os
from pathlib import Path

SLAB = 4 * 2**20
"""Taken at a time [bytes]; a killed run leaves its file too long by this at most."""


class ReservedRoom:
    """Lengthens a file ahead of the one that writes it.

    HDF5 does not survive a write that fails: it tries again when it closes the file and then crashes the process. With
    room reserved, a full disk, a quota or a limit of the file's size shows before HDF5 writes anything.
    """

    def __init__(self, path: Path):
        """Reserve in an existing file."""
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
