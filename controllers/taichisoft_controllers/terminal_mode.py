"""A terminal that hands over keys one by one and unseen for a while, and is put back whatever happens.

A child process watches for the death of the run: this file as a program, `python terminal_mode.py FD OWN FOR_KEYS`,
where OWN and FOR_KEYS are lists of attributes as `termios` has them. It waits for the end of its standard input; if
the terminal then still has the mode for keys, it gets its own mode back.
"""

import ast
import atexit
import contextlib
import os
import subprocess
import sys
import termios
from typing import Any

SHOW_CURSOR = b"\x1b[?25h"
"""The sequence that shows the cursor, which a live display may have hidden."""

# Indices in the lists of attributes of termios: what is changed here, and all flags.
_INPUT, _LOCAL, _CHARACTERS = 0, 3, 6
_FLAGS = slice(0, 4)


class TerminalMode:
    """Switches a terminal between its own mode and that for keys.

    The mode for keys has no echo and does not wait for the end of a line, and Ctrl with q, s, v or o are keys
    like others. Ctrl with c, z or a backslash still are signals, and output looks as always.

    Attributes:
        is_for_keys: whether the mode for keys is on.
    """

    def __init__(self, file_descriptor: int):
        """Remember the mode of a terminal, and start the child that puts it back should this process be killed."""
        self.is_for_keys = False
        self._fd = file_descriptor
        self._own = termios.tcgetattr(file_descriptor)
        self._for_keys = _attributes_for_keys(self._own)
        self._watching_child = _start_watching_child(file_descriptor, self._own, self._for_keys)
        atexit.register(self.end)

    @property
    def is_in_foreground(self) -> bool:
        """Whether this process has the terminal: after Ctrl and z and `bg` the shell has it."""
        try:
            return os.tcgetpgrp(self._fd) == os.getpgrp()
        except OSError:  # the terminal does not control this process, so no other process takes it
            return True

    def begin_keys(self) -> None:
        """Switch to the mode for keys, if this process has the terminal."""
        if self.is_in_foreground:
            termios.tcsetattr(self._fd, termios.TCSANOW, self._for_keys)
        self.is_for_keys = self.is_in_foreground

    def end_keys(self) -> None:
        """Switch back and drop what was typed meanwhile; a terminal that has gone is left alone."""
        if self.is_for_keys and self.is_in_foreground:
            _restore(self._fd, self._own)
        self.is_for_keys = False

    def end(self) -> None:
        """Switch back for good."""
        atexit.unregister(self.end)
        self.end_keys()
        if self._watching_child is not None:
            self._watching_child.kill()
            self._watching_child.communicate()
            self._watching_child = None


def _attributes_for_keys(own: list[Any]) -> list[Any]:
    attributes = [*own[:_CHARACTERS], list(own[_CHARACTERS])]
    attributes[_INPUT] &= ~termios.IXON
    attributes[_LOCAL] &= ~(termios.ECHO | termios.ICANON | termios.IEXTEN)
    attributes[_LOCAL] |= termios.ISIG
    attributes[_CHARACTERS][termios.VMIN] = 1
    attributes[_CHARACTERS][termios.VTIME] = 0
    return attributes


def _restore(file_descriptor: int, attributes: list[Any]) -> None:
    """Set a terminal's attributes, drop what was typed and show the cursor; do nothing if the terminal has gone."""
    with contextlib.suppress(termios.error, OSError):
        # Output need not have drained before: without a reader it never would.
        termios.tcsetattr(file_descriptor, termios.TCSANOW, attributes)
        termios.tcflush(file_descriptor, termios.TCIFLUSH)
        os.write(file_descriptor, SHOW_CURSOR)


def _start_watching_child(
    file_descriptor: int, own: list[Any], for_keys: list[Any]
) -> "subprocess.Popen[bytes] | None":
    """The child that waits for the end of this process; None where no other process can be started."""
    terminal = os.dup(file_descriptor)
    # -I and -S: nothing of the user's is read or imported, and it starts in 20 ms.
    command = [sys.executable, "-I", "-S", __file__, str(terminal), repr(own), repr(for_keys)]
    try:
        return subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            pass_fds=(terminal,),
            # Ctrl and c or z are not for it, and it may set the terminal from the background.
            start_new_session=True,
        )
    except OSError:
        return None
    finally:
        os.close(terminal)


def _watch() -> None:
    """The watching child: wait until the parent, or the kernel for it, closes the pipe."""
    terminal, own, for_keys = int(sys.argv[1]), ast.literal_eval(sys.argv[2]), ast.literal_eval(sys.argv[3])
    while os.read(0, 64):
        pass
    # A shell may have been faster, and its line editor has another mode by now.
    with contextlib.suppress(termios.error):
        if termios.tcgetattr(terminal)[_FLAGS] == for_keys[_FLAGS]:
            _restore(terminal, own)


if __name__ == "__main__":
    _watch()
