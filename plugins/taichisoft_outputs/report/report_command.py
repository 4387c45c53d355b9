"""The command `taichisoft recording report`."""

from pathlib import Path
from typing import Annotated

import typer

from taichisoft.terminal_text import say


def report(
    run: Annotated[Path, typer.Argument(metavar="RUN.h5", help="Recording of a run.")],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="The page  \\[default: report.html beside RUN]")
    ] = None,
) -> None:
    """Write one page with the pictures in a run's folder, its plots, metrics and scene."""
    from taichisoft_outputs.report.report_output import write_report  # --help need not wait for it

    say(write_report(run, output))
