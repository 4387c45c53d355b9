"""What the documents show: blocks of code with their language, and the commands that somebody would type."""

import re
import shlex
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGES = [*sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").rglob("*.md")), ROOT / "examples" / "README.md"]

BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
SHELL = ("sh", "console", "text", "")
"""Languages of blocks that may have commands; in those that show what a terminal does, they follow a dollar."""
PROGRAMS = ("taichisoft", "python", "pip", "make", "pytest", "ruff", "dask", "sbatch", "pre-commit")


@dataclass(frozen=True)
class Command:
    """A command line of a page.

    Attributes:
        page: name of the page, from the root of the project.
        line: what is typed, without comments.
    """

    page: str
    line: str

    @property
    def words(self) -> list[str]:
        """The program and its arguments."""
        return shlex.split(self.line)

    def __str__(self) -> str:
        return f"{self.page}: {self.line}"


def name_of(page: Path) -> str:
    """The name of a page from the root of the project."""
    return page.relative_to(ROOT).as_posix()


def blocks(page: Path) -> list[tuple[str, str]]:
    """Language and text of each block of code."""
    return BLOCK.findall(page.read_text(encoding="utf-8"))


def commands(page: Path) -> list[Command]:
    """The command lines in the blocks of a page, in order; several that are joined by && are one each."""
    found = []
    for language, text in blocks(page):
        if language not in SHELL:
            continue
        for line in text.replace("\\\n", " ").splitlines():
            typed = shlex.join(shlex.split(line.removeprefix("$ "), comments=True)) if is_command(line) else ""
            found += [Command(name_of(page), part) for part in typed.split(" '&&' ") if part]
    return found


def is_command(line: str) -> bool:
    """Whether a line of a block is one that somebody would type."""
    return line.removeprefix("$ ").split(" ")[0] in PROGRAMS


def mentioned(page: Path) -> list[Command]:
    """Commands within the text of a page, such as `taichisoft plugins`."""
    text = BLOCK.sub("", page.read_text(encoding="utf-8"))
    spans = [" ".join(span.split()) for span in re.findall(r"`([^`]+)`", text)]
    return [Command(name_of(page), span) for span in spans if re.match(r"taichisoft [a-z]|python -m ", span)]
