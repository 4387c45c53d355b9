"""The commands `taichisoft characterise`, `converge`, `mesh sweep` and `new measured-case`."""

import csv
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from taichisoft.base import say
from taichisoft.errors import GoalMissed
from taichisoft_meshing import mesh_commands
from taichisoft_studies.study_commands import Jobs, Scheduler, announced_workers, make_study, requested_plugins

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from taichisoft_studies.mesh_variants import Variant
    from taichisoft_studies.refinement import Refinement
    from taichisoft_studies.study_file import Cluster

# `taichisoft converge`: the figures of a run with their errors by step and mesh.

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
    from taichisoft.base import atomic_file
    from taichisoft.running import print_line, print_warning, progress_bar, warnings_printed_to
    from taichisoft_studies.errors import StudyError
    from taichisoft_studies.refinement import refine as refine
    from taichisoft_studies.study_commands import requested_plugins

    if duration is not None and not (math.isfinite(duration) and duration > 0.0):
        raise StudyError(f"--duration {duration:g}: must be a number of seconds above 0")
    loaded = load_scene(scene, set or (), controller)
    folder = output or Path("out") / f"{Path(scene).stem}-convergence"
    console = Console()
    with warnings_printed_to(console), progress_bar(console, "runs", 3) as made:
        refinement = refine(loaded, folder, finer, duration, requested_plugins(), made)
    if refinement.remark:
        print_warning(console, f"no error by the mesh is known of all: {refinement.remark}; --finer says what is finer")
    console.print(_table(refinement))
    with atomic_file(folder / TABLE, StudyError) as partial, partial.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["figure", "value", "half_step", "step_error", "finer_mesh", "mesh_error"])
        for row in refinement.figures:
            writer.writerow([row.name, row.value, row.half_step, row.step_error, row.finer_mesh, row.mesh_error])
    print_line(console, str(folder / TABLE))


def _table(refinement: "Refinement") -> "Table":
    """A row for each figure; the values of the finer runs are in the file."""
    from rich.table import Table

    from taichisoft.base import plain

    mesh = "" if refinement.nodes is None else f"; {refinement.nodes[0]} nodes, {refinement.nodes[1]} on the finer mesh"
    table = Table(title=plain(f"steps of {1e3 * refinement.step:g} ms, order {refinement.order}{mesh}"))
    for title in ("figure", "value", "error by step", *(() if refinement.nodes is None else ("error by mesh",))):
        table.add_column(plain(title), justify="left" if title == "figure" else "right", overflow="fold")
    for figure in refinement.figures:
        if max(abs(figure.value), figure.error) < SMALLEST:
            continue
        errors = [f"{error:+.2g}" for error in (figure.step_error, figure.mesh_error) if error is not None]
        table.add_row(plain(figure.name.removeprefix("final_")), f"{figure.value:.5g}", *errors)
    return table


# `taichisoft mesh sweep`: one mesh for each value of a dimension.


def mesh_sweep(
    file: Annotated[str, mesh_commands.FILE],
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
    jobs: Jobs = None,
    scheduler: Scheduler = None,
    time_limit: Annotated[float, typer.Option(help="Longest time for one mesh \\[s].")] = 3600.0,
    size: mesh_commands.Size = None,
    nodes: mesh_commands.Nodes = None,
    preset: mesh_commands.Preset = None,
    set_: mesh_commands.Set = None,
    force: mesh_commands.Force = False,
) -> None:
    """Mesh every variant of a geometry; one that fails is reported, the others go on, and the exit code is 1.

    A variant whose mesh lies there already, of the same inputs, is not meshed again. One command at a time works in a
    folder.
    """
    from rich.console import Console  # --help need not wait for any of these

    from taichisoft.running import locked_folder, print_line, print_warning
    from taichisoft_meshing.mesh_set import prepare_folder
    from taichisoft_studies.mesh_variants import plan, summary_rows, summary_table, write_summary
    from taichisoft_studies.study_file import Sweep, varied

    study = make_study(Sweep, {"scene": file, "vary": varied(vary)}, "mesh sweep", jobs, scheduler)
    job = mesh_commands.geometry_job(file, set_, mesh_commands.requested_size(size, nodes, preset))
    variants = plan(job, study.vary)
    prepare_folder(output)
    console = Console()
    with locked_folder(output):  # two would move different meshes into folders of the same name
        outcomes = make_variants(console, variants, output, study.cluster, force, time_limit)
        rows = summary_rows(variants, outcomes)
        written = write_summary(rows, output)
    console.print(summary_table(rows, str(output)))
    for variant, outcome in zip(variants, outcomes, strict=True):
        for remark in (*outcome["remarks"], *([f"failed: {outcome['problem']}"] if outcome["problem"] else [])):
            print_warning(console, f"{variant.name}: {remark}")
    print_line(console, f"summary in {written}")
    failed = sum(bool(outcome["problem"]) for outcome in outcomes)
    if failed:
        raise GoalMissed(f"{output}: {failed} of {len(variants)} variants failed")


def make_variants(
    console: "Console", variants: "Sequence[Variant]", output: Path, cluster: "Cluster", force: bool, time_limit: float
) -> "list[Mapping[str, Any]]":
    """Have every variant meshed into its folder; the outcomes of `MeshRun.make` come in the order of `variants`."""
    from taichisoft.running import progress_bar
    from taichisoft_studies.mesh_variants import MeshRun

    plugins = tuple(requested_plugins())
    runs = {}
    for variant in variants:
        job = replace(variant.job, file=variant.job.file.resolve())
        runs[variant.name] = MeshRun(variant.name, str(output.resolve()), job, force, plugins, time_limit)
    outcomes: dict[str, Mapping[str, Any]] = {}
    title = variants[0].job.file.name
    try:
        with (
            announced_workers(console, cluster, len(runs)) as workers,
            progress_bar(console, title, len(runs)) as count,
        ):
            for name, run in runs.items():
                workers.submit(name, run)
            for _ in runs:
                name, outcome = workers.next_done()
                outcomes[name] = outcome
                count(f"{name}: {_result(outcome)}")
    finally:
        for name in runs.keys() - outcomes.keys():
            runs[name].clean()
    return [outcomes[name] for name in runs]


def _result(outcome: "Mapping[str, Any]") -> str:
    figures = outcome["figures"]
    time = f"{figures['seconds']} s" if "seconds" in figures else "made before"
    return outcome["problem"] or f"{figures['nodes']} nodes, {time}"


# `taichisoft new measured-case`: a folder to fill with what was measured of a finger.

FOLDER = "measured-case"


def measured_case(
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder to write.")] = Path(FOLDER),
) -> None:
    """Write a folder for a measured finger: geometry, silicone, pressures, positions and their errors."""
    from taichisoft.base import named_os_errors
    from taichisoft.scene import data_folder
    from taichisoft_studies.errors import StudyError

    if output.exists():
        raise StudyError(f"--output {output}: exists already; choose another name")
    with named_os_errors(output, StudyError):
        shutil.copytree(data_folder() / FOLDER, output)
    say(f"{output}: begin with {output / 'README.md'}")


# `taichisoft characterise`: how far a finger bends, and how hard it presses.

EQUILIBRIA = "equilibria"
"""Folder of the equilibria, from which an interrupted command goes on."""


def characterise(
    scene: Annotated[str, typer.Argument(help="Scene file, or the name of a shipped one, with a finger.")],
    pressure: Annotated[float, typer.Option(help="Last pressure \\[kPa]; below 0 it is suction.")],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Folder of the results  \\[default: out/SCENE-characteristics]"),
    ] = None,
    body: Annotated[str | None, typer.Option(help="The finger  \\[default: the first soft body]")] = None,
    steps: Annotated[int, typer.Option(min=2, max=200, help="Steps of pressure.")] = 8,
    bends: Annotated[
        int, typer.Option(min=1, max=50, help="Bends at which a block holds the tip, at most one for each step.")
    ] = 3,
    set: Annotated[list[str] | None, typer.Option(metavar="KEY=VALUE", help="Override a value (repeatable).")] = None,
    second: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=VALUE",
            help="What differs on a second mesh, for the error (repeatable)  \\[default: a finer one, if known]",
        ),
    ] = None,
) -> None:
    """Find a finger's free bending, blocked force and stiffness over its pressure: table, plot and datasheet.

    Started again, it goes on from the equilibria in the folder.
    """
    import math  # --help need not wait for any of these

    import numpy as np
    from rich.console import Console

    from taichisoft import load_scene
    from taichisoft.base import named_os_errors
    from taichisoft.running import progress_bar, warnings_printed_to
    from taichisoft_studies.characteristics import equilibrium_count, trust_line, write_datasheet
    from taichisoft_studies.characteristics import find_characteristics as find_characteristics
    from taichisoft_studies.errors import StudyError
    from taichisoft_studies.refinement import finer_meshes

    if not (math.isfinite(pressure) and pressure != 0.0):
        raise StudyError(f"--pressure {pressure:g}: must be a number of kPa other than 0")
    pressures = np.linspace(0.0, pressure, steps + 1).tolist()
    loaded = load_scene(scene, set or ())
    if pressure < -loaded.atmosphere:
        raise StudyError(f"--pressure {pressure:g}: must be at least the vacuum's {-loaded.atmosphere:g} kPa")
    console, meshes = Console(), []
    folder = output or Path("out") / f"{Path(scene).stem}-characteristics"
    with named_os_errors(f"--output {folder}", StudyError):
        (folder / EQUILIBRIA).mkdir(parents=True, exist_ok=True)
    with warnings_printed_to(console):
        changes = second or finer_meshes(loaded, body or next(iter(loaded.soft_bodies), None))[0]
        for what, overrides in (("equilibria", ()), *((("on the second mesh", changes),) if changes else ())):
            of_mesh = load_scene(scene, (*(set or ()), *overrides))
            with progress_bar(console, what, equilibrium_count(len(pressures), bends)) as advance:
                meshes.append(find_characteristics(of_mesh, body, pressures, bends, advance, folder / EQUILIBRIA))
    other, change = (meshes[1], ", ".join(changes)) if changes else (None, "")
    say(trust_line(meshes[0], other, change))
    for path in write_datasheet(folder, loaded, meshes[0], other, change):
        say(path)
