"""Progress bar and closing tables of `taichisoft run`."""

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from taichisoft.control.controller import Controller
from taichisoft.plugin_system.failure import plugin_failure
from taichisoft.running.messages import print_line, print_warning
from taichisoft.running.profile import REST, TOTAL, Profile
from taichisoft.runtime.launch import compilations_shown
from taichisoft.session.output import Output
from taichisoft.session.pace import KEEPING_UP
from taichisoft.session.session import Session
from taichisoft.step.report import StepReport
from taichisoft.terminal_text import plain, printable


@contextmanager
def progress_bar(console: Console, session: Session, title: str) -> Iterator[Callable[[StepReport], None]]:
    """Show a progress bar; yields the function to call after every step.

    While a step waits for a kernel, which takes seconds the first time on a machine, the bar names it.
    """
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TextColumn("{task.fields[state]}"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console) as progress:
        total = session.step_count if math.isfinite(session.step_count) else None
        task = progress.add_task(printable(title), total=total, state="")

        def show(report: StepReport) -> None:
            progress.update(task, advance=1, state=f"{report.time:.2f} s  {report.contact_count} contacts")

        # Nothing else is drawn while Taichi compiles.
        with compilations_shown(lambda name: progress.update(task, state=f"preparing {name}", refresh=True)):
            yield show


def warn_if_slow(console: Console, session: Session) -> None:
    """Warn if a run was slower than its set speed."""
    pace = session.pace
    if pace.speed is not None and pace.mean_real_time_factor < KEEPING_UP * pace.speed:
        print_warning(
            console,
            f"could not keep up: {pace.mean_real_time_factor:.2f} s were simulated in a second, {pace.speed:g} s were "
            "asked for; a coarser mesh is faster",
        )


def print_profile(console: Console, profile: Profile) -> None:
    """Print the table of the phases of a step, in their order."""
    medians = profile.medians()
    whole = medians[TOTAL][0]
    table = Table("phase of a step", title=f"median times of {len(profile.seconds[TOTAL])} steps")
    for heading in ("[ms]", "share", "of it in Python [ms]"):
        table.add_column(plain(heading), justify="right")
    for phase, (time, in_python) in medians.items():
        table.add_row(phase, f"{time:.3f}", f"{time / whole:.0%}", f"{in_python:.3f}", end_section=phase == REST)
    console.print(table)


def print_summary(console: Console, parts: Sequence[Controller | Output], folder: Path) -> bool:
    """Print the closing table; returns False if a part failed, which must not hide the outcome of the run."""
    table = Table(show_header=False)
    complete = True
    for part in parts:
        try:
            for quantity, value in part.summary().items():
                table.add_row(plain(quantity), plain(value))
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            complete = False
            print_warning(console, str(plugin_failure(f"{type(part).__name__} failed in summary()", error)))
    if table.row_count:
        console.print(table)
    print_line(console, f"results in {folder}")
    return complete
