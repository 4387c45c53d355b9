"""Nothing that comes from elsewhere can tell a terminal what to do."""

import io
import warnings
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from taichisoft import load_scene
from taichisoft.base import printable, say
from taichisoft.command_line import _print_error
from taichisoft.errors import SceneError, TaichisoftError
from taichisoft.running import print_line, warnings_printed_to

CLEAR = "\x1b[2J\x1b]0;owned\x07"


@given(st.text())
def test_what_is_printed_has_no_control_characters_and_nothing_else_changes(text: str) -> None:
    shown = printable(text)
    assert all(one.isprintable() or one in "\n\t" for one in shown)
    if text.isprintable():
        assert shown == text


def test_errors_and_warnings_write_them_out(capsys: pytest.CaptureFixture[str]) -> None:
    _print_error(TaichisoftError(f"{CLEAR}.toml: no such scene"))
    shown = io.StringIO()
    with warnings_printed_to(Console(file=shown, force_terminal=False)):
        warnings.warn(f"plug-in says {CLEAR}", stacklevel=1)
    for text in (capsys.readouterr().err, shown.getvalue()):
        assert "\x1b" not in text and "\x07" not in text
        assert r"\x1b[2J\x1b]0;owned\x07" in text


def test_paths_write_them_out_and_one_that_is_no_text_is_no_error(capsys: pytest.CaptureFixture[str]) -> None:
    shown = io.StringIO()
    path = Path(f"{CLEAR}\udcff.html")
    print_line(Console(file=shown, force_terminal=False), f"results in {path}")
    say(path)
    assert capsys.readouterr().out == "\\x1b[2J\\x1b]0;owned\\x07\\udcff.html\n"
    assert shown.getvalue() == "results in \\x1b[2J\\x1b]0;owned\\x07\\udcff.html\n"


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("cu\\u001b[2Jbe", r"rigid_bodies has a 'cu\\x1b\[2Jbe': a name must not contain control characters"),
        ("cu\\nbe", r"rigid_bodies has a 'cu\\nbe': a name must not contain control characters"),
        ("cu\\u0000be", r"rigid_bodies has a 'cu\\x00be': a name must not contain control characters"),
        ("c" * 201, r"rigid_bodies has a 'c{20}\.\.\.': a name must not be longer than 200 characters"),
    ],
)
def test_names_that_no_file_or_terminal_takes_are_refused(tmp_path: Path, name: str, message: str) -> None:
    scene = tmp_path / "scene.toml"
    scene.write_text(f'[rigid_bodies."{name}"]\nbox = [1.0, 1.0, 1.0]\nmass = 1.0\nposition = [0.0, 0.0, 0.0]\n')
    with pytest.raises(SceneError, match=message) as caught:
        load_scene(str(scene))
    assert "\n" not in str(caught.value)
