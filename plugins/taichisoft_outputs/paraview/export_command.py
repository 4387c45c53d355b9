"""The command `taichisoft recording export`."""

from pathlib import Path
from typing import Annotated

import typer

from taichisoft.terminal_text import say


def export(
    run: Annotated[Path, typer.Argument(metavar="RUN.h5", help="Recording of a run.")],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder of the files  \\[default: vtu, beside RUN]")
    ] = None,
    every: Annotated[int | None, typer.Option(metavar="N", help="Each N-th recorded frame  \\[default: 1]")] = None,
    time: Annotated[list[float] | None, typer.Option(help="The frame nearest to this time \\[s] (repeatable).")] = None,
) -> None:
    """Write the frames of a recording for ParaView."""
    from rich.console import Console  # --help need not wait for any of these
    from rich.progress import track

    from taichisoft_outputs.paraview.export import chosen_frames, export_vtu
    from taichisoft_outputs.recording.reader import read_recording

    with read_recording(run) as recording:
        frames = chosen_frames(recording, every, time)
        if recording.last_start and not time:
            typer.echo(f"the run was restarted; only frames after the last start are exported ({len(frames)} frames)")
        shown = track(frames, description=f"exporting {len(frames)} frames", console=Console(stderr=True))
        for path in export_vtu(recording, shown, output or run.parent / "vtu"):
            say(path)
