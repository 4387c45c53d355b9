"""Options and progress of the commands of studies."""

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from taichisoft_studies.errors import StudyError

if TYPE_CHECKING:
    from rich.console import Console

    from taichisoft_studies.study_file import Cluster
    from taichisoft_studies.workers import DaskWorkers


@contextmanager
def progress_bar(console: "Console", title: str, total: int, finished: int = 0) -> Iterator[Callable[[str], None]]:
    """Show a bar of `total` runs; the yielded function counts one, and prints a line about it unless it is empty."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    from taichisoft.base import printable
    from taichisoft.running import print_line

    columns = TextColumn("{task.description}", markup=False), BarColumn(), TextColumn("{task.completed}/{task.total}")
    with Progress(
        *columns, TimeElapsedColumn(), TimeRemainingColumn(), console=console, disable=not console.is_terminal
    ) as progress:
        task = progress.add_task(printable(title), total=total, completed=finished)

        def count(line: str) -> None:
            progress.advance(task)
            if line:
                print_line(console, line)

        yield count


Jobs = Annotated[
    int | None,
    typer.Option("--jobs", "-j", metavar="N", help="Runs at a time on this machine; as many as CPUs otherwise."),
]
Scheduler = Annotated[
    str | None, typer.Option("--scheduler", metavar="tls://HOST:8786", help="A Dask scheduler whose workers are used.")
]
Dashboard = Annotated[
    str | None,
    typer.Option(
        "--dashboard", metavar="HOST:PORT", help="Where Dask's dashboard listens  \\[default: 127.0.0.1, any port]."
    ),
]
Output = Annotated[Path, typer.Option("--output", "-o", help="Folder of the study.")]


def requested_plugins(arguments: Sequence[str] | None = None) -> list[str]:
    """Absolute paths of the plug-ins that the command line names, for the processes that make the runs."""
    from taichisoft.running import FILE_OPTION, FOLDER_OPTION

    found: list[Path] = []
    waiting = iter(sys.argv[1:] if arguments is None else arguments)
    for argument in waiting:
        option, separator, value = argument.partition("=")
        if option not in (FILE_OPTION, FOLDER_OPTION):
            continue
        path = Path(value if separator else next(waiting, "")).expanduser().resolve()
        inside = sorted(one for one in path.glob("[!_.]*") if one.suffix == ".py" or (one / "__init__.py").is_file())
        found += [path] if option == FILE_OPTION else inside
    return list(dict.fromkeys(map(str, found)))


def add_cluster(tables: dict[str, Any], jobs: int | None, scheduler: str | None, dashboard: str | None) -> None:
    """Put what the command line says of workers into a study's tables.

    Raises:
        StudyError: the number of workers is not positive.
    """
    if jobs is not None and jobs < 1:
        raise StudyError(f"--jobs {jobs}: must be at least 1")
    said = {"workers": jobs, "scheduler": scheduler, "dashboard": dashboard}
    given = {key: value for key, value in said.items() if value is not None}
    if given:
        tables["cluster"] = {**tables.get("cluster", {}), **given}


def add_plugins(tables: dict[str, Any]) -> None:
    """Put the plug-ins that the command line names into a study's tables."""
    plugins = requested_plugins()
    if plugins:
        tables["plugins"] = list(dict.fromkeys([*tables.get("plugins", []), *plugins]))


def load_plugins(study: Any) -> None:
    """Load the plug-ins of a study here as well: its keys are checked against what they provide."""
    from taichisoft.running import load_plugin

    for plugin in study.plugins:
        load_plugin(plugin)


@contextmanager
def announced_workers(console: "Console", cluster: "Cluster", tasks: int, folder: Path) -> "Iterator[DaskWorkers]":
    """The workers of a study, see `workers.dask_workers`, with a line about them and warnings about access."""
    from taichisoft.running import print_line, print_warning
    from taichisoft_studies.workers import cautions, dask_workers

    for caution in cautions(cluster):
        print_warning(console, caution)
    with dask_workers(cluster, tasks, folder) as workers:
        print_line(console, workers.about)
        yield workers
