"""`taichisoft reduce`: reduced models of the soft bodies of a scene, with their errors."""

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from taichisoft_reduction.errors import ReductionError

if TYPE_CHECKING:
    from rich.console import Console

    from taichisoft_reduction.shape_reduction import Reduction


def reduce(
    scene: Annotated[str, typer.Argument(help="Scene file, or the name of a shipped scene.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for a file per body, and the validation.")],
    modes: Annotated[int | None, typer.Option(help="Modes of each body, not as many as needed.")] = None,
    tolerance: Annotated[
        str, typer.Option(metavar="PERCENT", help="Largest error of a position, of the largest displacement.")
    ] = "0.5%",
    runs: Annotated[
        list[Path] | None,
        typer.Option("--runs", metavar="RECORDING", help="Recording of a run to learn from as well (repeatable)."),
    ] = None,
    own_training: Annotated[
        bool, typer.Option("--training/--no-training", help="Whether to make runs to learn from; else --runs alone.")
    ] = True,
    range_: Annotated[
        list[str] | None,
        typer.Option("--range", metavar="BODY.ACTUATOR=LOW:HIGH", help="How far an actuator is driven (repeatable)."),
    ] = None,
    full_range: Annotated[
        bool, typer.Option("--full-range", help="Drive actuators to the scene's limits, not 25 % beyond its own run.")
    ] = False,
    processes: Annotated[
        int | None, typer.Option("--processes", "-j", metavar="N", help="Runs at a time; as many as CPUs otherwise.")
    ] = None,
    set_: Annotated[list[str] | None, typer.Option("--set", help="Override a value of the scene (repeatable).")] = None,
) -> None:
    """Make soft bodies fast: few modes and elements that move as all do, checked on runs that they were not made from.

    What is finished stays in the folder: the same command goes on where it was interrupted.
    """
    from taichisoft_reduction.validation import PICTURE, TABLE, WITHIN, tolerance_share

    share = tolerance_share("--tolerance", tolerance)
    if modes is not None and modes < 1:
        raise ReductionError(f"--modes {modes}: must be at least 1")
    if processes is not None and processes < 1:
        raise ReductionError(f"--processes {processes}: must be at least 1")
    if not own_training and not runs:
        raise ReductionError("--no-training: needs --runs RECORDING, from which to learn")
    ranges = dict(_range(text) for text in range_ or [])
    from rich.console import Console  # --help need not wait for any of these

    from taichisoft.running import load_scene, locked_folder, print_line
    from taichisoft.runtime import available_cores
    from taichisoft_reduction.shape_reduction import Wishes, reduce_scene
    from taichisoft_studies.study_commands import requested_plugins

    console = Console()
    wishes = Wishes(
        tolerance=share,
        modes=modes,
        recordings=runs or (),
        own_training=own_training,
        ranges=ranges,
        full_range=full_range,
        processes=processes or available_cores(),
        plugins=requested_plugins(),
    )
    loaded = load_scene(scene, set_ or [])
    with locked_folder(output), ExitStack() as bars:
        reduction = reduce_scene(loaded, output, wishes, _progress(console, bars))
    _show(console, reduction)
    error = f"{100.0 * reduction.error:.2g} %"
    print_line(
        console,
        f"{', '.join(map(str, reduction.files.values()))}: {reduction.verdict} of {100.0 * share:g} % ({error})",
    )
    print_line(console, f"table in {output / TABLE}, curves in {output / PICTURE}")
    if reduction.verdict != WITHIN:
        print_line(console, "more --runs like the worst ones, more --modes or another --tolerance may help")


def _range(text: str) -> tuple[str, tuple[float, float]]:
    name, equals, values = text.partition("=")
    low, colon, high = values.partition(":")
    try:
        range_ = float(low), float(high)
    except ValueError:
        range_ = 0.0, 0.0
    if not (equals and colon and -1e12 < range_[0] <= 0.0 < range_[1] < 1e12):
        raise ReductionError(f"--range {text}: must be BODY.ACTUATOR=LOW:HIGH LOW <= 0 < HIGH, as in a.tube=0:40")
    return name, range_


def _progress(console: "Console", bars: ExitStack) -> Any:
    """Bars of runs with the time left, and lines between them."""
    from taichisoft.running import print_line, progress_bar
    from taichisoft_reduction.training_run import Progress

    class Shown(Progress):
        """On the console; one bar at a time."""

        def runs(self, title: str, cost: float) -> Callable[[float], None]:
            bars.close()
            count = bars.enter_context(progress_bar(console, title, cost, "%"))
            return lambda ended: count(advance=ended)

        def line(self, text: str) -> None:
            bars.close()
            print_line(console, text)

    return Shown()


def _show(console: "Console", reduction: "Reduction") -> None:
    from rich.table import Table

    from taichisoft.base import plain
    from taichisoft_reduction.validation import HEADER, table_rows

    table = Table(title="errors in runs that were not trained on: largest / mean (largest in percent of the change)")
    for name in HEADER:
        table.add_column(plain(name))
    for row in table_rows(reduction.comparisons):
        table.add_row(*map(plain, row))
    console.print(table)
    for comparison in reduction.comparisons:
        if comparison.problem:
            console.print(plain(f"{comparison.name}: {comparison.problem}"))
