"""The controllers that come with taichisoft."""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from taichisoft.plugin_system import hookimpl

if TYPE_CHECKING:
    from taichisoft.session import Session


@hookimpl
def taichisoft_controllers() -> Mapping[str, Callable[..., Any]]:
    """The built-in controllers."""
    from taichisoft_controllers.closed_loop.closed_loop_controller import ClosedLoopController
    from taichisoft_controllers.keyboard.keyboard_controller import KeyboardController
    from taichisoft_controllers.scripted.scripted_controller import scripted_controller

    return {"closed-loop": ClosedLoopController, "keyboard": KeyboardController, "scripted": scripted_controller}


@hookimpl
def taichisoft_run_begins(session: "Session") -> None:
    """Read keys from the terminal, for an interactive controller."""
    from taichisoft_controllers.keyboard.key_source import begin_keys

    begin_keys(session)


@hookimpl
def taichisoft_run_ends(session: "Session") -> None:
    """Give the terminal back."""
    from taichisoft_controllers.keyboard.key_source import end_keys

    end_keys(session)
