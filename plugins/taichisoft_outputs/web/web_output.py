"""The output "web": a live page of a run, and what is done on it."""

import math
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from taichisoft.base import Worker, WorkerLost, extra, require, warn_caller
from taichisoft.control import KeyEvent, Observer
from taichisoft.errors import TaichisoftError
from taichisoft.mechanics import (
    ACTUATOR_KINDS,
    ActuatorKind,
    ActuatorNames,
    axes_of_bodies,
    body_surfaces,
    planes_of,
    segment_efforts,
)
from taichisoft.running import BINDINGS, Output
from taichisoft_outputs.web.address import NOT_ENCRYPTED, Address, WebError, find_address
from taichisoft_outputs.web.curves import ON_PAGE, plotted_row
from taichisoft_outputs.web.page_messages import (
    LinesShown,
    PageInstant,
    PageScene,
    PageSetup,
    RunEnded,
    ShownPoses,
    Snapshot,
    SpeedWanted,
    lines_shown,
)

if TYPE_CHECKING:
    from taichisoft.contact import Model
    from taichisoft.mechanics import State
    from taichisoft.running import Session
    from taichisoft.step import StepReport

# The run's end of its page: starts the process, sends it the newest state, and hands on what viewers want.

SNAPSHOTS_PER_SECOND = 30.0
SECONDS_BETWEEN_UNCHANGED = 0.2
"""Time between snapshots of a paused run [s], which are sent because its status may change."""
START_LIMIT = 60.0
"""Longest time until the process serves the page [s]; usually 2."""
END_LIMIT = 5.0
"""Longest time until the process ends [s]; usually 1."""


class PageLink:
    """A page beside a run. The run itself only sets `newest`; two threads do the rest.

    Attributes:
        newest: state that the page shall show.
        port: port at which the page listens.
    """

    def __init__(self, session: "Session", address: Address):
        """Start the process and wait until it serves."""
        self._session = session
        self.newest: State = session.simulation.state
        self._observer = Observer(session.simulation.model)
        self._ended = threading.Event()
        self._worker = Worker("taichisoft_outputs.web.page_process:serve")
        try:
            first = page_setup(session, address, snapshot(session, self.newest))
            self.port: int = self._worker.ask(first, START_LIMIT)
        except (WorkerLost, TaichisoftError) as error:
            self._worker.end()
            raise WebError(f"no page at {address.url}: {error}") from error
        self._sender = threading.Thread(target=self._send_all, name="page", daemon=True)
        self._sender.start()
        threading.Thread(target=self._take_wishes, name="viewers", daemon=True).start()

    def end(self, outcome: str) -> None:
        """Let the page say how the run ended, and close it."""
        self._ended.set()
        self._sender.join(END_LIMIT)
        reads = not self._sender.is_alive()
        if reads:
            self._worker.send(RunEnded(outcome))
        self._worker.end(END_LIMIT if reads else 0.0)

    def _send_all(self) -> None:
        """Send until the run ends; what goes wrong is a warning, since a thread has nobody above it."""
        try:
            self._send_newest()
        except Exception as error:  # a controller's `sliders` or `status` failed
            warn_caller(f"the web page stands still; the run goes on: {error}")

    def _send_newest(self) -> None:
        """Look for news now and then, so that a step costs nothing and a pause shows as well."""
        sent: object = None
        last = -math.inf
        while not self._ended.wait(1.0 / SNAPSHOTS_PER_SECOND) and self._worker.alive:
            newest = self.newest
            if newest is sent and time.monotonic() - last < SECONDS_BETWEEN_UNCHANGED:
                continue
            sent, last = newest, time.monotonic()
            self._worker.send(snapshot(self._session, newest, self._observer))
        self._worker.send(snapshot(self._session, self.newest, self._observer))

    def _take_wishes(self) -> None:
        try:
            while True:
                message = self._worker.receive()
                if isinstance(message, KeyEvent):
                    self._session.keys.put(message)
                elif isinstance(message, SpeedWanted):
                    self._session.pace.speed = message.speed
        except (WorkerLost, TaichisoftError) as error:
            if not self._ended.is_set():
                warn_caller(f"the web page is gone; the run goes on: {error}")


def page_setup(session: "Session", address: Address, first: Snapshot) -> PageSetup:
    """The page of a run, to be served at an address."""
    model, controller = session.simulation.model, session.controller
    return PageSetup(
        host=address.host,
        port=address.port,
        token=address.token,
        content=PageScene(
            model.scene,
            body_surfaces(model.soft_bodies, model.rigid_bodies, model.obstacles),
            planes_of(model.obstacles),
            ActuatorNames({kind.name: model.actuators.names_of(kind) for kind in ACTUATOR_KINDS}),
            axes_of_bodies(model.scene, model.soft_bodies),
        ),
        first=first,
        run_bindings=BINDINGS,
        controller_bindings={} if session.replaying else dict(controller.bindings),
        pullable=() if session.replaying else model.external_forces.movable,
    )


def snapshot(session: "Session", state: "State", observer: Observer | None = None) -> Snapshot:
    """A run as it is now, in one of its states, seen by an observer of its model if there is one already."""
    model = session.simulation.model
    seen, report = (observer or Observer(model)).truth(state), session.simulation.report
    values = {figure.name: figure.values(seen) for figure in ON_PAGE}
    figures = {name: (list(of), np.array([*of.values()])) for name, of in values.items()}
    points, forces = model.external_forces.arrows(state)
    pull = session.pull
    pulled = "" if pull is None else f"{pull.body} pulled by {np.linalg.norm(seen.external_forces[pull.body]):.0f} mN"
    lines = {kind.name: _lines(model, kind, state) for kind in ACTUATOR_KINDS if kind.drawn == "lines"}
    return Snapshot(
        PageInstant(
            state.time,
            ShownPoses(state.position.astype(np.float32), state.rigid_position, state.rigid_rotation),
            lines,
            np.concatenate([state.contact_point, points]),
            np.concatenate([state.contact_impulse / model.scene.time.step, forces]),
            plotted_row(model.scene, state.actuator_effort, figures, state.rigid_position),
            dict(report.signals) if report is not None else {},
        ),
        sliders={} if session.replaying else dict(session.sliders),
        paused=session.paused,
        speed=session.pace.speed,
        real_time_factor=session.pace.real_time_factor,
        status=" · ".join(filter(None, (session.controller.status, pulled, session.notice))),
    )


def _lines(model: "Model", kind: ActuatorKind, state: "State") -> LinesShown:
    lines, actuators = model.actuators.sets[kind.name].lines, model.actuators
    effort, loss = actuators.of(kind, state.actuator_effort), actuators.losses_of(kind, state.actuator_loss)
    return lines_shown([line.points(state, model.frames) for line in lines], segment_efforts(lines, effort, loss))


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
            address: "HOST:PORT"; 127.0.0.1 and a free port from 8080 on where it is not given.
        """
        require("a web page", "viser", install=extra("web"))
        self._address = find_address(address)
        self._link: PageLink | None = None
        self.url = ""

    def follow(self, session: "Session") -> None:
        """Serve the page, and print where."""

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
