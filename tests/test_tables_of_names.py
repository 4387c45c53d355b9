"""Tables on the terminal show names as they are: the markup of rich is text, control characters are written out."""

import csv
import io
from pathlib import Path

import pytest
import rich
from rich.console import Console
from typer.testing import CliRunner

from taichisoft.base import plain
from taichisoft_benchmarks.__main__ import bench
from taichisoft_outputs import material_files
from taichisoft_outputs.materials_command import materials
from taichisoft_studies.mesh_variants import summary_table
from taichisoft_studies.study_commands import compare

NAME = "[red]\x1b[2Jfinger[/red]"
SHOWN = r"[red]\x1b[2Jfinger[/red]"


def on_terminal(table: object) -> str:
    console = Console(file=io.StringIO(), width=300, color_system=None, force_terminal=False)
    console.print(table)
    return console.file.getvalue()  # type: ignore[attr-defined]


def test_plain_text_has_neither_markup_nor_control_characters() -> None:
    assert plain(NAME).plain == SHOWN
    assert on_terminal(plain(NAME)) == SHOWN + "\n"


def test_a_sweep_of_meshes_shows_its_columns_values_and_title() -> None:
    rows = [{NAME: NAME, "nodes": "12", "folder": "", "problem": "broken"}]
    text = on_terminal(summary_table(rows, NAME))
    assert text.count(SHOWN) == 3 and "failed" in text
    assert "\x1b" not in text


def test_a_comparison_shows_keys_and_values(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for run, title in (("one", "[red]thin[/red]"), ("two", "[green]thick")):
        (tmp_path / run).mkdir()
        (tmp_path / run / "scene.toml").write_text(f'title = "{title}"\n"[blue]key" = "{run}\\u001b"\n')
    monkeypatch.setenv("COLUMNS", "200")
    compare([tmp_path / "one", tmp_path / "two"], tmp_path / "both")
    text = capsys.readouterr().out
    assert "[red]thin[/red]" in text and "[green]thick" in text
    assert "scene.[blue]key" in text and r"one\x1b" in text and "\x1b" not in text
    with (tmp_path / "both" / "comparison.csv").open(newline="") as file:
        assert ["scene.title", "[red]thin[/red]", "[green]thick"] in list(csv.reader(file))


def test_materials_are_listed_by_names_and_units(monkeypatch: pytest.MonkeyPatch) -> None:
    one = next(iter(material_files.shipped_materials().values()))
    monkeypatch.setattr(material_files, "materials_of_plugins", lambda: {NAME: one})
    monkeypatch.setattr(rich, "get_console", lambda: Console(width=200))
    text = CliRunner().invoke(materials).stdout
    assert SHOWN in text and "\x1b" not in text
    assert "Young's modulus at rest [kPa]" in text


def test_cases_of_a_benchmark_are_lines_of_text(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    window = "step_ms = [2, 20]"
    (tmp_path / "cases.toml").write_text(
        f'[finger]\nkind = "steps"\ntitle = "[red]thin\\u001b"\nscene = "finger-inflated"\nfinger = "finger"\n'
        f'mesh = "tutorial-coarse"\nsteps = 30\nwindows = {{ {window} }}\n'
    )
    bench(cases=tmp_path / "cases.toml", list_=True)
    assert capsys.readouterr().out.rstrip().endswith(r" [red]thin\x1b")
