"""The plug-in registry: what is wrong with a plug-in is said with its name."""

import sys
from collections.abc import Callable, Iterator, Mapping
from importlib.metadata import EntryPoint
from types import ModuleType
from typing import Any

import pytest
import typer

from taichisoft import plugins
from taichisoft.errors import PluginError
from taichisoft.hookspecs import PROJECT, hookimpl

Install = Callable[..., None]


@pytest.fixture
def install(monkeypatch: pytest.MonkeyPatch) -> Iterator[Install]:
    """Makes a plug-in of the functions given, under a name, beside those installed before it in the test."""
    found: list[EntryPoint] = []

    def add(name: str, module: str | None = None, **functions: Any) -> None:
        made = ModuleType(module or f"plugin_{name}")
        for hook, function in functions.items():
            setattr(made, hook, hookimpl(function))
        monkeypatch.setitem(sys.modules, made.__name__, made)
        found.append(EntryPoint(name, made.__name__, PROJECT))

    monkeypatch.setattr(plugins, "entry_points", lambda group: found)
    plugins.plugin_registry.cache_clear()
    yield add
    plugins.plugin_registry.cache_clear()


def provide(*names: str) -> Callable[[], Mapping[str, Any]]:
    return lambda: dict.fromkeys(names, object)


def test_what_a_plugin_provides_is_found_by_name(install: Install) -> None:
    install("one", taichisoft_controllers=provide("push"))
    install("two", taichisoft_controllers=lambda: {"pull": int}, taichisoft_outputs=provide("pull"))
    assert plugins.find("controller", "pull") is int
    assert plugins.find("output", "pull") is object
    with pytest.raises(PluginError, match=r"^no controller is called 'pul'; there are: pull, push$"):
        plugins.find("controller", "pul")


def test_a_misspelt_hook_is_an_error_that_names_it(install: Install) -> None:
    install("one", taichisoft_controlers=provide("push"))
    with pytest.raises(PluginError, match=r"taichisoft_controlers.*there are: taichisoft_controllers, taichisoft_out"):
        plugins.plugin_registry()


def test_a_hook_with_an_argument_that_does_not_exist_is_an_error(install: Install) -> None:
    install("one", taichisoft_controllers=lambda scene: {})
    with pytest.raises(PluginError, match=r"plug-in 'one' \(plugin_one\) cannot be registered: (.|\n)*scene"):
        plugins.plugin_registry()


def test_two_plugins_that_claim_one_name_are_named(install: Install) -> None:
    install("one", taichisoft_outputs=provide("movie"))
    install("two", taichisoft_outputs=provide("movie"))
    with pytest.raises(PluginError, match=r"^two plug-ins, '(one|two)' and '(one|two)', both provide the output 'mov"):
        plugins.find("output", "movie")


def test_two_plugins_of_one_name_are_an_error(install: Install) -> None:
    install("one", taichisoft_outputs=provide("movie"))
    install("one", "another_module", taichisoft_outputs=provide("film"))
    with pytest.raises(PluginError, match=r"^two plug-ins are called 'one': plugin_one and another_module"):
        plugins.plugin_registry()


def test_a_plugin_that_cannot_be_imported_is_named(install: Install, monkeypatch: pytest.MonkeyPatch) -> None:
    absent = EntryPoint("lost", "no_such_module_anywhere", PROJECT)
    monkeypatch.setattr(plugins, "entry_points", lambda group: [absent])
    with pytest.raises(PluginError, match=r"^plug-in 'lost' \(no_such_module_anywhere\) cannot be imported: No module"):
        plugins.plugin_registry()


def test_a_hook_that_fails_is_named_with_its_plugin_and_place(install: Install) -> None:
    def fail() -> Mapping[str, Any]:
        raise KeyError("gripper")

    install("one", taichisoft_outputs=fail)
    with pytest.raises(
        PluginError, match=r"^plug-in 'one' failed in taichisoft_outputs\(\): KeyError: 'gripper' \(tes"
    ):
        plugins.find("output", "movie")


def test_a_hook_that_gives_no_mapping_is_named_with_its_plugin(install: Install) -> None:
    install("one", taichisoft_outputs=lambda: ["movie"])
    with pytest.raises(
        PluginError, match=r"^plug-in 'one': taichisoft_outputs\(\) gave \['movie'\]; must be a mapping"
    ):
        plugins.find("output", "movie")


def test_commands_are_added_and_one_that_cannot_be_is_named(install: Install) -> None:
    def add(application: typer.Typer) -> None:
        application.command("wave")(lambda: None)

    def fail(application: typer.Typer) -> None:
        raise RuntimeError("no arms")

    install("one", taichisoft_commands=add)
    install("silent", taichisoft_commands=lambda: None)  # pluggy lets a hook leave out arguments
    application = typer.Typer()
    plugins.add_commands(application)
    assert [command.name for command in application.registered_commands] == ["wave"]
    install("two", taichisoft_commands=fail)
    plugins.plugin_registry.cache_clear()
    with pytest.raises(PluginError, match=r"^plug-in 'two' failed in taichisoft_commands\(\): RuntimeError: no arms"):
        plugins.add_commands(application)


def test_the_list_says_what_each_plugin_provides_through_its_hooks(install: Install) -> None:
    install("one", taichisoft_controllers=provide("push", "pull"), taichisoft_commands=lambda: None)
    install("two", taichisoft_outputs=provide("movie"))
    sys.modules["plugin_two"].taichisoft_controllers = provide("not marked as a hook")  # type: ignore[attr-defined]
    listed = {plugin.name: plugin.provides for plugin in plugins.list_plugins()}
    assert listed == {"one": ["controller pull", "controller push", "commands"], "two": ["output movie"]}


def test_the_built_in_features_are_plugins_like_any_other() -> None:
    listed = {plugin.name: plugin.provides for plugin in plugins.list_plugins()}
    assert "controller scripted" in listed["controllers"]
    assert {"output recording", "output metrics", "output pictures"} <= set(listed["outputs"])
    assert listed["meshing"] == ["commands"]
