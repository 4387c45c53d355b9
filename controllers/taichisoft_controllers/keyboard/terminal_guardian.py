"""Puts a terminal back: also as a child process that waits for its parent's end, however that comes.

`python terminal_guardian.py FD OWN CHANGED`, where OWN and CHANGED are lists of attributes as `termios` has them, waits
for the end of standard input; if the terminal is then still as the parent changed it, it gets its own attributes back.
`terminal_mode` starts it. No other module of ours is imported here, so that it starts at once and needs little.
"""

import ast
import contextlib
import os
import sys
import termios
from typing import Any

SHOW_CURSOR = b"\x1b[?25h"
"""A live display hides it."""


def restore(file_descriptor: int, attributes: list[Any]) -> None:
    """Set a terminal's attributes, drop what was typed and show the cursor; nothing if the terminal has gone."""
    with contextlib.suppress(termios.error, OSError):
        # Not after the output has drained: one that nobody reads any more would never do.
        termios.tcsetattr(file_descriptor, termios.TCSANOW, attributes)
        termios.tcflush(file_descriptor, termios.TCIFLUSH)
        os.write(file_descriptor, SHOW_CURSOR)


def is_as_set(file_descriptor: int, attributes: list[Any]) -> bool:
    """Whether a terminal still has the flags of these attributes; false if it has gone."""
    try:
        return termios.tcgetattr(file_descriptor)[:4] == attributes[:4]
    except termios.error:
        return False


def main() -> None:
    """Wait until the parent, or the kernel for it, closes the pipe."""
    terminal, own, changed = int(sys.argv[1]), ast.literal_eval(sys.argv[2]), ast.literal_eval(sys.argv[3])
    while os.read(0, 64):
        pass
    # A shell may have been faster, and its line editor has another mode by now.
    if is_as_set(terminal, changed):
        restore(terminal, own)


if __name__ == "__main__":
    main()
