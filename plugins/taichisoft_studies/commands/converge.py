"""`taichisoft converge`: the figures of a run with their errors by step and mesh."""

import csv
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from rich.table import Table

    from taichisoft_studies.refinement import Refinement

TABLE = "convergence.csv"
SMALLEST = 1e-5
"""Figures, in their units, that the table on the terminal leaves out: what solvers leave over."""


def converge(
    scene: Annotated[str, typer.Argument(help="Scene file, or the name of a shipped one.")],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder of the runs  \\[default: out/SCENE-convergence]")
    ] = None,
    set: Annotated[list[str] | None, typer.Option(metavar="KEY=VALUE", help="Override a value (repeatable).")] = None,
    controller: Annotated[str | None, typer.Option(help="Controller instead of the scene's.")] = None,
    duration: Annotated[float | None, typer.Option(help="Simulated time \\[s]  \\[default: the scene's]")] = None,
    finer: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=VALUE",
            help="What makes the mesh finer (repeatable)  \\[default: the next preset, or 0.7 of the size]",
        ),
    ] = None,
) -> None:
    """Estimate errors of a run by its step and its mesh, from finer runs."""
    import math

    from rich.console import Console

    from taichisoft import load_scene
    from taichisoft.atomic_file import atomic_file
    from taichisoft.running import print_line, print_warning, warnings_printed_to
    from taichisoft_studies.commands.study_options import progress_bar, requested_plugins
    from taichisoft_studies.errors import StudyError
    from taichisoft_studies.refinement import converge as refine

    if duration is not None and not (math.isfinite(duration) and duration > 0.0):
        raise StudyError(f"--duration {duration:g}: must be a number of seconds above 0")
    loaded = load_scene(scene, set or (), controller)
    folder = output or Path("out") / f"{Path(scene).stem}-convergence"
    console = Console()
    with warnings_printed_to(console), progress_bar(console, "runs", 3) as made:
        found = refine(loaded, folder, finer, duration, requested_plugins(), made)
    if found.remark:
        print_warning(console, f"no error by the mesh is known of all: {found.remark}; --finer says what is finer")
    console.print(_table(found))
    with atomic_file(folder / TABLE, StudyError) as partial, partial.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["figure", "value", "half_step", "step_error", "finer_mesh", "mesh_error"])
        for one in found.figures:
            writer.writerow([one.name, one.value, one.half_step, one.step_error, one.finer_mesh, one.mesh_error])
    print_line(console, str(folder / TABLE))


def _table(found: "Refinement") -> "Table":
    """A row for each figure; the values of the finer runs are in the file."""
    from rich.table import Table

    from taichisoft.terminal_text import plain

    mesh = "" if found.nodes is None else f"; {found.nodes[0]} nodes, {found.nodes[1]} on the finer mesh"
    table = Table(title=plain(f"steps of {1e3 * found.step:g} ms, order {found.order}{mesh}"))
    for title in ("figure", "value", "error by step", *(() if found.nodes is None else ("error by mesh",))):
        table.add_column(plain(title), justify="left" if title == "figure" else "right", overflow="fold")
    for one in found.figures:
        if max(abs(one.value), one.error) < SMALLEST:
            continue
        errors = [f"{error:+.2g}" for error in (one.step_error, one.mesh_error) if error is not None]
        table.add_row(plain(one.name.removeprefix("final_")), f"{one.value:.5g}", *errors)
    return table
