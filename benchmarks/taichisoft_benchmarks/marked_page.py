"""Tables in Markdown, and pages whose marked sections programs fill; the text around a section is written by hand.

A section stands between `<!-- NAME -->` and `<!-- end -->`.
"""

import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

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
    """Print each line as soon as it is made, and put all of them into the section of the page.

    Raises:
        BenchmarkError: the page lacks the mark; then no line is made.
    """
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
