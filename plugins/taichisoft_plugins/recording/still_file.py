"""A recording as it stands at this moment, for HDF5 to read: be it finished, cut off, or still written.

HDF5 marks a file that is being written in its superblock. It then opens it only for readers of its
single-writer-multiple-reader mode, in which it takes damage for a write under way and reads again, without end. A still
file has no such mark, so damage is an error at once. It is also longer than it says, if its writer did not get to it.

The superblock (version 3) and its checksum are described in the HDF5 File Format Specification 3.0, sections II.A and
IV; the checksum is Jenkins' lookup3 (http://burtleburtle.net/bob/c/lookup3.c).
"""

import io
import os
import struct
from pathlib import Path

SUPERBLOCK = struct.Struct("<8sBBBBQQQQ")
"""Signature, version, sizes of offsets and of lengths, marks, base, extension, end of the file, root group."""
SIGNATURE = b"\x89HDF\r\n\x1a\n"
HEAD = SUPERBLOCK.size + 4
"""Bytes of the superblock with its checksum."""

WORD = 0xFFFFFFFF


class StillFile(io.RawIOBase):
    """The bytes of a file in which nothing says that it is being written, for h5py's driver "fileobj"."""

    def __init__(self, path: Path):
        """Open a file.

        Raises:
            OSError: it cannot be read.
        """
        self._file = path.open("rb", buffering=0)
        self._size = os.fstat(self._file.fileno()).st_size
        self._place = 0
        self._head = os.pread(self._file.fileno(), HEAD, 0)
        self.is_marked = False
        if len(self._head) == HEAD:
            signature, version, offsets, lengths, marks, base, extension, end, root = SUPERBLOCK.unpack(self._head[:-4])
            if signature == SIGNATURE and version == 3 and self._head == with_checksum(self._head[:-4]):
                self.is_marked = marks != 0
                self._size = max(self._size, end)
                fields = (signature, version, offsets, lengths, 0, base, extension, self._size, root)
                self._head = with_checksum(SUPERBLOCK.pack(*fields))

    def close(self) -> None:
        """Close the file."""
        self._file.close()
        super().close()

    def readable(self) -> bool:
        """Yes."""
        return True

    def seekable(self) -> bool:
        """Yes."""
        return True

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Go to a place."""
        self._place = offset + {os.SEEK_SET: 0, os.SEEK_CUR: self._place, os.SEEK_END: self._size}[whence]
        return self._place

    def tell(self) -> int:
        """The place that is read next."""
        return self._place

    def readinto(self, buffer) -> int:  # type: ignore[no-untyped-def] # any writable buffer
        """Fill the whole buffer.

        Raises:
            OSError: the file ends before.
        """
        view = memoryview(buffer).cast("B")
        read = 0
        while read < len(view):
            count = os.preadv(self._file.fileno(), [view[read:]], self._place + read)
            if not count:
                raise OSError(f"the file ends at byte {self._place + read}")
            read += count
        if self._place < len(self._head):
            mended = self._head[self._place : self._place + len(view)]
            view[: len(mended)] = mended
        self._place += read
        return read


def with_checksum(superblock: bytes) -> bytes:
    """A superblock with its checksum behind it."""
    return superblock + struct.pack("<I", _lookup3(superblock))


def _lookup3(data: bytes) -> int:
    """Jenkins' lookup3 of some bytes, 12 or more and no multiple of 12, begun with 0."""
    a = b = c = (0xDEADBEEF + len(data)) & WORD
    full = (len(data) - 1) // 12 * 12
    for start in range(0, full, 12):
        words = struct.unpack_from("<III", data, start)
        a, b, c = _mixed((a + words[0]) & WORD, (b + words[1]) & WORD, (c + words[2]) & WORD)
    words = struct.unpack("<III", data[full:].ljust(12, b"\0"))
    return _finished((a + words[0]) & WORD, (b + words[1]) & WORD, (c + words[2]) & WORD)


def _rotated(word: int, bits: int) -> int:
    return (word << bits | word >> 32 - bits) & WORD


def _mixed(a: int, b: int, c: int) -> tuple[int, int, int]:
    for bits in (4, 6, 8, 16, 19, 4):
        a = (a - c) & WORD ^ _rotated(c, bits)
        a, b, c = b, (c + b) & WORD, a  # each turn takes the next of the three
    return a, b, c


def _finished(a: int, b: int, c: int) -> int:
    for bits in (14, 11, 25, 16, 4, 14, 24):
        c = ((c ^ b) - _rotated(b, bits)) & WORD
        a, b, c = b, c, a
    return b
