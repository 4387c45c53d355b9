"""A terminal that hands over keys one by one and unseen for a while, and is put back whatever happens."""

import atexit
import contextlib
import os
import subprocess
import sys
import termios
from collections.abc import Iterator
from typing import Any

from taichisoft_controllers.keyboard import terminal_guardian

# Where in termios' lists of attributes what is changed here stands.
_INPUT, _LOCAL, _CHARACTERS = 0, 3, 6


class TerminalMode:
    """Switches a terminal between its own mode and that for keys.

    In the mode for keys there is no echo and no waiting for the end of a line, and Ctrl with q, s, v or o are keys
    like others. Ctrl with c, z or a backslash still are signals, and output looks as always.

    Attributes:
        is_for_keys: whether the mode for keys is on.
    """

    def __init__(self, file_descriptor: int):
        """Remember the mode of a terminal, and start the child that puts it back should this process be killed.

        Raises:
            OSError: it is no terminal, or has gone.
        """
        self.is_for_keys = False
        self._fd = file_descriptor
        with _os_errors():
            self._own = termios.tcgetattr(file_descriptor)
        self._for_keys = _attributes_for_keys(self._own)
        self._guardian = _start_guardian(file_descriptor, self._own, self._for_keys)
        atexit.register(self.end)

    @property
    def is_in_foreground(self) -> bool:
        """Whether this process has the terminal: after Ctrl and z and `bg` the shell has it."""
        try:
            return os.tcgetpgrp(self._fd) == os.getpgrp()
        except OSError:  # it does not control this process, so nobody takes it away
            return True

    def begin_keys(self) -> None:
        """Switch to the mode for keys, if this process has the terminal.

        Raises:
            OSError: the terminal has gone.
        """
        if self.is_in_foreground:
            with _os_errors():
                termios.tcsetattr(self._fd, termios.TCSANOW, self._for_keys)
        self.is_for_keys = self.is_in_foreground

    def end_keys(self) -> None:
        """Switch back and drop what was typed meanwhile; a terminal that has gone is left alone."""
        if self.is_for_keys and self.is_in_foreground:
            terminal_guardian.restore(self._fd, self._own)
        self.is_for_keys = False

    def end(self) -> None:
        """Switch back for good."""
        atexit.unregister(self.end)
        self.end_keys()
        if self._guardian is not None:
            self._guardian.kill()
            self._guardian.communicate()
            self._guardian = None


def _attributes_for_keys(own: list[Any]) -> list[Any]:
    attributes = [*own[:_CHARACTERS], list(own[_CHARACTERS])]
    attributes[_INPUT] &= ~termios.IXON
    attributes[_LOCAL] &= ~(termios.ECHO | termios.ICANON | termios.IEXTEN)
    attributes[_LOCAL] |= termios.ISIG
    attributes[_CHARACTERS][termios.VMIN] = 1
    attributes[_CHARACTERS][termios.VTIME] = 0
    return attributes


def _start_guardian(file_descriptor: int, own: list[Any], for_keys: list[Any]) -> "subprocess.Popen[bytes] | None":
    """The watching child; None where no other process can be started."""
    terminal = os.dup(file_descriptor)
    # -I and -S: nothing of the user's is read or imported, and it starts in 10 ms.
    command = [sys.executable, "-I", "-S", terminal_guardian.__file__, str(terminal), repr(own), repr(for_keys)]
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


@contextlib.contextmanager
def _os_errors() -> Iterator[None]:
    """The error of termios is no OSError."""
    try:
        yield
    except termios.error as error:
        raise OSError(*error.args) from error
