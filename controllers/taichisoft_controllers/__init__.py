"""The controllers that come with taichisoft."""

from collections.abc import Callable, Mapping
from typing import Any

from taichisoft.hookspecs import hookimpl


@hookimpl
def taichisoft_controllers() -> Mapping[str, Callable[..., Any]]:
    """The built-in controllers."""
    from taichisoft_controllers.scripted import ScriptedController

    return {"scripted": ScriptedController}
