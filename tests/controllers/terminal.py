"""A terminal for tests: a program runs in a pseudo-terminal, under a shell that stays when the program ends."""

import contextlib
import os
import re
import shlex
import signal
import sys
import termios
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pexpect
from conftest import PATIENCE

# The shell, too, gets the signal of Ctrl and c, and must not end with it.
SCRIPT = 'trap : INT; "$@"; echo "shell: exit code $?"; cat'

_ESCAPE_SEQUENCE = re.compile(r"\x1b\[[0-?]*[ -/]*[@-~]")


class Terminal:
    """What a user sees and does.

    Attributes:
        own_mode: attributes of the terminal before the program started.
        before, after: what appeared before what was waited for last, and that itself.
    """

    def __init__(self, child: pexpect.spawn):
        self._child = child
        self._is_closed = False
        self.own_mode = self.mode()
        self.before = self.after = ""

    def mode(self) -> list[Any]:
        """What termios says of the terminal now."""
        return termios.tcgetattr(self._child.child_fd)

    @property
    def is_for_keys(self) -> bool:
        """Whether a key arrives at once and unseen."""
        return not self.mode()[3] & (termios.ECHO | termios.ICANON)

    @property
    def is_as_before(self) -> bool:
        """Whether it is in its own mode again."""
        return self.mode() == self.own_mode

    def type(self, text: str) -> None:
        """Send characters as a terminal would."""
        self._child.send(text)

    def wait_for(self, pattern: str) -> re.Match[str]:
        """Wait until a regular expression appears after what was waited for last."""
        self._child.expect(pattern, timeout=PATIENCE)
        self.before, self.after = _ESCAPE_SEQUENCE.sub("", self._child.before), self._child.after
        return self._child.match

    def wait_until(self, condition: Callable[[], bool]) -> None:
        """Look again and again; what the program shows is read meanwhile, as by somebody who watches."""
        deadline = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < deadline, f"waited in vain; unread: {self._child.buffer!r}; {self._state()}"
            if self._is_closed:
                time.sleep(0.05)
            else:
                self._child.expect([pexpect.TIMEOUT, pexpect.EOF], timeout=0.05)

    def _state(self) -> str:
        """What Linux says of the first process of the terminal."""
        status = Path(f"/proc/{self._child.pid}/status")
        kept = ("State", "Threads", "SigPnd", "ShdPnd", "SigBlk", "SigIgn", "SigCgt")
        lines = status.read_text().splitlines() if status.exists() else ["no such process"]
        return ", ".join(line for line in lines if line.startswith((*kept, "no such")))

    def shell_sees(self, setting: str) -> bool:
        """Whether `stty` has a setting ("echo", "-echo"), asked for in a shell that waits for a command."""
        self.type("stty -a; echo answer $((6 * 7))\r")
        self.wait_for("answer 42")
        return setting in re.split(r"[;\s]+", self.before)

    def close(self) -> None:
        """As when the window is closed."""
        self._is_closed = True
        nothing = os.open(os.devnull, os.O_RDWR)
        os.dup2(nothing, self._child.child_fd)
        os.close(nothing)


@contextlib.contextmanager
def terminal(*command: str, folder: Path, script: str = SCRIPT, shell: str = "sh") -> Iterator[Terminal]:
    """Start a command under a shell in a terminal, or a shell that asks for commands; all is gone afterwards.

    The first process of a terminal must stay: when it ends, the terminal is closed for all others.
    """
    environment = {**os.environ, "TERM": "xterm-256color", "PYTHONUNBUFFERED": "1", "PS1": "$ "}
    interactive = ["--norc", "-i"] if shell == "bash" else ["-i"]
    arguments = ["-c", script, "sh", *command] if command else interactive
    child = pexpect.spawn(shell, arguments, cwd=str(folder), env=environment, encoding="utf-8", dimensions=(40, 100))
    child.delaybeforesend = None
    try:
        yield Terminal(child)
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.kill(child.pid, signal.SIGKILL)  # it closes the terminal for all that runs in it
        child.close()


def python(program: Path) -> tuple[str, ...]:
    """The command that runs a Python file."""
    return (sys.executable, str(program))


def line(*command: str) -> str:
    """The command as it is typed in a shell."""
    return f"{shlex.join(command)}\r"
