"""Damage to the text of a file: as by an editor, a broken transfer, or a program that writes numbers that are none."""

import random
import re

NUMBER = re.compile(rb"-?\d+\.?\d*(?:[eE][-+]?\d+)?")
WRONG_NUMBERS = (
    b"0", b"-1", b"1", b"nan", b"inf", b"1e300", b"-1e300", b"99999999999999999999", b"2147483648", b"1000000", b"0.5",
    b"", b"x",
)  # fmt: skip


def damaged_text(content: bytes, dice: random.Random) -> bytes:
    """The content of a file with one to three damages."""
    for _ in range(dice.choice([1, 1, 1, 2, 3])):
        content = dice.choice(DAMAGES)(content, dice)
    return content


def wrong_number(content: bytes, dice: random.Random) -> bytes:
    """A number is another one, or none."""
    found = list(NUMBER.finditer(content))
    if not found:
        return content
    one = dice.choice(found)
    return content[: one.start()] + dice.choice(WRONG_NUMBERS) + content[one.end() :]


def wrong_byte(content: bytes, dice: random.Random) -> bytes:
    """A byte is another one."""
    place = dice.randrange(max(len(content), 1))
    return content[:place] + dice.randbytes(1) + content[place + 1 :]


def cut_off(content: bytes, dice: random.Random) -> bytes:
    """The end is missing."""
    return content[: dice.randrange(max(len(content), 1))]


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


DAMAGES = (wrong_number, wrong_number, wrong_byte, cut_off, wrong_lines)
