"""What tests of plug-ins share."""

import sys
from collections.abc import Callable, Iterator
from importlib.metadata import EntryPoint
from types import ModuleType
from typing import Any

import pytest

from taichisoft import plugin_sources, plugins
from taichisoft.hookspecs import PROJECT, hookimpl


@pytest.fixture
def install(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., None]]:
    """Makes a plug-in of the functions given, under a name, beside those installed before it in the test.

    No other plug-in is there, the built-in ones included; those that are loaded in the test are gone after it.
    """
    found: list[EntryPoint] = []

    def add(name: str, module: str | None = None, **functions: Any) -> None:
        made = ModuleType(module or f"plugin_{name}")
        for hook, function in functions.items():
            setattr(made, hook, hookimpl(function))
        monkeypatch.setitem(sys.modules, made.__name__, made)
        found.append(EntryPoint(name, made.__name__, PROJECT))
        plugins._loaded = None

    monkeypatch.setattr(plugin_sources, "entry_points", lambda group: found)
    with plugins.separate_registry():
        yield add
