"""The outputs that come with taichisoft, the options that ask for them, and the commands that go with them."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import lazy_loader

from taichisoft.running import Imported, hookimpl

if TYPE_CHECKING:
    import typer

    from taichisoft.running import RunOption, Session
    from taichisoft_outputs.drawing.style import Style
    from taichisoft_outputs.recording.layout import RecordingError
    from taichisoft_outputs.recording.reader import Recording, read_recording
    from taichisoft_outputs.rendering.video import render_pictures, render_video

__all__ = ["Recording", "RecordingError", "Style", "read_recording", "render_pictures", "render_video"]
__getattr__, *_ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "drawing.style": ["Style"],
        "recording.layout": ["RecordingError"],
        "recording.reader": ["Recording", "read_recording"],
        "rendering.video": ["render_pictures", "render_video"],
    },
)


@hookimpl
def taichisoft_outputs() -> Mapping[str, Callable[..., Any]]:
    """Outputs by name."""
    places = {
        "recording": "recording.recording_output:RecordingOutput",
        "metrics": "metrics:MetricsOutput",
        "pictures": "rendering.drawn_outputs:PicturesOutput",
        "video": "rendering.drawn_outputs:VideoOutput",
        "report": "report:ReportOutput",
        "csv": "csv_output:CsvOutput",
        "web": "web.web_output:WebOutput",
    }
    return Imported(__name__, places)


@hookimpl
def taichisoft_renderers() -> Mapping[str, Callable[..., Any]]:
    """What draws for `Simulation.render`."""
    return Imported(__name__, {"open3d": "rendering.live_renderer:LiveRenderer"})


@hookimpl
def taichisoft_run_options() -> "Mapping[str, RunOption]":
    """Options of `taichisoft run` that bring these outputs."""
    from taichisoft.running import RunOption

    return {
        "--every": RunOption("recording", "Record every N-th step and the last one.", "every", int, "N"),
        "--record-limit": RunOption(
            "recording", "Room for the recording [GB], of which the newest half or more is kept.", "limit", float, "GB"
        ),
        "--image": RunOption("pictures", "Draw pictures of the key moments at the end."),
        "--video": RunOption("video", "Draw a video at the end: .mp4, .gif, or a folder.", "file", Path, "FILE"),
        "--fps": RunOption("video", "Frames per second of the video.", "fps", float),
        "--slow-motion": RunOption("video", "How many times slower things move in it.", "slow_motion", float),
        "--size": RunOption("video", "Width and height of the video in pixels.", "size", str, "1280x720"),
        "--view": RunOption("video", "Camera of the video: iso, front, top, orbit, follow:BODY.", "view"),
        "--web": RunOption("web", "Serve a live page to watch and steer the run in a browser.", controller="keyboard"),
        "--web-address": RunOption("web", "Where the page listens.", "address", str, "HOST:PORT", "keyboard"),
    }


@hookimpl
def taichisoft_run_begins(session: "Session") -> None:
    """Serve the web page; keep the recording of a run without an end within bounds; say where nothing can be held."""
    from taichisoft_outputs.metrics import warn_of_late_motion
    from taichisoft_outputs.recording.recording_output import limit_endless_recordings
    from taichisoft_outputs.web.web_output import begin_pages

    warn_of_late_motion(session)
    limit_endless_recordings(session)
    begin_pages(session)


@hookimpl
def taichisoft_commands(application: "typer.Typer") -> None:
    """Add `taichisoft recording`, three of its commands at the top as well, `materials` and `doctor`."""
    import typer

    from taichisoft_outputs.doctor_command import doctor
    from taichisoft_outputs.materials_command import materials
    from taichisoft_outputs.recording_commands import export, plot, render, repair, report, resume, view

    recording = typer.Typer(help="Work with recordings: render, plot, report, export, repair.", no_args_is_help=True)
    for anywhere in (render, view, resume):
        application.command()(anywhere)
        recording.command()(anywhere)
    for below in (plot, report, export, repair):
        recording.command()(below)
    application.command()(doctor)
    application.add_typer(recording, name="recording")
    application.add_typer(materials, name="materials")


@hookimpl
def taichisoft_picture_wanted(session: "Session") -> None:
    """Draw the present state beside the run."""
    from taichisoft_outputs.rendering.drawn_outputs import take_picture

    take_picture(session)


@hookimpl
def taichisoft_run_ends(session: "Session") -> None:
    """Wait for the pictures that were asked for."""
    from taichisoft_outputs.rendering.drawn_outputs import finish_pictures

    finish_pictures(session)
