"""The command `taichisoft render`."""

from pathlib import Path
from typing import Annotated

import typer

from taichisoft_plugins.camera import VIEWS
from taichisoft_plugins.pictures import key_moments
from taichisoft_plugins.recording_reader import read_recording
from taichisoft_plugins.rendering import render_pictures


def render(
    run: Annotated[Path, typer.Argument(metavar="RUN.h5", help="Recording of a run.")],
    output: Annotated[Path | None, typer.Option(help="Folder of the pictures  \\[default: RUN's]")] = None,
    time: Annotated[
        list[float] | None,
        typer.Option(help="Moment \\[s]; may be repeated  \\[default: before, grasped, lifted]"),
    ] = None,
    view: Annotated[str, typer.Option(help=f"Where the camera stands: {', '.join(VIEWS)}.")] = "iso",
    size: Annotated[str, typer.Option(help="Width and height in pixels.")] = "1280x720",
) -> None:
    """Draw pictures of a recording; no display is needed."""
    with read_recording(run) as recording:
        times = {f"at_{moment:.2f}s": moment for moment in time} if time else key_moments(recording)
    for path in render_pictures(run, times, output or run.parent, parse_size(size), view):
        typer.echo(path)


def parse_size(text: str) -> tuple[int, int]:
    """Width and height from "1280x720"."""
    width, _, height = text.lower().partition("x")
    if not (width.isdecimal() and height.isdecimal() and min(int(width), int(height)) >= 16):
        raise typer.BadParameter(f"'{text}' must look like 1280x720, at least 16x16")
    return int(width), int(height)
