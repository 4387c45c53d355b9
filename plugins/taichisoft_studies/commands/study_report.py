"""`taichisoft study report`: one page about a study."""

from pathlib import Path
from typing import Annotated, Any

import typer

from taichisoft.optional_packages import extra, require
from taichisoft.terminal_text import printable, say
from taichisoft_studies.errors import StudyError

PAGE = "report.html"


def report(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Folder of the study.")],
    metric: Annotated[
        list[str] | None,
        typer.Option("--metric", help="A metric that the page is about; the first decides which runs are best."),
    ] = None,
    smallest: Annotated[bool, typer.Option("--smallest", help="The smallest value of it is best.")] = False,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="The page  \\[default: FOLDER/report.html]")
    ] = None,
) -> None:
    """Write one page: effect of each parameter, scatter, best runs with pictures, failures."""
    require("taichisoft study report", "pandas", "pyarrow", install=extra("studies"))
    from taichisoft.atomic_file import atomic_file
    from taichisoft_studies.analysis import best_runs, figure_columns
    from taichisoft_studies.results_table import read_table
    from taichisoft_studies.study_page import BEST, study_page

    table = read_table(folder)
    figures = figure_columns(table, metric)
    if figures:
        for place in best_runs(table, figures[0], not smallest, BEST)["folder"]:
            _draw(folder / place)
    page = study_page(table, folder, metric, smallest)
    path = output or folder / PAGE
    with atomic_file(path, StudyError) as partial:
        path.parent.mkdir(parents=True, exist_ok=True)
        partial.write_text(page, encoding="utf-8")
    say(path)


def _draw(run: Path) -> Any:
    """Draw the last moment of a run that was recorded, unless it is drawn; where that cannot be done, say why."""
    from taichisoft.errors import TaichisoftError
    from taichisoft_outputs.recording.layout import FILE_NAME
    from taichisoft_outputs.recording.reader import read_recording
    from taichisoft_outputs.rendering.render import render_pictures
    from taichisoft_studies.study_page import PICTURES

    recording = run / FILE_NAME
    if not recording.is_file() or any((run / picture).is_file() for picture in PICTURES):
        return
    try:
        with read_recording(recording) as opened:
            last = float(opened.times[-1])
        render_pictures(recording, {"after": last}, run)
    except TaichisoftError as error:
        typer.echo(printable(f"no picture of {run}: {error}"), err=True)
