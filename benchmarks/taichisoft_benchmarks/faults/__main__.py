"""The table of docs/reliability.md: `python -m taichisoft_benchmarks.faults`, or some of its rows with fewer tries."""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import typer

from taichisoft_benchmarks.faults.edges import EDGES
from taichisoft_benchmarks.faults.page import foreign_requests, run_with_page, senseless_messages
from taichisoft_benchmarks.faults.recordings import LIMIT, STEPS, damaged, kills, tiny_run
from taichisoft_benchmarks.faults.soak import soak
from taichisoft_benchmarks.faults.tries import KINDS, run_tries

GROWTH = 20.0
"""Most that the memory of a long run may grow by [MB]."""


def measure(
    kill: Annotated[int, typer.Option(help="Kills of processes that record.")] = 200,
    damage: Annotated[int, typer.Option(help="Damaged recordings.")] = 60,
    scenes: Annotated[int, typer.Option(help="Scenes with mistakes.")] = 1000,
    command_lines: Annotated[int, typer.Option(help="Command lines with mistakes.")] = 1000,
    mesh_files: Annotated[int, typer.Option(help="Damaged files of meshes and surfaces.")] = 300,
    step_files: Annotated[int, typer.Option(help="Damaged STEP files.")] = 36,
    origins: Annotated[int, typer.Option(help="Requests to a page from elsewhere.")] = 40,
    messages: Annotated[int, typer.Option(help="Messages to a page that make no sense.")] = 300,
    seconds: Annotated[float, typer.Option(help="Duration of the long run [s].")] = 3600.0,
    edges: Annotated[float, typer.Option(help="Share of the tries of all other rows.")] = 1.0,
    first: Annotated[int, typer.Option(help="Number of the first try with mistakes.")] = 0,
) -> None:
    """Try all faults and print a row for each; the exit code is 1 when something failed."""
    bad = 0

    def row(what: str, tries: str, failures: list[str]) -> None:
        nonlocal bad
        bad += len(failures)
        for failure in failures:
            typer.echo(f"{what}: {failure}", err=True)
        typer.echo(f"| {what} | {tries} | {len(failures)} |")

    if kill or damage:
        run = tiny_run(STEPS)
        with TemporaryDirectory() as folder:
            lost = kills(run, Path(folder), kill)
            row("kills at random moments, begin and close among them", f"{kill}", ["a recording is lost"] * lost)
            failed, told, longest = damaged(run, Path(folder), damage)
            problems = ["not told of in one line"] * failed + [f"told of after {longest:.1f} s"] * (longest > LIMIT)
            row(f"damaged recordings, of which {told} are told of within {longest:.1f} s", f"{damage}", problems)
    for kind, count in zip(KINDS, (scenes, command_lines, mesh_files, step_files), strict=True):
        if count:
            found = run_tries(kind, count, first)
            row(f"{kind} with mistakes", f"{count}", [f"{one.number}: {one.what}: {one.problem}" for one in found])
    if origins or messages:
        with run_with_page() as page:
            let_in = foreign_requests(page.url, origins)
            row("requests to a page with foreign hosts and origins", f"{origins}", ["let in"] * let_in)
            row("messages to a page that make no sense", f"{messages}", senseless_messages(page, messages))
    if seconds:
        growth = soak(seconds)
        problems = [f"exit code {growth.exit_code}"] * (growth.exit_code != 0)
        problems += ["its memory grew too much"] * (growth.memory > GROWTH)
        files = f"memory grew by {growth.memory:.1f} MB, files {growth.files:.0f} MB at most"
        row(f"run in real time with a page and a recording; {files}", f"{seconds:g} s", problems)
    for what, (tries, attempt) in EDGES.items():
        if number := round(edges * tries):
            row(what, f"{number}", attempt(number))
    if bad:
        raise typer.Exit(1)


if __name__ == "__main__":
    typer.run(measure)
