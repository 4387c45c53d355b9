"""The command `taichisoft repair`."""

from pathlib import Path
from typing import Annotated

import typer

from taichisoft.terminal_text import say


def repair(
    run: Annotated[Path, typer.Argument(metavar="RUN.h5", help="Damaged recording; it is only read.")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="NEW.h5", help="The new recording.")],
) -> None:
    """Rescue the frames of a damaged recording that are whole."""
    from taichisoft_plugins.recording.repair import repair as rescue

    rescued = rescue(run, output)
    say(f"{output}: {len(rescued.whole)} of {rescued.frame_count} frames")
    if rescued.damage:
        say(f"the first that is not whole: {rescued.damage}")
