"""The numbers of a section of an MSH file, in the order in which it has them, as text or binary."""

from typing import Protocol

import numpy as np


class Numbers(Protocol):
    """Each call gives the next numbers of a section; ValueError where there are too few."""

    def integers(self, count: int) -> np.ndarray:
        """Tags and dimensions: gmsh's `int`."""
        ...

    def sizes(self, count: int) -> np.ndarray:
        """Counts and numbers of nodes and cells: gmsh's `size_t`."""
        ...

    def floats(self, count: int) -> np.ndarray:
        """Coordinates: gmsh's `double`."""
        ...


class TextNumbers:
    """Numbers between white space."""

    def __init__(self, section: bytes):
        self._values = np.array(section.split(), dtype=bytes).astype(np.float64)
        self._place = 0

    def floats(self, count: int) -> np.ndarray:
        values = self._values[self._place : self._place + count]
        if count < 0 or len(values) < count:
            raise ValueError("a section has fewer numbers than it says")
        self._place += count
        return values

    def integers(self, count: int) -> np.ndarray:
        values = self.floats(count)  # exact: no file has 2^53 of anything
        whole = np.nan_to_num(values).astype(np.int64)
        if (whole != values).any():
            raise ValueError(f"{values[np.argmax(whole != values)]:g} stands where a whole number is needed")
        return whole

    sizes = integers


class BinaryNumbers:
    """Numbers of this machine's byte order.

    Args:
        section: what stands between its two lines.
        size_bytes: bytes of a `size_t`, from the head of the file.
    """

    def __init__(self, section: bytes, size_bytes: int):
        self._section = section
        self._size = np.dtype(f"u{size_bytes}")
        self._place = 0

    def floats(self, count: int) -> np.ndarray:
        return self._take(count, np.dtype(np.float64))

    def integers(self, count: int) -> np.ndarray:
        return self._take(count, np.dtype(np.int32)).astype(np.int64)

    def sizes(self, count: int) -> np.ndarray:
        return self._take(count, self._size).astype(np.int64)

    def _take(self, count: int, kind: np.dtype) -> np.ndarray:
        if count < 0 or self._place + count * kind.itemsize > len(self._section):
            raise ValueError("a section has fewer numbers than it says")
        values = np.frombuffer(self._section, kind, count, self._place)
        self._place += count * kind.itemsize
        return values
