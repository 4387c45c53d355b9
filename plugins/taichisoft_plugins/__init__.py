"""The outputs that come with taichisoft, the options that ask for them, and the commands that go with them."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from taichisoft.plugin_system.hookspecs import hookimpl

if TYPE_CHECKING:
    import typer

    from taichisoft.plugin_system.hookspecs import RunOption
    from taichisoft.session.session import Session


@hookimpl
def taichisoft_outputs() -> Mapping[str, Callable[..., Any]]:
    """Outputs by name."""
    from taichisoft_plugins.csv_output import CsvOutput
    from taichisoft_plugins.metrics import MetricsOutput
    from taichisoft_plugins.recording.output import RecordingOutput
    from taichisoft_plugins.rendering.outputs import PicturesOutput, VideoOutput
    from taichisoft_plugins.report.output import ReportOutput
    from taichisoft_plugins.web.output import WebOutput

    return {
        "recording": RecordingOutput,
        "metrics": MetricsOutput,
        "pictures": PicturesOutput,
        "video": VideoOutput,
        "report": ReportOutput,
        "csv": CsvOutput,
        "web": WebOutput,
    }


@hookimpl
def taichisoft_renderers() -> Mapping[str, Callable[..., Any]]:
    """What draws for `Simulation.render`."""
    from taichisoft_plugins.rendering.live_renderer import LiveRenderer

    return {"open3d": LiveRenderer}


@hookimpl
def taichisoft_run_options() -> "Mapping[str, RunOption]":
    """Options of `taichisoft run` that bring these outputs."""
    from taichisoft.plugin_system.hookspecs import RunOption

    return {
        "--every": RunOption("recording", "Record every N-th step and the last one.", "every", int, "N"),
        "--compress": RunOption("recording", "Pack the recording: a quarter smaller, but slower.", "compress", bool),
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
    from taichisoft_plugins.hold_time import warn_of_late_motion
    from taichisoft_plugins.recording.output import limit_endless_recordings
    from taichisoft_plugins.web.output import begin_pages

    warn_of_late_motion(session)
    limit_endless_recordings(session)
    begin_pages(session)


@hookimpl
def taichisoft_commands(application: "typer.Typer") -> None:
    """`taichisoft resume`, `repair`, `render`, `view`, `plot`, `report`, `export`, `doctor` and `materials`."""
    from taichisoft_plugins.doctor.command import doctor
    from taichisoft_plugins.materials.command import materials
    from taichisoft_plugins.paraview.command import export
    from taichisoft_plugins.plots.command import plot
    from taichisoft_plugins.recording.repair_command import repair
    from taichisoft_plugins.recording.resume_command import resume
    from taichisoft_plugins.rendering.command import render
    from taichisoft_plugins.report.command import report
    from taichisoft_plugins.web.view_command import view

    for command in (resume, repair, render, view, plot, report, export, doctor):
        application.command()(command)
    application.add_typer(materials, name="materials")


@hookimpl
def taichisoft_picture_wanted(session: "Session") -> None:
    """Draw the present state beside the run."""
    from taichisoft_plugins.rendering.picture_key import take_picture

    take_picture(session)


@hookimpl
def taichisoft_run_ends(session: "Session") -> None:
    """Wait for the pictures that were asked for."""
    from taichisoft_plugins.rendering.picture_key import finish_pictures

    finish_pictures(session)
