"""`taichisoft mesh sweep`: one mesh for each value of a dimension."""

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from taichisoft.base import atomic_file, extra, plain, require
from taichisoft.errors import GoalMissed, MeshError
from taichisoft_meshing import mesh_command
from taichisoft_meshing.mesh_command import overridden
from taichisoft_meshing.mesh_job import MeshJob
from taichisoft_studies.study_file import Values, combinations, toml_value
from taichisoft_studies.study_options import (
    Dashboard,
    Jobs,
    Scheduler,
    add_cluster,
    announced_workers,
    requested_plugins,
)

if TYPE_CHECKING:
    from rich.console import Console

    from taichisoft_studies.study_file import Cluster

# The variants of a sweep of meshes, and the table of their figures.

SUMMARY = "summary.csv"
NOT_PRINTED = ("tetrahedra", "folder", "problem")


@dataclass(frozen=True)
class Variant:
    """One mesh of a sweep.

    Attributes:
        values: the values that replace the file's values, as text, by key.
        job: the request for the mesh.
    """

    values: dict[str, str]
    job: MeshJob

    @property
    def name(self) -> str:
        """The name of its folder, for example "wall-1.5_body.width-20": without what a path or a shell would read."""
        return "_".join(
            f"{key}-{''.join(one if one.isalnum() or one in '.+-' else '_' for one in value).strip('_')}"
            for key, value in self.values.items()
        )


def plan(job: MeshJob, varied: Mapping[str, Values]) -> list[Variant]:
    """All combinations of the values of keys, the last key's values changing fastest.

    Raises:
        MeshError: a key leads nowhere, or two variants would have one name.
        StudyError: there are too many.
    """
    variants = []
    for chosen in combinations(varied, None, 0):
        texts = {key: value if isinstance(value, str) else toml_value(value) for key, value in chosen.items()}
        tables = overridden(job.tables, [f"{key}={toml_value(value)}" for key, value in chosen.items()])
        variants.append(Variant(texts, replace(job, tables=tables)))
    names = [variant.name for variant in variants]
    clash = next((name for index, name in enumerate(names) if name in names[:index]), None)
    if clash is not None:
        raise MeshError(f"--vary: two variants would both be called '{clash}'")
    return variants


def summary_rows(variants: Sequence[Variant], outcomes: Sequence[Mapping[str, Any]]) -> list[dict[str, str]]:
    """A row for each variant: the values that were varied, the figures, the folder, and the problem if it failed."""
    columns = dict.fromkeys(column for outcome in outcomes for column in outcome["figures"])
    rows = []
    for variant, outcome in zip(variants, outcomes, strict=True):
        found = [(column, outcome["figures"].get(column)) for column in columns]
        figures = {column: "" if value is None else f"{value:.10g}" for column, value in found}
        folder = "" if outcome["problem"] else variant.name
        rows.append({**variant.values, **figures, "folder": folder, "problem": outcome["problem"]})
    return rows


def write_summary(rows: Sequence[Mapping[str, str]], folder: Path) -> Path:
    """Write the rows to a CSV file.

    Raises:
        MeshError: it cannot be written.
    """
    path = folder / SUMMARY
    with atomic_file(path, MeshError) as partial, partial.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    return path


def summary_table(rows: Sequence[Mapping[str, str]], title: str) -> Table:
    """The rows as a table for the terminal; problems are printed in lines of their own."""
    columns = [column for column in rows[0] if column not in NOT_PRINTED]
    table = Table(title=plain(title))
    for column in columns:
        words = column.replace("_mm3", " [mm³]").replace("_", " ")
        table.add_column(plain(words), justify="right", min_width=max(len(plain(row[column])) for row in rows))
    table.add_column("", min_width=len("failed"))
    for row in rows:
        table.add_row(*(plain(row[column]) for column in columns), "failed" if row["problem"] else "")
    return table


def mesh_sweep(
    file: Annotated[str, mesh_command.FILE],
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
    size: mesh_command.Size = None,
    nodes: mesh_command.Nodes = None,
    preset: mesh_command.Preset = None,
    set_: mesh_command.Set = None,
    force: mesh_command.Force = False,
) -> None:
    """Mesh every variant of a geometry; one that fails is reported, the others go on, and the exit code is 1.

    A variant whose mesh lies there already, of the same inputs, is not meshed again. One command at a time works in a
    folder.
    """
    require("taichisoft mesh sweep", "distributed", install=extra("studies"))
    from rich.console import Console  # --help need not wait for any of these

    from taichisoft.running import locked_folder, print_line, print_warning
    from taichisoft_meshing.mesh_set import prepare_folder
    from taichisoft_studies.study_file import Sweep, check_study, varied

    tables: dict[str, Any] = {"scene": file, "vary": varied(vary)}
    add_cluster(tables, jobs, scheduler, dashboard)
    study = check_study(Sweep, tables, "mesh sweep")
    job = mesh_command.geometry_job(file, set_, mesh_command.asked_size(size, nodes, preset))
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
    from taichisoft_studies.study_options import progress_bar
    from taichisoft_studies.worker_task import MeshRun, do_mesh, mesh_failure
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
