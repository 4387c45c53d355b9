"""The outputs that come with taichisoft: recording, metrics, pictures and csv, and the commands that go with them."""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from taichisoft.hookspecs import hookimpl

if TYPE_CHECKING:
    import typer

    from taichisoft.session import Session


@hookimpl
def taichisoft_outputs() -> Mapping[str, Callable[..., Any]]:
    """Outputs by name."""
    from taichisoft_plugins.csv_output import CsvOutput
    from taichisoft_plugins.metrics import MetricsOutput
    from taichisoft_plugins.pictures import PicturesOutput
    from taichisoft_plugins.recording import RecordingOutput

    return {"recording": RecordingOutput, "metrics": MetricsOutput, "pictures": PicturesOutput, "csv": CsvOutput}


@hookimpl
def taichisoft_commands(application: "typer.Typer") -> None:
    """`taichisoft render` and `taichisoft doctor`."""
    from taichisoft_plugins.doctor_command import doctor
    from taichisoft_plugins.render_command import render

    application.command()(render)
    application.command()(doctor)


@hookimpl
def taichisoft_picture_wanted(session: "Session") -> None:
    """Draw the present state beside the run."""
    from taichisoft_plugins.picture_key import take_picture

    take_picture(session)


@hookimpl
def taichisoft_run_ends(session: "Session") -> None:
    """Wait for the pictures that were asked for."""
    from taichisoft_plugins.picture_key import finish_pictures

    finish_pictures(session)
