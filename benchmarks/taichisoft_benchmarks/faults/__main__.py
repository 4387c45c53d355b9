"""A table of faults, tries and failures: `python -m taichisoft_benchmarks.faults`, or some of its rows."""

from typing import Annotated

import typer

from taichisoft_benchmarks.faults.fault_table import ROWS
from taichisoft_benchmarks.marked_page import heading, row
from taichisoft_benchmarks.program import run_program


def main(
    share: Annotated[float, typer.Option(help="Share of the tries of each row.")] = 1.0,
    only: Annotated[str, typer.Option(metavar="NAME", help="Rows whose name has NAME in it.")] = "",
) -> None:
    """Try all faults and print a row for each; the exit code is 1 after a failure."""
    failed = False
    print(heading(["fault", "tries", "failures"]))
    for name, (tries, attempt) in ROWS.items():
        count = round(share * tries)
        if only in name and count:
            failures = attempt(count)
            for failure in failures:
                typer.echo(f"{name}: {failure}", err=True)
            print(row([name, count, len(failures)]), flush=True)
            failed = failed or bool(failures)
    if failed:
        raise typer.Exit(1)


if __name__ == "__main__":
    run_program(main, "taichisoft_benchmarks.faults")
