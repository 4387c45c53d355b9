"""Damage to files, of the kinds that disks, copies and people do."""

import random
from collections.abc import Callable


def cut_off(content: bytearray, chance: random.Random) -> bytearray:
    """The end is missing."""
    return content[: chance.randrange(len(content))]


def flip_bit(content: bytearray, chance: random.Random) -> bytearray:
    """One bit is wrong."""
    content[chance.randrange(len(content))] ^= 1 << chance.randrange(8)
    return content


def zero_page(content: bytearray, chance: random.Random) -> bytearray:
    """A page of a disk reads as zeros."""
    start = chance.randrange(len(content)) // 4096 * 4096
    end = min(start + 4096, len(content))
    content[start:end] = bytes(end - start)
    return content


def foreign_bytes(content: bytearray, chance: random.Random) -> bytearray:
    """Something else was written into it."""
    start = chance.randrange(len(content))
    end = min(start + 500, len(content))
    content[start:end] = chance.randbytes(end - start)
    return content


DAMAGES: tuple[Callable[[bytearray, random.Random], bytearray], ...] = (cut_off, flip_bit, zero_page, foreign_bytes)
