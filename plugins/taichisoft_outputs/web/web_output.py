"""The output "web": a live page of a run, and what is done on it."""

from pathlib import Path
from typing import TYPE_CHECKING

from taichisoft.caller_warnings import warn_caller
from taichisoft.optional_packages import extra, require
from taichisoft.session import Output
from taichisoft_outputs.web.address import NOT_ENCRYPTED, find_address

if TYPE_CHECKING:
    from taichisoft.session import Session
    from taichisoft.state import State
    from taichisoft.step import StepReport
    from taichisoft_outputs.web.page_link import PageLink


class WebOutput(Output):
    """Serves a page as long as the run lasts, from a process of its own: viewers can neither slow nor change the run.

    What viewers do becomes keys of the run.

    Attributes:
        url: address of the page, once it is served.
    """

    gives_keys = True

    def __init__(self, folder: Path, address: str | None = None):
        """Find a place for the page.

        Args:
            folder: folder of the run; nothing is written there.
            address: "HOST:PORT"; 127.0.0.1 and a free port from 8080 on where it is not given.

        Raises:
            WebError: viser is not installed, or nothing can listen at the address.
        """
        require("a web page", "viser", install=extra("web"))
        self._address = find_address(address)
        self._link: PageLink | None = None
        self.url = ""

    def follow(self, session: "Session") -> None:
        """Serve the page, and print where.

        Raises:
            WebError: the page cannot be served.
        """
        from taichisoft_outputs.web.page_link import PageLink

        self._link = PageLink(session, self._address)
        self.url = self._address.at(self._link.port).url
        print(f"web page: {self.url}", flush=True)
        if self._address.is_open:
            warn_caller(f"{self._address.host}: other machines reach the page; {NOT_ENCRYPTED}")

    def record(self, state: "State", report: "StepReport") -> None:
        """Leave the step for the page, which looks at the newest one when it has time."""
        if self._link is not None:
            self._link.newest = state

    def restart(self, state: "State") -> None:
        """Show the first state again."""
        if self._link is not None:
            self._link.newest = state

    def end(self, outcome: str) -> None:
        """Show viewers the end, and close the page."""
        if self._link is not None:
            self._link.end(outcome)


def begin_pages(session: "Session") -> None:
    """Serve the pages of a run that has any."""
    for output in session.outputs:
        if isinstance(output, WebOutput):
            output.follow(session)
