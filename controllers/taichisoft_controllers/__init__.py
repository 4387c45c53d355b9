"""The controllers that come with taichisoft."""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from taichisoft.running import Imported, hookimpl

if TYPE_CHECKING:
    from taichisoft.running import Session


@hookimpl
def taichisoft_controllers() -> Mapping[str, Callable[..., Any]]:
    """The built-in controllers."""
    places = {
        "closed-loop": "closed_loop:ClosedLoopController",
        "inverse": "inverse_controller:InverseController",
        "keyboard": "keyboard_controller:KeyboardController",
        "scripted": "scripted_controller:scripted_controller",
    }
    return Imported(__name__, places)


@hookimpl
def taichisoft_run_begins(session: "Session") -> None:
    """Read keys from the terminal, for an interactive controller."""
    from taichisoft_controllers.terminal_keys import begin_keys

    begin_keys(session)


@hookimpl
def taichisoft_run_ends(session: "Session") -> None:
    """Give the terminal back."""
    from taichisoft_controllers.terminal_keys import end_keys

    end_keys(session)
