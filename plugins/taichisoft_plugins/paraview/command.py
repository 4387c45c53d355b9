"""The command `taichisoft export`."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import track

from taichisoft_plugins.paraview.export import FORMATS, ExportError, chosen_frames
from taichisoft_plugins.recording.reader import read_recording


def export(
    run: Annotated[Path, typer.Argument(metavar="RUN.h5", help="Recording of a run.")],
    format: Annotated[str, typer.Option(help=f"What to write: {', '.join(FORMATS)} (ParaView).")] = "vtu",
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder  \\[default: named like the format, beside RUN]")
    ] = None,
    every: Annotated[int | None, typer.Option(help="Each so many recorded frames  \\[default: 1]")] = None,
    time: Annotated[list[float] | None, typer.Option(help="Moment \\[s]; may be repeated.")] = None,
) -> None:
    """Write the frames of a recording for ParaView."""
    if format not in FORMATS:
        raise ExportError(f"--format {format}: there are: {', '.join(FORMATS)}")
    with read_recording(run) as recording:
        frames = chosen_frames(recording, every, time)
        if recording.last_start and not time:
            typer.echo(f"the run was started anew; exported is what came after the last start ({len(frames)} frames)")
        shown = track(frames, description=f"exporting {len(frames)} frames", console=Console(stderr=True))
        for path in FORMATS[format](recording, shown, output or run.parent / format):
            typer.echo(path)
