"""The command `taichisoft bench`."""

from pathlib import Path
from tempfile import gettempdir
from typing import Annotated

import typer
from rich.console import Console

from taichisoft_benchmarks import machine
from taichisoft_benchmarks.case_file import SHIPPED, NamedCase, choose, read_cases
from taichisoft_benchmarks.comparison import compare, comparison_lines
from taichisoft_benchmarks.errors import BenchmarkError
from taichisoft_benchmarks.plots import draw_plots, require_matplotlib
from taichisoft_benchmarks.report import case_lines, closing_lines, header_lines
from taichisoft_benchmarks.results import CaseResult, Results, read_results, require_writable, write_results
from taichisoft_benchmarks.runner import Progress, run_cases
from taichisoft_benchmarks.scenes import Meshes

EXIT_FAILED = 1


def bench(
    case: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Cases by name or pattern, such as 'finger_*' (repeatable)."),
    ] = None,
    cases: Annotated[Path, typer.Option(metavar="FILE.toml", help="Descriptors of cases.")] = SHIPPED,
    tutorial_meshes: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder with the meshes of SOFA's tutorial; shipped ones otherwise."),
    ] = None,
    repeat: Annotated[int, typer.Option(min=1, help="Runs of each case.")] = 3,
    quick: Annotated[bool, typer.Option("--quick", help="One run of few steps: does everything work?")] = False,
    json: Annotated[Path | None, typer.Option(metavar="FILE", help="Write the results there.")] = None,
    compare_: Annotated[
        Path | None,
        typer.Option("--compare", metavar="OLD.json", help="Results to compare with; changes beyond noise are marked."),
    ] = None,
    fail_on_regression: Annotated[
        bool, typer.Option("--fail-on-regression", help="Exit with 1 when --compare finds anything worse.")
    ] = False,
    plots: Annotated[Path | None, typer.Option(metavar="DIR", help="Draw the plots of growth there.")] = None,
    list_: Annotated[bool, typer.Option("--list", help="Show the cases and stop.")] = False,
) -> None:
    """Time the engine on this machine, beside other programs where they are installed."""
    chosen = choose(read_cases(cases), case or [])
    if list_:
        for named in chosen:
            typer.echo(f"{named.name:28} {named.case.kind:14} {named.case.title}")
        return
    if fail_on_regression and compare_ is None:
        raise BenchmarkError("--fail-on-regression: needs --compare OLD.json")
    # Before the work, not after it: a whole run takes half an hour.
    old = read_results(compare_) if compare_ is not None else None
    if json is not None:
        require_writable(json)
    if plots is not None:
        require_matplotlib()
    results = _measure(chosen, Meshes(_folder(tutorial_meshes), _made_meshes()), 1 if quick else repeat, quick)
    for line in closing_lines(results):
        typer.echo(line)
    if json is not None:
        write_results(results, json)
    if results.interrupted:
        raise KeyboardInterrupt
    if plots is not None:
        for path in draw_plots(results, plots):
            typer.echo(f"# {path}")
    worse = _compare(results, old) if old is not None else 0
    failed = [name for name, result in results.cases.items() if result.problem]
    if failed:
        typer.echo(f"taichisoft: {len(failed)} of {len(results.cases)} cases failed: {', '.join(failed)}", err=True)
    if failed or (fail_on_regression and worse):
        raise typer.Exit(EXIT_FAILED)


def _measure(chosen: list[NamedCase], meshes: Meshes, repeat: int, quick: bool) -> Results:
    console = Console(stderr=True)
    kind = "shipped" if meshes.tutorial is None else "the tutorial's"
    for line in header_lines(machine.describe_machine(), machine.versions(), machine.load(), kind):
        typer.echo(line)
    with console.status("") as status:

        def show(progress: Progress) -> None:
            status.start()
            status.update(
                f"case {progress.number} of {progress.count}: {progress.name}, "
                f"run {progress.repetition} of {progress.repeat}"
            )

        def tell(name: str, result: CaseResult) -> None:
            status.stop()  # the figures may go to the same screen
            for line in case_lines(name, result):
                typer.echo(line)

        return run_cases(chosen, meshes, repeat, quick, show, tell)


def _compare(new: Results, old: Results) -> int:
    """Print the comparison; how many figures are worse."""
    changes = compare(new, old)
    for line in comparison_lines(changes):
        typer.echo(line)
    worse = [change.name for change in changes if change.verdict == "worse"]
    typer.echo(f"# {len(worse)} of {len(changes)} figures worse: {', '.join(worse) or 'none'}")
    return len(worse)


def _folder(tutorial_meshes: Path | None) -> Path | None:
    if tutorial_meshes is None:
        return None
    if not tutorial_meshes.is_dir():
        raise BenchmarkError(f"--tutorial-meshes {tutorial_meshes}: no such folder")
    return tutorial_meshes.resolve()


def _made_meshes() -> Path:
    """Kept from one run to the next: the finest mesh takes ten seconds."""
    folder = Path(gettempdir()) / "taichisoft-bench-meshes"
    folder.mkdir(exist_ok=True)
    return folder
