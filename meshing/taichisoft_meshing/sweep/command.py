"""`taichisoft mesh-sweep`: one mesh for each value of a dimension."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from taichisoft.errors import GoalMissed, MeshError
from taichisoft_meshing.commands import options

if TYPE_CHECKING:
    from rich.console import Console

    from taichisoft_meshing.sweep.plan import Variant
    from taichisoft_meshing.sweep.process import Outcome


def mesh_sweep(
    file: Annotated[str, options.FILE],
    vary: Annotated[
        list[str],
        typer.Option(
            "--vary",
            metavar="KEY=VALUE,VALUE,...",
            help="A key of the file and the values it is given (repeatable: all combinations are meshed).",
        ),
    ],
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Folder for a folder per mesh, and summary.csv about all of them.")
    ],
    jobs: Annotated[
        int | None,
        typer.Option("--jobs", "-j", metavar="N", help="Meshes at a time; as many as there are CPUs otherwise."),
    ] = None,
    size: options.Size = None,
    nodes: options.Nodes = None,
    preset: options.Preset = None,
    set_: options.Set = None,
    force: options.Force = False,
) -> None:
    """Mesh every variant of a geometry; one that fails is reported, the others go on, and the exit code is 1."""
    from rich.console import Console  # --help need not wait for any of these

    from taichisoft.running.messages import print_warning
    from taichisoft_meshing.mesh_set import prepare_folder
    from taichisoft_meshing.sweep.plan import plan
    from taichisoft_meshing.sweep.runner import available_cpus, run_sweep
    from taichisoft_meshing.sweep.summary import summary_rows, summary_table, write_summary

    if jobs is not None and jobs < 1:
        raise MeshError(f"--jobs {jobs}: must be at least 1")
    variants = plan(options.geometry_job(file, set_, options.asked_size(size, nodes, preset)), vary)
    prepare_folder(output)
    console = Console()
    with variants_bar(console, Path(file).name, len(variants)) as done:
        outcomes = run_sweep(variants, output, jobs or available_cpus(), force, done)
    rows = summary_rows(variants, outcomes)
    written = write_summary(rows, output)
    console.print(summary_table(rows, str(output)))
    for variant, outcome in zip(variants, outcomes, strict=True):
        for remark in (*outcome.remarks, *([f"failed: {outcome.problem}"] if outcome.problem else [])):
            print_warning(console, f"{variant.name}: {remark}")
    console.print(f"summary in {written}", markup=False, highlight=False, soft_wrap=True)
    failed = sum(bool(outcome.problem) for outcome in outcomes)
    if failed:
        raise GoalMissed(f"{output}: {failed} of {len(variants)} variants failed")


@contextmanager
def variants_bar(console: "Console", title: str, count: int) -> Iterator[Callable[["Variant", "Outcome"], None]]:
    """Show a bar of `count` meshes; the yielded function notes one that has come to its end, and prints a line."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
    from rich.text import Text

    columns = TextColumn("{task.description}", markup=False), BarColumn(), TextColumn("{task.completed}/{task.total}")
    with Progress(*columns, TimeElapsedColumn(), console=console, disable=not console.is_terminal) as progress:
        task = progress.add_task(title, total=count)

        def done(variant: "Variant", outcome: "Outcome") -> None:
            progress.advance(task)
            said = outcome.problem or f"{outcome.figures['nodes']} nodes, {outcome.figures['seconds']} s"
            console.print(Text(f"{variant.name}: {said}"), soft_wrap=True)

        yield done
