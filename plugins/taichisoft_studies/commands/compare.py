"""`taichisoft study compare`: several runs in one picture, and the keys and metrics in which they differ."""

import csv
from pathlib import Path
from typing import Annotated, Any

import typer

from taichisoft_studies.errors import StudyError

TABLE, PICTURE = "comparison.csv", "comparison.png"


def compare(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN...", help="Folders of runs, or their recordings.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder of the picture and the table.")] = Path(
        "out/comparison"
    ),
    only: Annotated[str | None, typer.Option(metavar="NAMES", help="Panels, separated by commas.")] = None,
) -> None:
    """Plot several runs over each other, and list the keys and metrics in which they differ."""
    from rich.console import Console
    from rich.table import Table

    from taichisoft.atomic_file import atomic_file
    from taichisoft.running import print_line
    from taichisoft.terminal_text import plain
    from taichisoft_outputs.recording.layout import FILE_NAME
    from taichisoft_studies.run_comparison import differences, draw_comparison, labels, run_folder

    if len(runs) < 2:
        raise StudyError("study compare: needs two runs or more")
    folders = [run_folder(run) for run in runs]
    names = labels(folders)
    rows = differences(folders)
    with atomic_file(output / TABLE, StudyError) as partial:
        output.mkdir(parents=True, exist_ok=True)
        with partial.open("w", encoding="utf-8", newline="") as file:
            csv.writer(file).writerows([["key", *names], *([key, *values] for key, values in rows.items())])
    table = Table("")
    for name in names:
        table.add_column(plain(name))
    for key, values in rows.items():
        table.add_row(plain(key), *(plain(_short(value)) for value in values))
    console = Console()
    console.print(table)
    print_line(console, str(output / TABLE))
    unrecorded = [folder for folder in folders if not (folder / FILE_NAME).exists()]
    if unrecorded:
        print_line(console, f"no plots: {unrecorded[0]} has no recording (--record)")
        return
    wanted = [name.strip() for name in only.split(",")] if only is not None else None
    picture = draw_comparison(folders, names, wanted, "png")
    path = output / PICTURE
    with atomic_file(path, StudyError) as partial:
        partial.write_bytes(picture)
    print_line(console, str(path))


def _short(value: Any) -> str:
    if value is None:
        return "-"
    return f"{value:.6g}" if isinstance(value, float) else str(value)
