"""docs/plugins.md names every hook, argument and attribute, and all that it shows to be typed works."""

import inspect
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

import taichisoft
from taichisoft.command_line import main
from taichisoft.control.control import Control
from taichisoft.control.controller import Controller
from taichisoft.control.keys import KeyEvent
from taichisoft.control.observation import Observation
from taichisoft.plugin_system import hooks, hookspecs, plugins
from taichisoft.plugin_system import reference as plugin_reference
from taichisoft.plugin_system.reference import MARK, Session
from taichisoft.plugin_system.registry import hook_names

DOCUMENT = (Path(__file__).resolve().parents[1] / "docs" / "plugins.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```(\w+)\n(.*?)^```$", DOCUMENT, re.DOTALL | re.MULTILINE)


def test_the_reference_is_up_to_date() -> None:
    written = DOCUMENT.partition(MARK)[2]
    assert written == plugin_reference.plugin_reference(), (
        "run: python -m taichisoft.plugin_system.reference docs/plugins.md"
    )


def test_every_hook_with_its_arguments_and_every_attribute_is_in_the_reference() -> None:
    for name in hook_names():
        section = re.search(rf"^### `{name}\(.*?(?=^##)", DOCUMENT, re.DOTALL | re.MULTILINE)
        assert section, name
        for argument in inspect.signature(getattr(hookspecs, name)).parameters:
            assert f"\n- `{argument}`: " in section[0], (name, argument)
    for made in (Observation, Control):
        section = re.search(rf"^### {made.__name__}\n.*?(?=^##)", DOCUMENT, re.DOTALL | re.MULTILINE)
        assert section
        for attribute in inspect.get_annotations(made):
            assert f"\n| `{attribute}` |" in section[0], attribute


def test_what_is_not_in_a_docstring_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Observation, "__doc__", Observation.__doc__.replace("        flows: ", "        flow: "))
    with pytest.raises(ValueError, match=r"^Observation has time, .*flows.*; its docstring has time, .*flow, "):
        plugin_reference.plugin_reference()
    monkeypatch.undo()
    hook = hookspecs.taichisoft_step_done
    monkeypatch.setattr(hook, "__doc__", (hook.__doc__ or "").partition("Args:")[0])
    with pytest.raises(ValueError, match=r"^taichisoft_step_done: its docstring has no Args$"):
        plugin_reference.plugin_reference()


class Still(Controller):
    def control(self, observation: Observation) -> Control:
        return Control()


def test_every_attribute_of_a_session_is_in_its_docstring() -> None:
    """It is no dataclass, so the reference does not find them by itself."""
    model: Any = SimpleNamespace(scene=SimpleNamespace(time=SimpleNamespace(step=0.01)))
    session = Session(cast(Any, SimpleNamespace(model=model, state=None)), Still(), duration=1.0)
    public = {name for name in vars(session) if not name.startswith("_")}
    _, documented = plugin_reference._parse(inspect.cleandoc(Session.__doc__ or ""), "Attributes")
    assert public == set(documented)


def test_the_first_controller_has_ten_lines() -> None:
    language, code = BLOCKS[0]
    lines = [line for line in code.splitlines() if line.strip() and not line.startswith("#")]
    assert (language, len(lines)) == ("python", 10)


def test_links_within_the_document_lead_somewhere() -> None:
    headings = {
        re.sub(r"[^\w -]", "", title).replace(" ", "-").lower() for title in re.findall(r"^#+ (.*)$", DOCUMENT, re.M)
    }
    links = re.findall(r"\]\(#([^)]*)\)", DOCUMENT)
    assert links
    assert set(links) <= headings


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.chdir(tmp_path)
    with plugins.separate_registry():
        yield tmp_path


def test_all_that_is_shown_works(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """In the order of the document: files are written, programs and commands run, from one folder."""
    shown: dict[str, str] = {}
    for language, code in BLOCKS:
        file = re.match(r"# (\S+\.\w+)\n", code)
        if file:
            (folder / file[1]).write_text(code, encoding="utf-8")
        elif language == "python":
            exec(compile(code, "docs/plugins.md", "exec"), {})
            shown["program"] = capfd.readouterr().out
        elif language == "sh":
            for line in code.splitlines():
                shown[line.split()[1]] = run(line, monkeypatch, capfd)
    assert "results in out/gripper" in shown["run"]
    assert "completed after 10 steps" in shown["run"]
    assert shown["cavities"].split() == ["finger1.cavity", "finger2.cavity", "finger3.cavity"]
    assert (folder / "wedge.msh").exists()
    assert (folder / "out" / "gripper" / "forces.csv").read_text().startswith("0.01,")
    assert shown["program"].split()[0] == "completed"
    assert 4.0 < float(shown["program"].split()[1]) <= 5.0
    assert (folder / "soft-touch" / "pyproject.toml").exists()
    assert "3 passed" in shown["-m"]
    taichisoft.load_plugin("buttons.py")
    buttons = hooks.find("controller", "buttons")()
    buttons.reset(None)
    buttons.key(KeyEvent("c"))
    assert buttons.control(Observation(0.0, 0, {"left": 0.0})).pressure == {"left": 30.0}


def run(line: str, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> str:
    """Output of a command line; it must succeed."""
    command = shlex.split(line)
    if command[0] == "python":
        result = subprocess.run(
            [sys.executable, *command[1:]], capture_output=True, text=True, env=os.environ, timeout=300
        )
        assert result.returncode == 0, result.stdout + result.stderr
        return result.stdout
    assert command[0] == "taichisoft"
    monkeypatch.setattr(sys, "argv", command)
    with plugins.separate_registry(), pytest.raises(SystemExit) as left:
        main()
    out, errors = capfd.readouterr()
    assert left.value.code in (0, None), errors
    return out


def test_only_what_needs_a_network_or_an_installation_is_not_run() -> None:
    """`console` blocks are covered by tests/test_installation.py, but for the upload."""
    languages = {language for language, _ in BLOCKS}
    assert languages == {"python", "sh", "toml", "console"}
    lines = [line for language, code in BLOCKS if language == "console" for line in code.splitlines()]
    assert all(line.startswith(("$ pip ", "$ python -m ", "$ cd ", "$ taichisoft ")) for line in lines)
