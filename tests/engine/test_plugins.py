"""Plug-ins come from distributions, files and code; what they provide is found by name, and errors name them."""

import pickle
import sys
from collections.abc import Callable, Mapping
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import pytest

from taichisoft import hookimpl, register_plugin, unregister_plugin
from taichisoft.errors import ControllerFailed, PluginError
from taichisoft.running import hooks, plugins
from taichisoft.running.hookspecs import PROJECT
from taichisoft.running.plugin_commands import provided_names
from taichisoft.running.plugins import Registry, plugin_traceback

Install = Callable[..., None]
PUSH = """
from taichisoft.running.hookspecs import hookimpl
__version__ = "2.1"

@hookimpl
def taichisoft_controllers():
    return {"NAME": dict}
"""


class Watcher:
    """A plug-in that is an object."""

    def __init__(self) -> None:
        self.outcomes: list[str] = []

    @hookimpl
    def taichisoft_run_ends(self, outcome: str) -> None:
        self.outcomes.append(outcome)


def provide(*names: str) -> Callable[[], Mapping[str, Any]]:
    return lambda: dict.fromkeys(names, object)


def wrap() -> Any:
    yield


def write(path: Path, name: str = "push") -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(PUSH.replace("NAME", name))
    return path


def test_things_are_found_by_name(install: Install) -> None:
    install("one", taichisoft_controllers=provide("push"))
    install("two", taichisoft_controllers=lambda: {"pull": int}, taichisoft_outputs=provide("pull"))
    assert hooks.find("controller", "pull") is int
    assert hooks.find("output", "pull") is object
    with pytest.raises(PluginError, match=r"^no controller is called 'pul'; there are: pull, push; --plugin FILE\.py "):
        hooks.find("controller", "pul")


@pytest.mark.parametrize(
    ("hook", "function", "problem"),
    [
        (
            "taichisoft_controlers",
            hookimpl(provide()),
            r"taichisoft_controlers\(\) is not a hook; did you mean 'taichi",
        ),
        ("controllers", hookimpl(provide()), r"controllers\(\) is not a hook; did you mean 'taichisoft_controllers'\?"),
        ("on_start", hookimpl(provide()), r"on_start\(\) is not a hook; there are: taichisoft_controllers, "),
        ("taichisoft_outputs", hookimpl(lambda scene: {}), r"taichisoft_outputs\(\) has no argument 'scene'; there ar"),
        ("taichisoft_step_done", hookimpl(lambda reprt: 0), r".* has no argument 'reprt'; did you mean 'report'"),
        (
            "taichisoft_outputs",
            hookimpl(wrap, wrapper=True),
            r"taichisoft_outputs\(\) wraps the hooks of other plug-in",
        ),
        ("taichisoft_outputs", provide("movie"), r"taichisoft_outputs\(\) is not marked with @hookimpl$"),
        ("movies", provide("movie"), "it implements no hook; there are: taichisoft_controllers, "),
    ],
)
def test_wrong_hook_is_refused(install: Install, hook: str, function: Any, problem: str) -> None:
    install("one")
    setattr(sys.modules["plugin_one"], hook, function)
    with pytest.raises(PluginError, match=rf"^plug-in 'one' \(plugin_one\) cannot be registered: {problem}"):
        plugins.plugin_registry()


def test_hook_of_another_version_may_be_optional(install: Install) -> None:
    install("one")
    hook = hookimpl(lambda weather: None, optionalhook=True)
    sys.modules["plugin_one"].taichisoft_rain_begins = hook  # type: ignore[attr-defined]
    assert list(plugins.plugin_registry().origins) == ["one"]


def test_names_claimed_twice_are_refused(install: Install, tmp_path: Path) -> None:
    install("one", taichisoft_outputs=provide("movie"))
    install("two", taichisoft_outputs=provide("movie"))
    both = r"^two plug-ins, 'one' \(plugin_one\) and 'two' \(plugin_two\), both provide the output 'movie'$"
    with pytest.raises(PluginError, match=both):
        hooks.find("output", "film")
    first, second = write(tmp_path / "push.py"), write(tmp_path / "other" / "push.py")
    plugins.load_plugin(first)
    plugins.load_plugin(tmp_path / "other" / ".." / "push.py")  # the same file
    with pytest.raises(PluginError, match=rf"^two plug-ins are called 'push': {first} and {second}; rename one of th"):
        plugins.load_plugin(second)
    install("one", "another_module", taichisoft_outputs=provide("film"))
    with pytest.raises(PluginError, match=r"^two plug-ins are called 'one': plugin_one and another_module; rename"):
        plugins.plugin_registry()


def test_distribution_that_cannot_be_imported_has_way_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plugins, "entry_points", lambda group: [EntryPoint("lost", "no_such_module", PROJECT)])
    problem = (
        r"^plug-in 'lost' \(no_such_module\) cannot be imported: ModuleNotFoundError: No module named "
        r"'no_such_module'; TAICHISOFT_DISABLE_PLUGINS=lost leaves it out$"
    )
    with pytest.raises(PluginError, match=problem), plugins.separate_registry():
        pass


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
def test_wrong_answer_of_hook_names_plugin(install: Install, answer: Any, problem: str) -> None:
    install("one", taichisoft_outputs=lambda: answer)
    with pytest.raises(PluginError, match=rf"^plug-in 'one' \(plugin_one\): {problem}"):
        hooks.find("output", "movie")


def fail(error: BaseException) -> Callable[[], Any]:
    def failing() -> Any:
        raise error

    return failing


def test_failed_hook_names_plugin_and_place(install: Install) -> None:
    install("one", taichisoft_outputs=fail(KeyError("gripper")))
    failure = r"^plug-in 'one' \(plugin_one\) failed in taichisoft_outputs\(\): KeyError: 'gripper' \(test_plugins.py, "
    with pytest.raises(PluginError, match=failure):
        hooks.find("output", "movie")


def test_life_cycle_hooks_run_in_order_until_one_fails(install: Install) -> None:
    calls: list[str] = []
    install("one", taichisoft_run_ends=lambda session, outcome: calls.append(f"one {session} {outcome}"))
    begins = fail(ValueError("no disk"))
    install("two", taichisoft_run_ends=lambda outcome: calls.append(f"two {outcome}"), taichisoft_run_begins=begins)
    install("three", taichisoft_run_begins=lambda: calls.append("three"))
    install("four", taichisoft_step_done=fail(ControllerFailed("the cube is gone")))
    hooks.notify("taichisoft_run_ends", session="session", outcome="completed")
    assert calls == ["one session completed", "two completed"]
    hooks.notify("taichisoft_picture_wanted", session="session")  # which nobody implements
    with pytest.raises(PluginError, match=r"^plug-in 'two' .* failed in taichisoft_run_begins\(\): ValueError: no di"):
        hooks.notify("taichisoft_run_begins", session="session")
    with pytest.raises(ControllerFailed, match=r"^the cube is gone$"):
        hooks.notify("taichisoft_step_done", session=None, report=None)


def test_marks_of_pluggy_change_order(install: Install) -> None:
    calls: list[str] = []
    for name, marks in {"a": {"trylast": True}, "b": {}, "c": {"tryfirst": True}, "d": {}}.items():
        install(name)
        hook = hookimpl(lambda name=name: calls.append(name), **marks)
        sys.modules[f"plugin_{name}"].taichisoft_run_begins = hook  # type: ignore[attr-defined]
    hooks.notify("taichisoft_run_begins", session=None)
    assert calls == ["c", "b", "d", "a"]


def test_list_shows_what_each_plugin_provides(install: Install) -> None:
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


def test_built_in_features_are_plugins_and_come_first(taichisoft_plugins: Registry) -> None:
    listed = provided_names()
    assert list(listed)[:4] == ["arm", "controllers", "meshing", "outputs"]
    assert "controller scripted" in listed["controllers"]
    assert {"output recording", "output metrics", "output pictures"} <= set(listed["outputs"])
    assert {"geometry kind pneunet_finger", "mesh maker .toml", "command mesh"} <= set(listed["meshing"])
    origin = taichisoft_plugins.origins["meshing"]
    assert (origin.kind, origin.distribution, origin.place) == ("distribution", "taichisoft", "taichisoft_meshing")


def test_plugins_of_all_sources_load_in_order(install: Install, tmp_path: Path) -> None:
    install("installed", taichisoft_outputs=lambda: {})
    path = write(tmp_path / "squeeze.py", "squeeze")
    plugins.load_plugin(path)
    register_plugin(Watcher())
    package = write(tmp_path / "a" / "__init__.py", "a")
    package.write_text(package.read_text() + "from . import helper\n")
    (package.parent / "helper.py").touch()
    plugins.load_plugin(package.parent)
    origins = plugins.plugin_registry().origins
    assert list(origins) == ["installed", "squeeze", "Watcher", "a"]
    assert (origins["squeeze"].kind, origins["squeeze"].place, origins["squeeze"].version) == ("file", str(path), "2.1")
    assert origins["Watcher"].kind == "code"
    assert origins["Watcher"].place.startswith(f"{__file__}, line ")
    assert hooks.find("controller", "squeeze") is dict


def test_object_is_called_until_it_is_unregistered(install: Install) -> None:
    watcher = Watcher()
    name = register_plugin(watcher, name="watcher")
    hooks.notify("taichisoft_run_ends", session=None, outcome="completed")
    unregister_plugin(name)
    hooks.notify("taichisoft_run_ends", session=None, outcome="interrupted")
    assert watcher.outcomes == ["completed"]
    with pytest.raises(PluginError, match=r"^no plug-in is called 'watcher'; there are: none$"):
        unregister_plugin(name)


def test_wrong_objects_are_refused_and_leave_nothing(install: Install) -> None:
    class Misspelt(Watcher):
        @hookimpl
        def taichisoft_run_begin(self) -> None: ...

    watcher = Watcher()
    register_plugin(watcher)
    for given, problem in (
        ((Misspelt(),), r"'Misspelt' \(registered in .*line \d+\).*mean 'taichisoft_run_begins'\?$"),
        ((Watcher, "w"), r"Watcher is a class; give an object of it$"),
        ((Watcher(),), r"^two plug-ins are called 'Watcher': registered in .* and registered in .*; rename"),
        ((watcher, "b"), r"^plug-in 'b' \(.*\) cannot be registered: it is registered as 'Watcher' already$"),
    ):
        with pytest.raises(PluginError, match=problem):
            register_plugin(*given)
    assert list(plugins.plugin_registry().origins) == ["Watcher"]


def test_class_of_file_can_be_pickled(install: Install, tmp_path: Path) -> None:
    path = write(tmp_path / "my-push.py")
    path.write_text(PUSH + "\nclass Push: pass\n")
    plugins.load_plugin(path)
    push = sys.modules["taichisoft_plugin_my-push"].Push
    assert isinstance(pickle.loads(pickle.dumps(push())), push)


@pytest.mark.parametrize(
    ("name", "problem"),
    [
        ("nothing.py", r"^--plugin .*nothing.py: no such file$"),
        ("notes.txt", r"^--plugin .*notes.txt: '.txt' is not Python; a file \(.py\) is needed$"),
        ("empty", r"^--plugin .*empty: is a folder without __init__.py; a file \(.py\) or a package is needed$"),
        ("plain.py", r"^plug-in 'plain' \(.*plain.py\) cannot be registered: it implements no hook"),
    ],
)
def test_file_without_plugin_is_refused(install: Install, tmp_path: Path, name: str, problem: str) -> None:
    (tmp_path / "notes.txt").touch()
    (tmp_path / "plain.py").touch()
    (tmp_path / "empty").mkdir()
    with pytest.raises(PluginError, match=problem):
        plugins.load_plugin(tmp_path / name)


@pytest.mark.parametrize(
    ("code", "problem", "traceback"),
    [
        (
            "import no_such_module",
            r"ModuleNotFoundError: No module named 'no_such_module' \(bad.py, line 1\)$",
            "line 1",
        ),
        ("def f():\n return 1 / 0\nf()", r"ZeroDivisionError: division by zero \(bad.py, line 2\)$", "line 3, in <mod"),
        ("f(", r"SyntaxError: '\(' was never closed \(bad.py, line 1\)$", 'bad.py", line 1\n    f('),
        ("raise SystemExit(3)", r"SystemExit: 3 \(bad.py, line 1\)$", "raise SystemExit(3)"),
        ("import json\njson.loads('{')", r"JSONDecodeError: .* \(bad.py, line 2\)$", "in loads"),
    ],
)
def test_failed_import_shows_place_and_traceback(
    install: Install, tmp_path: Path, code: str, problem: str, traceback: str
) -> None:
    path = tmp_path / "bad.py"
    path.write_text(code)
    with pytest.raises(PluginError, match=rf"^plug-in 'bad' \({path}\) cannot be imported: {problem}") as caught:
        plugins.load_plugin(path)
    shown = plugin_traceback(caught.value)
    assert traceback in shown
    assert "running/plugins" not in shown and "importlib" not in shown
    assert "taichisoft_plugin_bad" not in sys.modules


def test_blocked_plugins_are_not_loaded(install: Install, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A blocked name that no plug-in has is warned of once."""
    bad = tmp_path / "bad.py"
    bad.write_text("raise RuntimeError")
    monkeypatch.setenv("TAICHISOFT_DISABLE_PLUGINS", " one, bad,Watcher,,tow ")
    install("one", taichisoft_outputs=lambda: {"movie": object})
    install("two", taichisoft_outputs=lambda: {"film": object})
    plugins.load_plugin(bad)
    unregister_plugin(register_plugin(Watcher()))
    registry = plugins.plugin_registry()
    assert list(registry.origins) == ["two"]
    with pytest.warns(UserWarning) as warned:
        assert hooks.find("output", "film") is object
    (warning,) = warned
    told = "TAICHISOFT_DISABLE_PLUGINS names 'tow', which no plug-in is called; did you mean 'two'?"
    assert str(warning.message) == told
    assert registry.unknown_blocked() == []


@pytest.mark.parametrize(("value", "is_traced"), [("", False), ("0", False), ("1", True)])
def test_calls_of_hooks_are_traced_on_request(
    install: Install,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    value: str,
    is_traced: bool,
) -> None:
    monkeypatch.setenv("TAICHISOFT_TRACE_PLUGINS", value)
    install("one", taichisoft_run_ends=lambda session: None, taichisoft_controllers=provide("push"))
    install("two", taichisoft_controllers=fail(ValueError()))
    hooks.notify("taichisoft_run_ends", session=list(range(1000)), outcome="done")
    with pytest.raises(PluginError):
        hooks.find("controller", "push")
    lines = [
        "taichisoft: taichisoft_run_ends(session=[0, 1, 2, 3, 4, 5, ...], outcome='done') of plug-in 'one' gave None",
        "taichisoft: taichisoft_controllers() of plug-in 'one' gave {'push': <class 'object'>}",
        "taichisoft: taichisoft_controllers() of plug-in 'two' failed",
    ]
    assert capsys.readouterr().err.splitlines() == (lines if is_traced else [])


def test_separate_registry_leaves_other_as_it_was(install: Install) -> None:
    register_plugin(Watcher(), "outer")
    with plugins.separate_registry() as registry:
        register_plugin(Watcher(), "inner")
        assert list(registry.origins) == ["inner"]
    assert list(plugins.plugin_registry().origins) == ["outer"]
