"""The command `taichisoft recording plot`."""

from pathlib import Path
from typing import Annotated

import typer

from taichisoft.base import say


def plot(
    run: Annotated[Path, typer.Argument(metavar="RUN.h5", help="Recording of a run.")],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder of the picture  \\[default: RUN's]")
    ] = None,
    format: Annotated[str, typer.Option(help="Format of the picture: png or svg.")] = "png",
    only: Annotated[
        str | None,
        typer.Option(metavar="NAMES", help="Panels, such as bending,slip; one that is unknown is answered with all."),
    ] = None,
    x: Annotated[
        str | None, typer.Option("--x", metavar="NAME", help="Horizontal axis instead of time, such as pressure.")
    ] = None,
    y: Annotated[
        str | None, typer.Option("--y", metavar="NAMES", help="What is plotted over it, such as bending; as --only.")
    ] = None,
) -> None:
    """Plot pressures, tensions, motion, forces and step times of a recording."""
    from taichisoft.base import atomic_file  # --help need not wait for any of these
    from taichisoft_outputs.plots import PANELS, PlotError, draw_plots
    from taichisoft_outputs.recording.reader import read_recording

    if (x is None) != (y is None):
        raise PlotError("--x and --y go together: --x pressure --y bending")
    if y is not None and only is not None:
        raise PlotError("--only has no effect beside --y, which names what is plotted")
    only = only if y is None else y
    names = [name.strip() for name in only.split(",") if name.strip()] if only is not None else None
    if names == []:
        raise PlotError(f"--only names no panel; there are: {', '.join(PANELS)}")
    with read_recording(run) as recording:
        plots = draw_plots(recording, format, names, None if x == "time" else x)
    for name in plots.left_out:
        say(f"no plot of {name}: nothing of the kind in this run")
    stem = "plots" if x is None else f"{'-'.join(names or ())}-over-{x}".replace(" ", "-")
    path = (output or run.parent) / f"{stem}.{format}"
    with atomic_file(path, PlotError) as partial:
        path.parent.mkdir(parents=True, exist_ok=True)
        partial.write_bytes(plots.pictures[0])
    say(path)
