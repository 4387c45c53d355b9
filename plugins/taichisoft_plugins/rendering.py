"""Pictures of a recording, drawn in a child process that can neither slow, hang nor crash the caller."""

import json
from pathlib import Path

from taichisoft.errors import TaichisoftError
from taichisoft_plugins.camera import VIEWS
from taichisoft_plugins.child_process import run_python
from taichisoft_plugins.recording_reader import read_recording
from taichisoft_plugins.system_libraries import install_line, packages_for

SIZE = (1280, 720)
START_LIMIT = 60.0
"""For the start of Open3D on a busy machine [s]; usually 3."""
PICTURE_LIMIT = 10.0
"""For one picture on a busy machine [s]; usually 1."""
ATTEMPTS = 2


class RenderError(TaichisoftError):
    """Pictures cannot be drawn."""


def render_pictures(
    recording: Path,
    times: dict[str, float],
    folder: Path,
    size: tuple[int, int] = SIZE,
    view: str = "iso",
) -> list[Path]:
    """Draw the frames nearest to the times and return the paths `folder/NAME.png`.

    Args:
        recording: path of the recording.
        times: [s] by name of the picture.
        folder: made when it does not exist.
        size: width and height [pixels].
        view: a key of `camera.VIEWS`.

    Raises:
        RecordingError: the recording is missing or unreadable, or ends before one of the times.
        RenderError: drawing failed twice; the message says what to install.
    """
    if view not in VIEWS:
        raise RenderError(f"no view is called '{view}'; there are: {', '.join(VIEWS)}")
    with read_recording(recording) as opened:
        for time in times.values():
            opened.frame_at(time)
    folder.mkdir(parents=True, exist_ok=True)
    job = {
        "recording": str(recording),
        "times": times,
        "folder": str(folder),
        "size": size,
        "view": view,
    }
    arguments = ["-m", "taichisoft_plugins.render_process", json.dumps(job)]
    time_limit = START_LIMIT + PICTURE_LIMIT * len(times)
    for _ in range(ATTEMPTS):
        problem = run_python(arguments, time_limit).problem
        if not problem:
            return [folder / f"{name}.png" for name in times]
    raise RenderError(
        f"no pictures of {recording}: {problem}; off-screen drawing needs Mesa's libraries "
        f"({install_line(packages_for(problem, 'open3d'))}); `taichisoft doctor` checks them"
    )
