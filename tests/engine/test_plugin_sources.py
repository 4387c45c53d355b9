"""Plug-ins come from distributions, files and code, in this order; some are left out by their names."""

import pickle
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

import taichisoft
from taichisoft import hookimpl
from taichisoft.errors import PluginError
from taichisoft.running import hooks, plugins
from taichisoft.running.plugins import plugin_traceback

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


def write(path: Path, name: str = "push") -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(PUSH.replace("NAME", name))
    return path


def test_plugins_of_all_sources_are_there_in_the_order_of_loading(install: Install, tmp_path: Path) -> None:
    install("installed", taichisoft_outputs=lambda: {})
    path = write(tmp_path / "squeeze.py", "squeeze")
    plugins.load_plugin(path)
    plugins.register_plugin(Watcher())
    origins = plugins.plugin_registry().origins
    assert list(origins) == ["installed", "squeeze", "Watcher"]
    assert (origins["squeeze"].kind, origins["squeeze"].place, origins["squeeze"].version) == ("file", str(path), "2.1")
    assert origins["Watcher"].kind == "code"
    assert origins["Watcher"].place.startswith(f"{__file__}, line ")
    assert hooks.find("controller", "squeeze") is dict


def test_an_object_is_called_with_itself_and_may_be_taken_out_again(install: Install) -> None:
    watcher = Watcher()
    name = taichisoft.register_plugin(watcher, name="watcher")
    hooks.notify("taichisoft_run_ends", session=None, outcome="completed")
    taichisoft.unregister_plugin(name)
    hooks.notify("taichisoft_run_ends", session=None, outcome="interrupted")
    assert watcher.outcomes == ["completed"]
    with pytest.raises(PluginError, match=r"^no plug-in is called 'watcher'; there are: none$"):
        taichisoft.unregister_plugin(name)


def test_what_is_wrong_with_an_object_is_said_and_nothing_of_it_stays(install: Install) -> None:
    class Misspelt(Watcher):
        @hookimpl
        def taichisoft_run_begin(self) -> None: ...

    with pytest.raises(PluginError, match=r"'Misspelt' \(registered in .*line \d+\).*mean 'taichisoft_run_begins'\?$"):
        plugins.register_plugin(Misspelt())
    with pytest.raises(PluginError, match=r"Watcher is a class; give an object of it$"):
        plugins.register_plugin(Watcher)
    plugins.register_plugin(Watcher())
    with pytest.raises(
        PluginError, match=r"^two plug-ins are called 'Watcher': registered in .* and registered in .*; r"
    ):
        plugins.register_plugin(Watcher())
    assert list(plugins.plugin_registry().origins) == ["Watcher"]


def test_one_object_under_two_names_is_refused(install: Install) -> None:
    watcher = Watcher()
    plugins.register_plugin(watcher, "a")
    with pytest.raises(
        PluginError, match=r"^plug-in 'b' \(.*\) cannot be registered: it is registered as 'a' already$"
    ):
        plugins.register_plugin(watcher, "b")


def test_a_file_is_loaded_once_and_two_of_one_name_are_an_error(install: Install, tmp_path: Path) -> None:
    first, second = write(tmp_path / "push.py"), write(tmp_path / "other" / "push.py")
    plugins.load_plugin(first)
    plugins.load_plugin(tmp_path / "other" / ".." / "push.py")
    with pytest.raises(
        PluginError, match=rf"^two plug-ins are called 'push': {first} and {second}; rename one of them$"
    ):
        plugins.load_plugin(second)


def test_a_package_is_loaded_by_its_folder(install: Install, tmp_path: Path) -> None:
    package = write(tmp_path / "a" / "__init__.py", "a")
    package.write_text(package.read_text() + "from . import helper\n")
    (package.parent / "helper.py").touch()
    plugins.load_plugin(tmp_path / "a")
    assert list(plugins.plugin_registry().origins) == ["a"]


def test_a_class_of_a_file_can_be_pickled(install: Install, tmp_path: Path) -> None:
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
def test_what_is_no_plugin_is_refused(install: Install, tmp_path: Path, name: str, problem: str) -> None:
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
            "line 1, in",
        ),
        (
            "def f():\n return 1 / 0\nf()",
            r"ZeroDivisionError: division by zero \(bad.py, line 2\)$",
            "line 3, in <module>",
        ),
        ("f(", r"SyntaxError: '\(' was never closed \(bad.py, line 1\)$", 'bad.py", line 1\n    f('),
        ("raise SystemExit(3)", r"SystemExit: 3 \(bad.py, line 1\)$", "raise SystemExit(3)"),
        ("import json\njson.loads('{')", r"JSONDecodeError: .* \(bad.py, line 2\)$", "in loads"),
    ],
)
def test_a_file_that_cannot_be_imported_is_reported_with_its_place_and_its_own_traceback(
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


def test_blocked_plugins_are_not_loaded_and_names_that_nothing_has_are_told_once(
    install: Install, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bad = tmp_path / "bad.py"
    bad.write_text("raise RuntimeError")
    monkeypatch.setenv("TAICHISOFT_DISABLE_PLUGINS", " one, bad,Watcher,,tow ")
    install("one", taichisoft_outputs=lambda: {"movie": object})
    install("two", taichisoft_outputs=lambda: {"film": object})
    plugins.load_plugin(bad)
    plugins.unregister_plugin(plugins.register_plugin(Watcher()))
    registry = plugins.plugin_registry()
    assert list(registry.origins) == ["two"]
    told = "TAICHISOFT_DISABLE_PLUGINS names 'tow', which no plug-in is called; did you mean 'two'?"
    with pytest.warns(UserWarning) as warned:
        assert hooks.find("output", "film") is object
    assert [str(warning.message) for warning in warned] == [told]
    assert registry.unknown_blocked() == []


def test_every_call_of_a_hook_is_traced_when_asked_for(
    install: Install, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail() -> Mapping[str, Any]:
        raise ValueError

    monkeypatch.setenv("TAICHISOFT_TRACE_PLUGINS", "1")
    install("one", taichisoft_run_ends=lambda session: None, taichisoft_controllers=lambda: {"push": dict})
    install("two", taichisoft_controllers=fail)
    hooks.notify("taichisoft_run_ends", session=list(range(1000)), outcome="done")
    with pytest.raises(PluginError):
        hooks.find("controller", "push")
    assert capsys.readouterr().err.splitlines() == [
        "taichisoft: taichisoft_run_ends(session=[0, 1, 2, 3, 4, 5, ...], outcome='done') of plug-in 'one' gave None",
        "taichisoft: taichisoft_controllers() of plug-in 'one' gave {'push': <class 'dict'>}",
        "taichisoft: taichisoft_controllers() of plug-in 'two' failed",
    ]


def test_a_separate_registry_leaves_the_other_one_as_it_was(install: Install) -> None:
    plugins.register_plugin(Watcher(), "outer")
    with plugins.separate_registry() as registry:
        plugins.register_plugin(Watcher(), "inner")
        assert list(registry.origins) == ["inner"]
    assert list(plugins.plugin_registry().origins) == ["outer"]


@pytest.mark.parametrize("value", ["", "0"])
def test_nothing_is_traced_otherwise(
    install: Install, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], value: str
) -> None:
    monkeypatch.setenv("TAICHISOFT_TRACE_PLUGINS", value)
    install("one", taichisoft_run_ends=lambda session: None)
    hooks.notify("taichisoft_run_ends", session=None, outcome="completed")
    assert capsys.readouterr().err == ""
