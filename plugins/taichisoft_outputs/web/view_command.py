"""The command `taichisoft view`."""

import contextlib
from pathlib import Path
from typing import Annotated

import typer

from taichisoft.optional_packages import extra, require


def view(
    run: Annotated[Path, typer.Argument(metavar="RUN.h5", help="Recording of a run, also of one that goes on.")],
    address: Annotated[
        str | None,
        typer.Option(metavar="HOST:PORT", help="Where the page listens  \\[default: 127.0.0.1 and a free port]"),
    ] = None,
    section: Annotated[
        str, typer.Option(metavar="PLANE", help="Cut bodies open \\[mm]: y=0, z<12.5 (what is kept), x+2*y=30")
    ] = "",
) -> None:
    """Serve a web page on which a recording is played and scrubbed."""
    from taichisoft_outputs.web.address import NOT_ENCRYPTED, find_address

    require("a web page", "viser", install=extra("web"))
    from taichisoft_outputs.web.recording_page import RecordingPage

    found = find_address(address)
    with contextlib.redirect_stdout(None):  # viser prints where it listens, in its own way
        served = RecordingPage(run, found, section)
    typer.echo(f"web page: {found.at(served.page.port).url}; Ctrl and c ends it")
    if found.is_open:
        typer.echo(f"warning: {found.host}: other machines reach the page; {NOT_ENCRYPTED}", err=True)
    with contextlib.redirect_stdout(None):
        with contextlib.suppress(KeyboardInterrupt):
            served.serve()
        served.close()
