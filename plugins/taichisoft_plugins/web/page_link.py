"""The run's end of its page: starts the process, sends it the newest state, and hands on what viewers want."""

import math
import os
import subprocess
import threading
import time
import warnings
from collections.abc import Mapping
from tempfile import TemporaryFile
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from taichisoft.bodies.body_axes import axes_of_bodies
from taichisoft.bodies.cable_paths import cable_paths, segment_tensions
from taichisoft.bodies.surfaces import body_surfaces, planes_of
from taichisoft.child_process import PYTHON, how_it_ended
from taichisoft.control.contact_summary import summarise_contacts
from taichisoft.control.controller import Slider
from taichisoft.control.keys import KeyEvent
from taichisoft.session.session import BINDINGS
from taichisoft_plugins.web.address import Address, WebError
from taichisoft_plugins.web.curves import plotted_row
from taichisoft_plugins.web.frame import PageScene, lines_of_cables
from taichisoft_plugins.web.messages import PageSetup, Ready, RunEnded, Snapshot, SpeedWanted, receive, send

if TYPE_CHECKING:
    from taichisoft.session.session import Session
    from taichisoft.state import State

SNAPSHOTS_PER_SECOND = 30.0
SECONDS_BETWEEN_UNCHANGED = 0.2
"""A paused run is told of now and then, because its status may change."""
START_LIMIT = 60.0
"""Longest time until the process serves the page [s]; usually 2."""
END_LIMIT = 5.0
"""Longest time until the process ends [s]; usually 1."""
SHOWN_PRESSURE = 150.0
"""Highest pressure of sliders that only show one, where the scene has no limit [kPa]."""


class PageLink:
    """A page beside a run. The run itself only sets `newest`; two threads do the rest.

    Attributes:
        newest: state that the page shall show.
        port: port at which the page listens.
    """

    def __init__(self, session: "Session", address: Address):
        """Start the process and wait until it serves.

        Raises:
            WebError: it does not.
        """
        self._session = session
        self.newest: State = session.simulation.state
        self._ended = threading.Event()
        self._errors: IO[bytes] = TemporaryFile()  # noqa: SIM115 - needed as long as the process
        self._process = subprocess.Popen(
            [*PYTHON, "-m", "taichisoft_plugins.web.page_process", str(os.getpid())],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            start_new_session=True,  # Ctrl and c, or a hang-up, is for the run, which then tells the page
        )
        assert self._process.stdin is not None and self._process.stdout is not None
        self._to_page, self._from_page = self._process.stdin, self._process.stdout
        self.port = self._open(address)
        self._sender = threading.Thread(target=self._send_all, name="page", daemon=True)
        self._sender.start()
        threading.Thread(target=self._heed_viewers, name="viewers", daemon=True).start()

    def end(self, outcome: str) -> None:
        """Let the page say how the run ended, and close it."""
        self._ended.set()
        self._sender.join(END_LIMIT)
        if not self._sender.is_alive():  # otherwise the page reads nothing any more
            self._tell(RunEnded(outcome))
        self._end_process()

    def _open(self, address: Address) -> int:
        """Send the first message and wait for the answer; a process that hangs is ended."""
        watchdog = threading.Timer(START_LIMIT, self._process.kill)
        watchdog.start()
        try:
            send(self._to_page, page_setup(self._session, address, snapshot(self._session, self.newest)))
            answer = receive(self._from_page)
            assert isinstance(answer, Ready)
            return answer.port
        except (OSError, EOFError) as error:
            raise WebError(f"no page at {address.url}: {self._end_process()}") from error
        finally:
            watchdog.cancel()

    def _send_all(self) -> None:
        """Send until the run ends; what goes wrong is a warning, since a thread has nobody above it."""
        try:
            self._send_newest()
        except Exception as error:  # a controller's `sliders` or `status` failed
            warnings.warn(f"the web page stands still; the run goes on: {error}", stacklevel=1)

    def _send_newest(self) -> None:
        """Look for news now and then, so that a step costs nothing and a pause shows as well."""
        sent: object = None
        last = -math.inf
        while not self._ended.wait(1.0 / SNAPSHOTS_PER_SECOND):
            newest = self.newest
            if newest is sent and time.monotonic() - last < SECONDS_BETWEEN_UNCHANGED:
                continue
            sent, last = newest, time.monotonic()
            if not self._tell(snapshot(self._session, newest)):
                warnings.warn(f"the web page is gone; the run goes on: {self._end_process()}", stacklevel=1)
                return
        self._tell(snapshot(self._session, self.newest))

    def _heed_viewers(self) -> None:
        while True:
            try:
                message = receive(self._from_page)
            except (EOFError, OSError):
                return
            if isinstance(message, KeyEvent):
                self._session.keys.put(message)
            elif isinstance(message, SpeedWanted):
                self._session.pace.speed = message.speed

    def _tell(self, message: Any) -> bool:
        """Send a message; returns whether the page got it."""
        try:
            send(self._to_page, message)
        except OSError:
            return False
        return True

    def _end_process(self) -> str:
        """Wait for the end of the process, and say in one line why it ended."""
        try:
            exit_code = self._process.wait(END_LIMIT)
        except subprocess.TimeoutExpired:
            self._process.kill()
            exit_code = self._process.wait()
        self._errors.seek(0)
        return how_it_ended(exit_code, self._errors.read()) or "its process ended"


def page_setup(session: "Session", address: Address, first: Snapshot) -> PageSetup:
    """The page of a run, to be served at an address."""
    model, controller = session.simulation.model, session.controller
    surfaces = body_surfaces(model.soft_bodies, model.rigid_bodies, model.obstacles)
    return PageSetup(
        host=address.host,
        port=address.port,
        token=address.token,
        content=PageScene(
            model.scene,
            surfaces,
            planes_of(model.obstacles),
            model.cavities.names,
            model.cables.names,
            axes_of_bodies(model.scene, model.soft_bodies),
        ),
        surfaces=surfaces,
        first=first,
        run_bindings=BINDINGS,
        controller_bindings={} if session.replaying else dict(controller.bindings),
        sliders_move=bool(controller.sliders) and not session.replaying,
    )


def snapshot(session: "Session", state: "State") -> Snapshot:
    """A run as it is now, in one of its states."""
    model, pressures = session.simulation.model, state.cavity_pressure.tolist()
    forces = summarise_contacts(model, state).normal_forces
    paths = cable_paths(model.cables)
    lines, tensions = lines_of_cables(
        [path.points(state, model.base_pivot) for path in paths],
        segment_tensions(paths, state.cable_tension, state.cable_tension_loss),
    )
    return Snapshot(
        time=state.time,
        position=state.position.astype(np.float32),
        rigid_position=state.rigid_position,
        rigid_rotation=state.rigid_rotation,
        cable_lines=lines,
        cable_tensions=tensions,
        contact_points=state.contact_point,
        contact_forces=state.contact_impulse / model.scene.time.step,
        plotted=plotted_row(model.scene, pressures, state.cable_tension.tolist(), forces, state.rigid_position),
        sliders=_sliders(session, dict(zip(model.cavities.names, pressures, strict=True))),
        paused=session.paused,
        speed=session.pace.speed,
        real_time_factor=session.pace.real_time_factor,
        status=session.controller.status,
    )


def _sliders(session: "Session", pressures: Mapping[str, float]) -> dict[str, Slider]:
    """The sliders of the controller; where it has none, sliders that show the pressures."""
    if session.controller.sliders:
        return dict(session.controller.sliders)
    limits = session.simulation.model.scene.limits
    lowest = 0.0 if limits.lowest_pressure is None else limits.lowest_pressure
    highest = SHOWN_PRESSURE if limits.highest_pressure is None else limits.highest_pressure
    return {name: Slider(value, lowest, highest, 0.1, "kPa") for name, value in pressures.items()}
