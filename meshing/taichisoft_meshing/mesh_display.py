"""How the commands of the mesher show that they work, and what they found."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.text import Text

if TYPE_CHECKING:
    from taichisoft_meshing.sweep.plan import Variant
    from taichisoft_meshing.sweep.process import Outcome

STAGES = ("meshing", "measuring", "writing")


@contextmanager
def stages_bar(console: Console, title: str) -> Iterator[Callable[[str], None]]:
    """A bar that moves on with each of STAGES, whose names the function that is yielded takes; gone in the end."""
    columns = TextColumn("{task.description}", markup=False), BarColumn(), TextColumn("{task.fields[stage]}")
    with Progress(
        *columns, TimeElapsedColumn(), console=console, transient=True, disable=not console.is_terminal
    ) as progress:
        task = progress.add_task(title, total=len(STAGES), stage="")

        def begin(stage: str) -> None:
            progress.update(task, completed=STAGES.index(stage), stage=stage)

        yield begin


def print_remark(console: Console, remark: str) -> None:
    """One line, without markup."""
    console.print(Text.assemble(("warning: ", "yellow"), remark), soft_wrap=True)


@contextmanager
def variants_bar(console: Console, title: str, count: int) -> Iterator[Callable[["Variant", "Outcome"], None]]:
    """A bar of so many meshes, to be told of each one that has come to its end; off a terminal, a line for each."""
    columns = TextColumn("{task.description}", markup=False), BarColumn(), TextColumn("{task.completed}/{task.total}")
    with Progress(*columns, TimeElapsedColumn(), console=console, disable=not console.is_terminal) as progress:
        task = progress.add_task(title, total=count)

        def done(variant: "Variant", outcome: "Outcome") -> None:
            progress.advance(task)
            said = outcome.problem or f"{outcome.figures['nodes']} nodes, {outcome.figures['seconds']} s"
            console.print(Text(f"{variant.name}: {said}"), soft_wrap=True)

        yield done
