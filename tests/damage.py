"""Damage to the content of a file: by an editor, a broken transfer or disk, or a program that writes wrong numbers."""

import random
import re
from collections.abc import Callable

NUMBER = re.compile(rb"-?\d+\.?\d*(?:[eE][-+]?\d+)?")
WRONG_NUMBERS = (
    b"0", b"-1", b"1", b"nan", b"inf", b"1e300", b"-1e300", b"99999999999999999999", b"2147483648", b"1000000", b"0.5",
    b"", b"x",
)  # fmt: skip


def damaged_text(content: bytes, dice: random.Random) -> bytes:
    """The content of a text file with one to three damages."""
    for _ in range(dice.choice([1, 1, 1, 2, 3])):
        content = dice.choice(TEXT_DAMAGES)(content, dice)
    return content


def wrong_number(content: bytes, dice: random.Random) -> bytes:
    """A number is replaced, also by text that is not a number."""
    found = list(NUMBER.finditer(content))
    if not found:
        return content
    one = dice.choice(found)
    return content[: one.start()] + dice.choice(WRONG_NUMBERS) + content[one.end() :]


def wrong_byte(content: bytes, dice: random.Random) -> bytes:
    """A byte is replaced."""
    place = dice.randrange(max(len(content), 1))
    return content[:place] + dice.randbytes(1) + content[place + 1 :]


def wrong_lines(content: bytes, dice: random.Random) -> bytes:
    """A line is missing, stands twice, or has changed places with another one."""
    lines = content.splitlines(keepends=True) or [b""]
    one, other = dice.randrange(len(lines)), dice.randrange(len(lines))
    kind = dice.randrange(3)
    if kind == 0:
        del lines[one]
    elif kind == 1:
        lines.insert(other, lines[one])
    else:
        lines[one], lines[other] = lines[other], lines[one]
    return b"".join(lines)


def cut_off(content: bytes, dice: random.Random) -> bytes:
    """The end is missing."""
    return content[: dice.randrange(max(len(content), 1))]


def flip_bit(content: bytes, dice: random.Random) -> bytes:
    """A bit is wrong."""
    place = dice.randrange(len(content))
    return content[:place] + bytes([content[place] ^ 1 << dice.randrange(8)]) + content[place + 1 :]


def zero_page(content: bytes, dice: random.Random) -> bytes:
    """A page of a disk reads as zeros."""
    start = dice.randrange(len(content)) // 4096 * 4096
    end = min(start + 4096, len(content))
    return content[:start] + bytes(end - start) + content[end:]


def foreign_bytes(content: bytes, dice: random.Random) -> bytes:
    """Up to 500 bytes are replaced."""
    start = dice.randrange(len(content))
    end = min(start + 500, len(content))
    return content[:start] + dice.randbytes(end - start) + content[end:]


Damage = Callable[[bytes, random.Random], bytes]
TEXT_DAMAGES: tuple[Damage, ...] = (wrong_number, wrong_number, wrong_byte, cut_off, wrong_lines)
DAMAGES: tuple[Damage, ...] = (cut_off, flip_bit, zero_page, foreign_bytes)
"""Damages of binary files."""
