"""The display of the commands: a bar of stages while they work, and warnings."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.text import Text

STAGES = ("meshing", "measuring", "writing")


@contextmanager
def stages_bar(console: Console, title: str) -> Iterator[Callable[[str], None]]:
    """Show a bar that vanishes in the end; the yielded function moves it on to one of STAGES."""
    columns = TextColumn("{task.description}", markup=False), BarColumn(), TextColumn("{task.fields[stage]}")
    with Progress(
        *columns, TimeElapsedColumn(), console=console, transient=True, disable=not console.is_terminal
    ) as progress:
        task = progress.add_task(title, total=len(STAGES), stage="")

        def begin(stage: str) -> None:
            progress.update(task, completed=STAGES.index(stage), stage=stage)

        yield begin


def print_remark(console: Console, remark: str) -> None:
    """Print one line that warns, without markup."""
    console.print(Text.assemble(("warning: ", "yellow"), remark), soft_wrap=True)
