"""What the programs here share: their command line, tables in Markdown, marked sections of pages, plots as SVG.

A section stands between `<!-- NAME -->` and `<!-- end -->`; the text around it is written by hand.
"""

import re
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

from taichisoft.base import printable
from taichisoft.command_line import EXIT_BAD_INPUT, EXIT_INTERRUPTED, USAGE_ERROR
from taichisoft.errors import TaichisoftError
from taichisoft_benchmarks.errors import BenchmarkError

PageOption = Annotated[
    Path | None,
    typer.Option("--output", "-o", metavar="PAGE.md", help="Page to fill; without it the section is only printed."),
]


def row(cells: Iterable[Any]) -> str:
    """A line of a table."""
    return f"| {' | '.join(map(str, cells))} |"


def heading(titles: Sequence[str]) -> str:
    """The first two lines of a table."""
    return f"{row(titles)}\n|{len(titles) * '---|'}"


def fill_section(page: Path | None, name: str, lines: Iterable[str]) -> None:
    """Print each line as soon as it is made, and put all of them into the section of the page."""
    marked = re.compile(rf"(<!-- {name} -->\n).*?(<!-- end -->)", re.DOTALL)
    if page is not None and not marked.search(page.read_text(encoding="utf-8")):
        raise BenchmarkError(f"{page}: has no line <!-- {name} -->")
    made = []
    for line in lines:
        print(line, flush=True)
        made.append(line)
    if page is not None:
        text, section = page.read_text(encoding="utf-8"), "\n".join(made)  # the page may have changed in the meantime
        page.write_text(marked.sub(lambda match: f"{match[1]}{section}\n{match[2]}", text), encoding="utf-8")


def run_program(function: Callable[..., None], module: str) -> None:
    """Call a function with the options of this process, which ends.

    Args:
        function: has parameters as typer expects them.
        module: what follows `python -m`, such as "taichisoft_benchmarks.convergence".
    """
    application = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)
    application.command()(function)
    try:
        code: Any = application(prog_name=f"python -m {module}", standalone_mode=False)
        sys.exit(code if isinstance(code, int) else 0)
    except USAGE_ERROR as error:
        _exit_with(f"{error.format_message().rstrip('.')}; see python -m {module} --help")
    except TaichisoftError as error:
        _exit_with(str(error))
    except OSError as error:
        _exit_with(f"{error.filename}: {error.strerror}" if error.filename is not None else str(error))
    except (KeyboardInterrupt, typer.Abort):
        sys.exit(EXIT_INTERRUPTED)


def _exit_with(problem: str) -> None:
    print(f"taichisoft: {printable(' '.join(problem.split()))}", file=sys.stderr)
    sys.exit(EXIT_BAD_INPUT)


@contextmanager
def svg_axes(path: Path, size: tuple[float, float]) -> Iterator[Any]:
    """Axes of an SVG file that is written at the end; `size` in inches."""
    import matplotlib
    from matplotlib.figure import Figure

    # Text as text and fixed identities: small files that change only with the figures.
    style: Any = {"svg.fonttype": "none", "svg.hashsalt": "taichisoft", "font.size": 9.0}
    with matplotlib.rc_context(style):
        figure = Figure(figsize=size, layout="constrained")
        axes = figure.subplots()
        axes.grid(which="major", alpha=0.3)
        yield axes
        figure.savefig(path, format="svg", metadata={"Date": None, "Creator": None})
