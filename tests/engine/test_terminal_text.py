"""Text for terminals without control characters, and files that appear whole."""

import io
import warnings
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from taichisoft import load_scene
from taichisoft.base import atomic_file, printable, say
from taichisoft.command_line import _print_error
from taichisoft.errors import SceneError, TaichisoftError
from taichisoft.running import print_line, warnings_printed_to

# Nothing that comes from elsewhere can tell a terminal what to do.

CLEAR = "\x1b[2J\x1b]0;owned\x07"


@given(st.text())
def test_printed_text_has_no_control_characters(text: str) -> None:
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


def test_paths_are_printed_with_escapes(capsys: pytest.CaptureFixture[str]) -> None:
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


# Files that appear whole, whoever else writes them at the same time.


def test_threads_that_write_one_file_at_a_time_leave_a_whole_one(tmp_path: Path) -> None:
    path, both = tmp_path / "figures.csv", Barrier(2, timeout=60)
    texts = ["one" * 1000, "two"]

    def write(text: str) -> None:
        with atomic_file(path) as partial:
            both.wait()
            partial.write_text(text)
            both.wait()

    with ThreadPoolExecutor() as threads:
        list(threads.map(write, texts))
    assert path.read_text() in texts
    assert [file.name for file in tmp_path.iterdir()] == ["figures.csv"]
