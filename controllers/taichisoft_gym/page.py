"""The live page of an environment in a browser, which the output "web" serves."""

from math import inf
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from taichisoft.building import make_output
from taichisoft.control import Control, Controller, Observation
from taichisoft.plugin_system import notify
from taichisoft.session import Session

if TYPE_CHECKING:
    from taichisoft.building import Simulation


class FromOutside(Controller):
    """Controller without requests, because the user steps the environment."""

    def control(self, observation: Observation) -> Control:
        """Return an empty request."""
        return Control()


class EnvironmentPage:
    """A page in the browser, whose address is printed."""

    def __init__(self, simulation: "Simulation"):
        """Serve the page.

        Raises:
            TaichisoftError: viser is not installed, or the page cannot be served.
        """
        self._folder = TemporaryDirectory(prefix="taichisoft-page-")
        self._output = make_output("web", self._folder.name)
        self._session = Session(simulation, FromOutside(), [self._output], duration=inf)
        notify("taichisoft_run_begins", session=self._session)

    def show(self, simulation: "Simulation") -> None:
        """Show the state of a simulation of the same bodies."""
        self._session.simulation = simulation
        self._output.restart(simulation.state)

    def close(self) -> None:
        """Close the page."""
        self._output.end("closed")
        notify("taichisoft_run_ends", session=self._session, outcome="closed")
        self._folder.cleanup()
