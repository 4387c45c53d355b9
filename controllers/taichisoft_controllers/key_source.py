"""Where a run that heeds keys gets them from on this machine: the terminal it was started in."""

import sys
import warnings
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from taichisoft.session.session import Session

_sources: dict[int, Any] = {}


def begin_keys(session: "Session") -> None:
    """Read keys for a run with an interactive controller, unless they come from an earlier session."""
    if session.replaying or not session.controller.interactive:
        return
    if sys.stdin is None or not sys.stdin.isatty():
        if not any(output.gives_keys for output in session.outputs):
            warnings.warn(
                "standard input is no terminal, so no keys come from there; Ctrl and c ends the run", stacklevel=2
            )
        return
    _sources[id(session)] = _source(session)


def end_keys(session: "Session") -> None:
    """Give the terminal back."""
    source = _sources.pop(id(session), None)
    if source is not None:
        source.end()


def _source(session: "Session") -> Any:
    if sys.platform == "win32":
        from taichisoft_controllers.windows_keys import WindowsKeys

        return WindowsKeys(session.keys)
    from taichisoft_controllers.terminal_keys import TerminalKeys

    return TerminalKeys(session, sys.stdin.fileno())
