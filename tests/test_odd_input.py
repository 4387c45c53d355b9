"""Input that nobody should write, and everybody sometimes does: it ends in one line, never in a traceback."""

import sys
from pathlib import Path

import pytest
from mistaken_input import run_batch

from taichisoft import load_scene
from taichisoft.base import parse_toml
from taichisoft.base.files import DEEPEST
from taichisoft.command_line import LONGEST_LINE, main
from taichisoft.errors import SceneError

DEEP = 2000


def told(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """The one line with which a command refuses what it was given."""
    monkeypatch.setattr(sys, "argv", ["taichisoft", *arguments])
    with pytest.raises(SystemExit) as left:
        main()
    assert left.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("taichisoft: ")
    return line


@pytest.mark.parametrize(
    ("scene", "problem"),
    [
        ("soft_bodies.a = 'text'\nsoft_bodies.b.like = 'a'", "soft_bodies.a must be a table"),
        (f"title = {'[' * DEEP}{']' * DEEP}", f"nested deeper than {DEEPEST}"),
        (f"{'a.' * DEEP}a = 1", f"nested deeper than {DEEPEST}"),
        (f"gravity = [0, 0, {'9' * 5000}]", "integer of thousands of digits"),
        (f"[soft_bodies.a]\nmesh = '{'x' * 5000}'", "no such file"),
        ("[soft_bodies.a]\nmesh = '~nobody-of-this-name/x'", "no such file"),
        ("[soft_bodies.a]\nmaterial = 'x\\u0000'\nmesh = 'tutorial-coarse'", "materials"),
    ],
)
def test_a_scene_that_cannot_be_meant(tmp_path: Path, scene: str, problem: str) -> None:
    file = tmp_path / "scene.toml"
    file.write_text(scene)
    with pytest.raises(SceneError) as refused:
        load_scene(file)
    assert problem in str(refused.value)


@pytest.mark.parametrize(
    "arguments",
    [
        ["recording", "report", ""],
        ["recording", "report", "x" * 5000],
        ["recording", "plot", "x" * 300],
        ["run", "gripper", "--web", "--web-address", "í:8080"],
        ["run", "gripper", "--set", f"{'a.' * DEEP}a=1"],
        ["run", "x" * 5000],
        ["run", "~nobody-of-this-name/scene.toml"],
        ["plugins", "--plugin", "x" * 5000],
    ],
)
def test_a_command_line_that_cannot_be_meant(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path, arguments: list[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert len(told(monkeypatch, capsys, *arguments)) < 1.1 * LONGEST_LINE


def test_nesting_is_counted() -> None:
    assert parse_toml(f"a = {'[' * (DEEPEST - 1)}{']' * (DEEPEST - 1)}")
    with pytest.raises(ValueError, match="nested deeper"):
        parse_toml(f"a = {'[' * (DEEPEST + 1)}{']' * (DEEPEST + 1)}")


@pytest.mark.parametrize(
    ("kind", "count"),
    [("scenes", 25), ("command lines", 40), ("mesh files", 12), ("STEP files", 2), ("tables of studies", 2)],
)
def test_mistakes_drawn_at_random_end_in_one_line(kind: str, count: int) -> None:
    """A few of each kind, at random."""
    assert run_batch(kind, 5000, count) == []
