"""The commands `taichisoft sofa check` and `taichisoft sofa convert`."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from taichisoft.base import say

if TYPE_CHECKING:
    pass

sofa = typer.Typer(help="Check scenes of SOFA, and convert them to native scenes.", no_args_is_help=True)

PythonPath = Annotated[
    str,
    typer.Option("--python-path", metavar="DIRS", help="Folders of libraries that scenes import, as in PYTHONPATH."),
]
DataPath = Annotated[
    str, typer.Option("--data-path", metavar="DIRS", help="Folders of meshes that scenes name, such as SOFA's share.")
]
Exact = Annotated[bool, typer.Option("--sofa-exact", help="Follow SOFA exactly where the default departs from it.")]
EXIT_REFUSED = 1
PLACE = re.compile(r" \([^()]*, line \d+\)")
"""A file and line in a message."""


@sofa.command()
def check(
    scenes: Annotated[list[Path], typer.Argument(metavar="SCENE...", help="SOFA scenes (.py, .pyscn, .scn).")],
    python_path: PythonPath = "",
    data_path: DataPath = "",
    sofa_exact: Exact = False,
    steps: Annotated[int, typer.Option(help="Make so many steps of each scene, too.", min=0)] = 0,
    table: Annotated[bool, typer.Option("--table", help="Print a table of the scenes' folders alone.")] = False,
) -> None:
    """List the components of scenes that are understood, have no effect, depart from SOFA, or are refused.

    The model of a scene that can be run is built, as before the first step of a run; --steps makes some of it.
    """
    from taichisoft_sofa.scene_reader import checked
    from taichisoft_sofa.translation.parts import NOTHING

    refused = empty = 0
    folders: dict[Path, dict[str, str]] = {}
    for scene in scenes:
        found = checked(scene, python_path, sofa_exact, data_path, steps)
        nothing = any(problem.endswith(NOTHING) for problem in found.problems)
        refused, empty = refused + bool(found.problems), empty + nothing
        folders.setdefault(scene.parent, {})[scene.name] = found.problems[0] if found.problems else ""
        if table:
            continue
        made = f", {steps} steps made" if steps else ""
        _line(f"{scene}: {'refused' if found.problems else f'can be run{made}'}")
        for title, counts in found.counts.items():
            listed = ", ".join(f"{kind} ({count})" if count > 1 else kind for kind, count in sorted(counts.items()))
            _line(f"  {title}: {listed or 'nothing'}")
        if found.not_read:
            _line(f"  not read here: {found.not_read}")
        for line in found.said:
            _line(f"  it says: {line}")
        for line in found.remarks:
            _line(f"  {line}")
        for line in found.problems:
            _line(f"  refused: {line}")
    for line in _table(folders) if table else ():
        _line(line)
    if len(scenes) > 1:
        hold_nothing = f"; {empty} of the others hold nothing to run" if empty else ""
        _line(f"{len(scenes) - refused} of {len(scenes)} scenes can be run{hold_nothing}")
    if refused:
        raise typer.Exit(EXIT_REFUSED)


def _table(folders: "dict[Path, dict[str, str]]") -> "Iterator[str]":
    """Rows of Markdown: how many scenes of each folder can be run, and why the first of the others cannot."""
    yield "| folder | scenes | run | the others |"
    yield "|---|---|---|---|"
    for folder, scenes in folders.items():
        why = []
        for name, problem in scenes.items():
            if problem:
                what = re.sub(rf"^\S*{re.escape(name)}: ", "", PLACE.sub("", problem))
                why.append(f"{name}: {what.partition(';')[0]}")
        yield f"| {folder} | {len(scenes)} | {len(scenes) - len(why)} | {'; '.join(why)} |"


def _line(text: str) -> None:
    """Print one line, even if a scene put line breaks into it."""
    say(" ".join(text.rstrip().splitlines()))


@sofa.command()
def convert(
    scene: Annotated[Path, typer.Argument(help="SOFA scene (.py, .pyscn, .scn).")],
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Native scene (.toml) to write, its meshes beside it.")
    ],
    python_path: PythonPath = "",
    data_path: DataPath = "",
    sofa_exact: Exact = False,
) -> None:
    """Write a native scene with its meshes, without the scene's own controllers."""
    import tomli_w

    from taichisoft.base import atomic_file, named_os_errors
    from taichisoft.errors import SceneError
    from taichisoft_sofa.scene_reader import translated, with_files_in

    if output.suffix.lower() != ".toml":
        raise SceneError(f"--output {output}: '{output.suffix}' is not a kind of native scene; valid: .toml")
    _, translation = translated(scene, python_path, sofa_exact, data_path)
    if translation.refused:
        raise SceneError(f"{translation.refused[0]}; taichisoft sofa check {scene} lists all")
    for line in translation.departures:
        _line(f"otherwise than in SOFA: {line}")
    meshes = output.parent / f"{output.stem}-meshes"
    with named_os_errors(meshes):
        meshes.mkdir(parents=True, exist_ok=True)
    translation.files.write(meshes)
    tables: dict[str, Any] = with_files_in(Path(meshes.name), translation.tables)
    with atomic_file(output) as partial:
        partial.write_text(tomli_w.dumps(tables), encoding="utf-8")
    say(f"{output}, with its meshes in {meshes}")
