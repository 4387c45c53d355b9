"""What plug-ins provide is found by name, and what is wrong with one is said with its name."""

import sys
from collections.abc import Callable, Mapping
from importlib.metadata import EntryPoint
from typing import Any

import pytest

from taichisoft import hookimpl
from taichisoft.errors import ControllerFailed, PluginError
from taichisoft.running import hooks, plugins
from taichisoft.running.hookspecs import PROJECT
from taichisoft.running.plugin_commands import provided_names
from taichisoft.running.plugins import Registry

Install = Callable[..., None]


def provide(*names: str) -> Callable[[], Mapping[str, Any]]:
    return lambda: dict.fromkeys(names, object)


def test_what_a_plugin_provides_is_found_by_name(install: Install) -> None:
    install("one", taichisoft_controllers=provide("push"))
    install("two", taichisoft_controllers=lambda: {"pull": int}, taichisoft_outputs=provide("pull"))
    assert hooks.find("controller", "pull") is int
    assert hooks.find("output", "pull") is object
    with pytest.raises(
        PluginError, match=r"^no controller is called 'pul'; there are: pull, push; --plugin FILE\.py brings others$"
    ):
        hooks.find("controller", "pul")


@pytest.mark.parametrize(
    ("hook", "function", "problem"),
    [
        (
            "taichisoft_controlers",
            provide("push"),
            r"taichisoft_controlers\(\) is not a hook; did you mean 'taichisoft_co",
        ),
        ("controllers", provide("push"), r"controllers\(\) is not a hook; did you mean 'taichisoft_controllers'\?"),
        ("on_start", lambda: None, r"on_start\(\) is not a hook; there are: taichisoft_controllers, "),
        (
            "taichisoft_controllers",
            lambda scene: {},
            r"taichisoft_controllers\(\) has no argument 'scene'; there are: n",
        ),
        (
            "taichisoft_step_done",
            lambda reprt: None,
            r"taichisoft_step_done\(\) has no argument 'reprt'; did you mean 're",
        ),
    ],
)
def test_a_hook_or_an_argument_that_does_not_exist_is_an_error_with_the_nearest_right_one(
    install: Install, hook: str, function: Any, problem: str
) -> None:
    install("one", **{hook: function})
    with pytest.raises(PluginError, match=rf"^plug-in 'one' \(plugin_one\) cannot be registered: {problem}"):
        plugins.plugin_registry()


def test_a_hook_of_another_version_may_be_marked_as_optional(install: Install) -> None:
    install("one")
    hook = hookimpl(lambda weather: None, optionalhook=True)
    sys.modules["plugin_one"].taichisoft_rain_begins = hook  # type: ignore[attr-defined]
    assert list(plugins.plugin_registry().origins) == ["one"]


def test_a_hook_that_wraps_others_is_refused(install: Install) -> None:
    def around() -> Any:
        yield

    install("one")
    sys.modules["plugin_one"].taichisoft_outputs = hookimpl(around, wrapper=True)  # type: ignore[attr-defined]
    with pytest.raises(
        PluginError, match=r"taichisoft_outputs\(\) wraps the hooks of other plug-ins, which is not sup"
    ):
        plugins.plugin_registry()


def test_a_forgotten_mark_and_a_module_without_hooks_are_errors(install: Install) -> None:
    install("one")
    with pytest.raises(PluginError, match=r"plug-in 'one' \(plugin_one\) .*it implements no hook; there are: taichiso"):
        plugins.plugin_registry()
    sys.modules["plugin_one"].taichisoft_outputs = provide("movie")  # type: ignore[attr-defined]
    with pytest.raises(PluginError, match=r"taichisoft_outputs\(\) is not marked with @hookimpl$"):
        plugins.plugin_registry()


def test_two_plugins_that_claim_one_name_are_named_with_where_they_come_from(install: Install) -> None:
    install("one", taichisoft_outputs=provide("movie"))
    install("two", taichisoft_outputs=provide("movie"))
    both = r"^two plug-ins, 'one' \(plugin_one\) and 'two' \(plugin_two\), both provide the output 'movie'$"
    with pytest.raises(PluginError, match=both):
        hooks.find("output", "film")


def test_two_plugins_of_one_name_are_an_error(install: Install) -> None:
    install("one", taichisoft_outputs=provide("movie"))
    install("one", "another_module", taichisoft_outputs=provide("film"))
    with pytest.raises(PluginError, match=r"^two plug-ins are called 'one': plugin_one and another_module; rename"):
        plugins.plugin_registry()


def test_a_plugin_that_cannot_be_imported_is_named_with_a_way_out(
    install: Install, monkeypatch: pytest.MonkeyPatch
) -> None:
    absent = EntryPoint("lost", "no_such_module", PROJECT)
    monkeypatch.setattr(plugins, "entry_points", lambda group: [absent])
    with (
        pytest.raises(
            PluginError,
            match=r"^plug-in 'lost' \(no_such_module\) cannot be imported: ModuleNotFoundError: No module named "
            r"'no_such_module'; TAICHISOFT_DISABLE_PLUGINS=lost leaves it out$",
        ),
        plugins.separate_registry(),
    ):
        pass


def test_a_hook_that_fails_is_named_with_its_plugin_and_place(install: Install) -> None:
    def fail() -> Mapping[str, Any]:
        raise KeyError("gripper")

    install("one", taichisoft_outputs=fail)
    failure = (
        r"^plug-in 'one' \(plugin_one\) failed in taichisoft_outputs\(\): KeyError: 'gripper' \(test_plugins.py, line"
    )
    with pytest.raises(PluginError, match=failure):
        hooks.find("output", "movie")


@pytest.mark.parametrize(
    ("answer", "problem"),
    [
        (["movie"], r"taichisoft_outputs\(\) gave \['movie'\]; must be a mapping by name"),
        (None, r"taichisoft_outputs\(\) gave None; must be a mapping"),
        ({"movie": "Movie"}, r"taichisoft_outputs\(\) gave 'Movie' as 'movie'; must be a class or a function"),
        ({3: object}, r"taichisoft_outputs\(\) gave the name 3; must be text"),
        ({" ": object}, r"taichisoft_outputs\(\) gave the name ' '; must be text"),
    ],
)
def test_a_hook_that_gives_something_else_is_named_with_its_plugin(install: Install, answer: Any, problem: str) -> None:
    install("one", taichisoft_outputs=lambda: answer)
    with pytest.raises(PluginError, match=rf"^plug-in 'one' \(plugin_one\): {problem}"):
        hooks.find("output", "movie")


def test_life_cycle_hooks_reach_every_plugin_in_order_until_one_fails(install: Install) -> None:
    calls: list[str] = []

    def fail(session: Any) -> None:
        raise ValueError("no disk")

    install("one", taichisoft_run_ends=lambda session, outcome: calls.append(f"one {session} {outcome}"))
    install("two", taichisoft_run_ends=lambda outcome: calls.append(f"two {outcome}"), taichisoft_run_begins=fail)
    install("three", taichisoft_run_begins=lambda: calls.append("three"))
    hooks.notify("taichisoft_run_ends", session="session", outcome="completed")
    assert calls == ["one session completed", "two completed"]
    hooks.notify("taichisoft_picture_wanted", session="session")  # which nobody implements
    with pytest.raises(
        PluginError, match=r"^plug-in 'two' .* failed in taichisoft_run_begins\(\): ValueError: no disk"
    ):
        hooks.notify("taichisoft_run_begins", session="session")


def test_marks_of_pluggy_change_the_order(install: Install) -> None:
    calls: list[str] = []
    for name, marks in {"a": {"trylast": True}, "b": {}, "c": {"tryfirst": True}, "d": {}}.items():
        install(name)
        hook = hookimpl(lambda name=name: calls.append(name), **marks)
        sys.modules[f"plugin_{name}"].taichisoft_run_begins = hook  # type: ignore[attr-defined]
    hooks.notify("taichisoft_run_begins", session=None)
    assert calls == ["c", "b", "d", "a"]


def test_a_plugin_may_say_that_a_run_has_failed(install: Install) -> None:
    def give_up() -> None:
        raise ControllerFailed("the cube is gone")

    install("one", taichisoft_step_done=give_up)
    with pytest.raises(ControllerFailed, match=r"^the cube is gone$"):
        hooks.notify("taichisoft_step_done", session=None, report=None)


def test_the_list_says_what_each_plugin_provides_through_its_hooks(install: Install) -> None:
    def add(application: Any) -> None:
        application.command("wave")(lambda: None)

    install("one", taichisoft_controllers=provide("push", "pull"), taichisoft_commands=add)
    install("two", taichisoft_outputs=provide("movie"), taichisoft_step_done=lambda: None)
    install("three", taichisoft_geometry_kinds=provide("bellows"), taichisoft_scene_readers=provide(".yaml"))
    assert provided_names() == {
        "one": ["controller pull", "controller push", "command wave"],
        "three": ["geometry kind bellows", "scene reader .yaml"],
        "two": ["output movie", "taichisoft_step_done()"],
    }


def test_the_built_in_features_are_plugins_like_any_other_and_come_first(taichisoft_plugins: Registry) -> None:
    listed = provided_names()
    assert list(listed)[:4] == ["arm", "controllers", "meshing", "outputs"]
    assert "controller scripted" in listed["controllers"]
    assert {"output recording", "output metrics", "output pictures"} <= set(listed["outputs"])
    assert {"geometry kind pneunet_finger", "mesh maker .toml", "command mesh"} <= set(listed["meshing"])
    origin = taichisoft_plugins.origins["meshing"]
    assert (origin.kind, origin.distribution, origin.place) == ("distribution", "taichisoft", "taichisoft_meshing")
