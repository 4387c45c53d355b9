"""Time per step on this machine, beside other programs: `python -m taichisoft_benchmarks`, or `make bench`."""

from collections.abc import Iterator
from pathlib import Path
from tempfile import gettempdir
from typing import Annotated

import typer
from rich.console import Console

from taichisoft.base import plain, printable, say
from taichisoft_benchmarks import machine
from taichisoft_benchmarks.case_scenes import Meshes
from taichisoft_benchmarks.cases import SHIPPED, NamedCase, choose, read_cases
from taichisoft_benchmarks.errors import BenchmarkError
from taichisoft_benchmarks.pages import run_program
from taichisoft_benchmarks.results import CaseResult, Results, compare, read_results, require_writable, write_results
from taichisoft_benchmarks.runner import run_cases

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
    quick: Annotated[bool, typer.Option("--quick", help="One run of few steps, to see that everything works.")] = False,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="DIR", help="Folder for results.json."),
    ] = None,
    compare_: Annotated[
        Path | None,
        typer.Option(
            "--compare", metavar="OLD", help="Earlier --output to compare with; marks changes beyond the noise."
        ),
    ] = None,
    fail_on_regression: Annotated[
        bool, typer.Option("--fail-on-regression", help="Exit with 1 if --compare finds a worse figure.")
    ] = False,
    list_: Annotated[bool, typer.Option("--list", help="Show the cases and stop.")] = False,
) -> None:
    """Time the engine on this machine, beside other programs where they are installed."""
    chosen = choose(read_cases(cases), case or [])
    if list_:
        for named in chosen:
            say(f"{named.name:28} {named.case.kind:14} {named.case.title}")
        return
    if fail_on_regression and compare_ is None:
        raise BenchmarkError("--fail-on-regression: needs --compare OLD")
    if tutorial_meshes is not None and not tutorial_meshes.is_dir():
        raise BenchmarkError(f"--tutorial-meshes {tutorial_meshes}: no such folder")
    # Before the work, not after it: a whole run takes half an hour.
    old = read_results(compare_) if compare_ is not None else None
    if output is not None:
        require_writable(output)
    made = Path(gettempdir()) / "taichisoft-bench-meshes"  # kept from one run to the next
    made.mkdir(exist_ok=True)
    meshes = Meshes(tutorial_meshes.resolve() if tutorial_meshes is not None else None, made)
    results = _measure(chosen, meshes, 1 if quick else repeat, quick)
    for name, value in results.derived.items():
        say(f"{name} {value:.4g}")
    say(f"# load at the end {results.load['end']:.2f}")
    if output is not None:
        say(f"# {write_results(results, output)}")
    if results.interrupted:
        raise KeyboardInterrupt
    worse = _compare(results, old) if old is not None else 0
    failed = [name for name, result in results.cases.items() if result.problem]
    if failed:
        typer.echo(
            printable(f"taichisoft: {len(failed)} of {len(results.cases)} cases failed: {', '.join(failed)}"), err=True
        )
    if failed or (fail_on_regression and worse):
        raise typer.Exit(EXIT_FAILED)


def _measure(chosen: list[NamedCase], meshes: Meshes, repeat: int, quick: bool) -> Results:
    """Run the cases, and print the figures of each after its last repetition."""
    console = Console(stderr=True)
    for line in _header_lines(meshes):
        say(line)
    with console.status("") as status:

        def show(progress: str) -> None:
            status.start()
            status.update(plain(progress))

        def show_result(name: str, result: CaseResult) -> None:
            status.stop()  # the figures may go to the same screen
            for line in _case_lines(name, result):
                say(line)

        return run_cases(chosen, meshes, repeat, quick, show, show_result)


def _compare(new: Results, old: Results) -> int:
    """Print the comparison; returns how many figures are worse."""
    changes = compare(new, old)
    for change in changes:
        say(change)
    worse = [change.name for change in changes if change.verdict == "worse"]
    say(f"# {len(worse)} of {len(changes)} figures worse: {', '.join(worse) or 'none'}")
    return len(worse)


def _header_lines(meshes: Meshes) -> Iterator[str]:
    """The machine, the versions, the meshes; lines of comment begin with #."""
    about = machine.describe_machine()
    yield (
        f"# {about['system']}, {about['processor']}, {about['cores']} cores, {about['memory_gb']} GB; "
        f"load {machine.load():.2f}; Python {about['python']}"
    )
    yield "# " + ", ".join(f"{package} {version}" for package, version in machine.versions().items())
    yield "# meshes: " + ("shipped" if meshes.tutorial is None else "SOFA's tutorial")


def _case_lines(name: str, case: CaseResult) -> Iterator[str]:
    """Facts and figures of a case: `name.metric value`, one a line."""
    if case.skipped:
        yield f"# {name}: skipped: {case.skipped}"
        return
    if case.problem:
        yield f"# {name}: failed: {case.problem}"
        return
    yield f"# {name}: {case.title}"
    if case.does_not:
        yield f"# {name}: does not: {case.does_not}"
    for fact, value in case.facts.items():
        yield f"{name}.{fact} {value}"
    for metric, figure in case.figures.items():
        yield (
            f"{name}.{metric} {figure.median:.4g}"
            f"  # least {figure.minimum:.4g}, spread {figure.spread:.2g}, {len(figure.values)} runs"
        )
    for phase, milliseconds in case.phases.items():
        yield f"{name}.phases.{phase.replace(' ', '_')}_ms {milliseconds:.4g}"


if __name__ == "__main__":
    run_program(bench, "taichisoft_benchmarks")
