"""The source of a run's keys: the terminal in which the run was started."""

import sys
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from taichisoft.caller_warnings import warn_caller
from taichisoft.errors import ControllerFailed

if TYPE_CHECKING:
    from taichisoft.session import Session

_sources: dict[int, Any] = {}


def begin_keys(session: "Session") -> None:
    """Read keys from the terminal for a run with an interactive controller, unless an earlier session gives them.

    Raises:
        ControllerFailed: this system has no POSIX terminal, and no output of the run gives keys either.
    """
    if session.replaying or not session.controller.interactive:
        return
    outputs_give_keys = any(output.gives_keys for output in session.outputs)
    if sys.stdin is None or not sys.stdin.isatty():
        if not outputs_give_keys:
            warn_caller("standard input is not a terminal, so no keys come from there; Ctrl and c ends the run")
        return
    if find_spec("termios") is None:  # as on Windows
        if not outputs_give_keys:
            raise ControllerFailed(
                "keys from the terminal need Linux or macOS; steer by the web page (--web), repeat a session (--keys), "
                "or take a controller that needs no keys (scripted, closed-loop)"
            )
        return
    from taichisoft_controllers.keyboard.terminal_keys import TerminalKeys

    _sources[id(session)] = TerminalKeys(session, sys.stdin.fileno())


def end_keys(session: "Session") -> None:
    """Give the terminal back."""
    source = _sources.pop(id(session), None)
    if source is not None:
        source.end()
