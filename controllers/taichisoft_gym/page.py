"""The live page of an environment in a browser, which the output "web" serves."""

from math import inf
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from taichisoft.building.run_parts import make_output
from taichisoft.control.control import Control
from taichisoft.control.controller import Controller
from taichisoft.control.observation import Observation
from taichisoft.plugin_system.hooks import notify
from taichisoft.session.session import Session

if TYPE_CHECKING:
    from taichisoft.building.simulation import Simulation


class FromOutside(Controller):
    """Stands for whoever steps the environment."""

    def control(self, observation: Observation) -> Control:
        """Ask for nothing."""
        return Control()


class Page:
    """A page, whose address is printed."""

    def __init__(self, simulation: "Simulation"):
        """Serve it.

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
        """End the page."""
        self._output.end("closed")
        notify("taichisoft_run_ends", session=self._session, outcome="closed")
        self._folder.cleanup()
