"""How far a study is, on the terminal."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console


@contextmanager
def progress_bar(console: "Console", title: str, total: int, finished: int = 0) -> Iterator[Callable[[str], None]]:
    """Show a bar of `total` runs; the yielded function counts one, and prints a line about it unless it is empty."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    from taichisoft.running.messages import print_line
    from taichisoft.terminal_text import printable

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
