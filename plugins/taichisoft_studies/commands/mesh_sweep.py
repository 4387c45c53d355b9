"""`taichisoft mesh sweep`: one mesh for each value of a dimension."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from taichisoft.errors import GoalMissed
from taichisoft.optional_packages import extra, require
from taichisoft_meshing.commands import mesh_options
from taichisoft_studies.commands.study_options import (
    Dashboard,
    Jobs,
    Scheduler,
    add_cluster,
    announced_workers,
    requested_plugins,
)

if TYPE_CHECKING:
    from rich.console import Console

    from taichisoft_studies.mesh_variants import Variant
    from taichisoft_studies.study_file import Cluster


def mesh_sweep(
    file: Annotated[str, mesh_options.FILE],
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
    dashboard: Dashboard = None,
    time_limit: Annotated[float, typer.Option(help="Longest time for one mesh \\[s].")] = 3600.0,
    size: mesh_options.Size = None,
    nodes: mesh_options.Nodes = None,
    preset: mesh_options.Preset = None,
    set_: mesh_options.Set = None,
    force: mesh_options.Force = False,
) -> None:
    """Mesh every variant of a geometry; one that fails is reported, the others go on, and the exit code is 1.

    A variant whose mesh lies there already, of the same inputs, is not meshed again. One command at a time works in a
    folder.
    """
    require("taichisoft mesh sweep", "distributed", install=extra("studies"))
    from rich.console import Console  # --help need not wait for any of these

    from taichisoft.running import locked_folder, print_line, print_warning
    from taichisoft_meshing.mesh_set import prepare_folder
    from taichisoft_studies.mesh_variants import plan, summary_rows, summary_table, write_summary
    from taichisoft_studies.study_file import Sweep, check_study
    from taichisoft_studies.varied_values import varied

    tables: dict[str, Any] = {"scene": file, "vary": varied(vary)}
    add_cluster(tables, jobs, scheduler, dashboard)
    study = check_study(Sweep, tables, "mesh sweep")
    job = mesh_options.geometry_job(file, set_, mesh_options.asked_size(size, nodes, preset))
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
    """Have every variant meshed into its folder, and show how far that is.

    Returns:
        The outcome of each, in the order of `variants`, see `make_mesh.make_variant`.

    Raises:
        StudyError: the workers are gone.
    """
    from taichisoft_studies.commands.study_options import progress_bar
    from taichisoft_studies.make_mesh import MeshRun, mesh_failure
    from taichisoft_studies.worker_task import do_mesh
    from taichisoft_studies.workers import LOST

    plugins = tuple(requested_plugins())
    runs = {}
    for variant in variants:
        geometry = {**vars(variant.job), "file": str(variant.job.file.resolve())}
        runs[variant.name] = MeshRun(variant.name, str(output.resolve()), geometry, force, plugins, time_limit)
    outcomes: dict[str, Mapping[str, Any]] = {}
    title = variants[0].job.file.name
    try:
        with (
            announced_workers(console, cluster, len(runs), output) as workers,
            progress_bar(console, title, len(runs)) as count,
        ):
            for name, run in runs.items():
                workers.submit(name, do_mesh, run.to_json())
            for _ in runs:
                name, outcome = workers.next_done()
                outcomes[name] = outcome or mesh_failure(runs[name], LOST)
                count(f"{name}: {_said(outcomes[name])}")
    finally:
        for run in runs.values():
            if run.name not in outcomes:
                mesh_failure(run, "interrupted")
    return [outcomes[name] for name in runs]


def _said(outcome: "Mapping[str, Any]") -> str:
    """A line about a variant that has come to its end."""
    figures = outcome["figures"]
    time = f"{figures['seconds']} s" if "seconds" in figures else "made before"
    return outcome["problem"] or f"{figures['nodes']} nodes, {time}"
