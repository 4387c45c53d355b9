"""The run's end of its page: starts the process, sends it the newest state, and hands on what viewers want."""

import math
import subprocess
import sys
import threading
import time
import warnings
from tempfile import TemporaryFile
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from taichisoft.control.controller import Slider
from taichisoft.control.keys import KeyEvent
from taichisoft.session.session import BINDINGS
from taichisoft_plugins.web.address import Address
from taichisoft_plugins.web.errors import WebError
from taichisoft_plugins.web.live_bodies import live_bodies
from taichisoft_plugins.web.messages import Farewell, Opening, Ready, Snapshot, SpeedWanted, receive, send

if TYPE_CHECKING:
    from taichisoft.session.session import Session
    from taichisoft.state import State
    from taichisoft.step.report import StepReport

SNAPSHOTS_PER_SECOND = 30.0
SECONDS_BETWEEN_UNCHANGED = 0.2
"""A paused run is told of now and then, because its status may change."""
START_LIMIT = 60.0
"""For the process to serve the page [s]; usually 2."""
END_LIMIT = 5.0
"""For it to end [s]; usually 1."""
SHOWN_PRESSURE = 150.0
"""End of sliders that only show, where the scene has no limit [kPa]."""


class PageLink:
    """A page beside a run. The run itself only sets `newest`; two threads do the rest.

    Attributes:
        newest: what the page shall show: a state, and the report of the step that led to it.
        port: where the page listens.
    """

    def __init__(self, session: "Session", address: Address):
        """Start the process and wait until it serves.

        Raises:
            WebError: it does not.
        """
        self._session = session
        self.newest: tuple[State, StepReport | None] = session.simulation.state, None
        self._ended = threading.Event()
        self._errors: IO[bytes] = TemporaryFile()  # noqa: SIM115 - it is needed as long as the process
        self._process = subprocess.Popen(
            [sys.executable, "-m", "taichisoft_plugins.web.page_process"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            start_new_session=True,  # Ctrl and c, or a hang-up, is for the run, which then says farewell
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
            self._tell(Farewell(outcome))
        try:
            self._process.wait(END_LIMIT)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _open(self, address: Address) -> int:
        """Send the first message and wait for the answer; a process that hangs is ended."""
        watchdog = threading.Timer(START_LIMIT, self._process.kill)
        watchdog.start()
        try:
            send(self._to_page, self._opening(address))
            answer = receive(self._from_page)
            assert isinstance(answer, Ready)
            return answer.port
        except (OSError, EOFError) as error:
            self._process.wait()
            raise WebError(f"no page at {address.url}: {self._last_words()}") from error
        finally:
            watchdog.cancel()

    def _opening(self, address: Address) -> Opening:
        session = self._session
        controller = session.controller
        heeded = {} if session.replaying else dict(controller.bindings)
        return Opening(
            host=address.host,
            port=address.port,
            token=address.token,
            bodies=live_bodies(session.simulation.model),
            first=self._snapshot(),
            run_bindings=BINDINGS,
            controller_bindings=heeded,
            sliders_move=bool(controller.sliders) and not session.replaying,
        )

    def _send_all(self) -> None:
        """Until the run ends; what goes wrong is a warning, since a thread has nobody above it."""
        try:
            self._send_newest()
        except Exception as error:  # of a controller's `sliders` or `status`
            warnings.warn(f"the web page stands still; the run goes on: {error}", stacklevel=1)

    def _send_newest(self) -> None:
        """It polls, so that a step costs nothing and a pause shows as well."""
        sent: object = None
        last = -math.inf
        while not self._ended.wait(1.0 / SNAPSHOTS_PER_SECOND):
            newest = self.newest
            if newest is sent and time.monotonic() - last < SECONDS_BETWEEN_UNCHANGED:
                continue
            sent, last = newest, time.monotonic()
            if not self._tell(self._snapshot()):
                warnings.warn(f"the web page is gone; the run goes on: {self._last_words()}", stacklevel=1)
                return
        self._tell(self._snapshot())

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

    def _snapshot(self) -> Snapshot:
        session = self._session
        state, report = self.newest
        nothing = np.zeros((0, 3))
        cavities = session.simulation.model.cavities.names
        pressures = report.pressures if report is not None else dict.fromkeys(cavities, 0.0)
        return Snapshot(
            time=state.time,
            position=state.position.astype(np.float32),
            rigid_position=state.rigid_position,
            rigid_rotation=state.rigid_rotation,
            contact_points=report.contact_points if report is not None else nothing,
            contact_forces=report.contact_forces if report is not None else nothing,
            pressures=pressures,
            normal_forces=report.normal_forces if report is not None else {},
            sliders=self._sliders(pressures),
            paused=session.paused,
            speed=session.pace.speed,
            real_time_factor=session.pace.real_time_factor,
            status=session.controller.status,
        )

    def _sliders(self, pressures: dict[str, float]) -> dict[str, Slider]:
        """The controller's; of one that has none, pressures to look at."""
        if self._session.controller.sliders:
            return dict(self._session.controller.sliders)
        limits = self._session.simulation.model.scene.limits
        lowest = 0.0 if limits.lowest_pressure is None else limits.lowest_pressure
        highest = SHOWN_PRESSURE if limits.highest_pressure is None else limits.highest_pressure
        return {name: Slider(value, lowest, highest, 0.1, "kPa") for name, value in pressures.items()}

    def _tell(self, message: Any) -> bool:
        """Whether the page got it."""
        try:
            send(self._to_page, message)
        except OSError:
            return False
        return True

    def _last_words(self) -> str:
        """What the process complained of last."""
        self._errors.seek(0)
        lines = self._errors.read().decode(errors="replace").strip().splitlines()
        return lines[-1] if lines else "its process ended without a word"
