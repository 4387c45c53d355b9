"""The process that serves the page of a run: `python -m taichisoft_plugins.web.page_process`, messages in the pipes.

A process of its own, so that neither its work nor a viewer can slow the run. `page_link` starts it, nothing else does.
"""

import os
import sys
import threading
import time
from typing import IO, Any

import numpy as np

from taichisoft_plugins.web.controls import Controls
from taichisoft_plugins.web.curves import History
from taichisoft_plugins.web.frame import Frame
from taichisoft_plugins.web.live_bodies import LiveBodies
from taichisoft_plugins.web.messages import Farewell, Opening, Ready, Snapshot, receive, send
from taichisoft_plugins.web.page import KEEP_KEYS_FROM_CAMERA, Page

FRAMES_PER_SECOND = 30.0
"""At most."""
SECONDS_BETWEEN_TEXTS = 0.2
SECONDS_BETWEEN_CURVES = 0.25
SECONDS_TO_DELIVER = 0.5
"""For the last words, before the page closes."""


class Inbox:
    """The newest snapshot; a thread reads all that come, so that the run never waits for the page."""

    def __init__(self, stream: IO[bytes]):
        self._stream = stream
        self._arrived = threading.Event()
        self.newest: Snapshot | None = None
        self.farewell: Farewell | None = None
        threading.Thread(target=self._read, name="inbox", daemon=True).start()

    def wait(self) -> None:
        """Return when something has arrived since the last call."""
        self._arrived.wait()
        self._arrived.clear()

    def _read(self) -> None:
        while self.farewell is None:
            try:
                message = receive(self._stream)
            except (EOFError, OSError):
                message = Farewell("its process is gone")
            if isinstance(message, Snapshot):
                self.newest = message
            else:
                self.farewell = message
            self._arrived.set()


class Outbox:
    """What viewers want, on its way to the run; from any thread."""

    def __init__(self, stream: IO[bytes]):
        self._stream = stream
        self._lock = threading.Lock()

    def put(self, message: Any) -> None:
        """Send at once; when the run is gone, the inbox says so."""
        with self._lock:
            try:
                send(self._stream, message)
            except OSError:
                return


class LivePage:
    """The page of a run, with controls for every viewer who may have them."""

    def __init__(self, opening: Opening, outbox: Outbox):
        self._opening = opening
        self._outbox = outbox
        self._controls: dict[int, Controls] = {}
        self._snapshot = opening.first
        self._last_text = self._last_curves = 0.0
        first = frame_of(opening.bodies, opening.first)
        self._history = History(opening.bodies.cast, first)
        self.page = Page(opening.host, opening.port, opening.bodies.cast, first)
        self.page.server.gui.add_html(KEEP_KEYS_FROM_CAMERA)
        self.page.server.on_client_connect(self._arrived)
        self.page.server.on_client_disconnect(self._left)

    def show(self, snapshot: Snapshot) -> None:
        """Draw a snapshot for all viewers."""
        self._snapshot = snapshot
        frame = frame_of(self._opening.bodies, snapshot)
        self.page.view.show(frame)
        self._history.add(frame)
        if time.monotonic() - self._last_curves >= SECONDS_BETWEEN_CURVES:
            self._show_curves()
        if time.monotonic() - self._last_text >= SECONDS_BETWEEN_TEXTS:
            self._last_text = time.monotonic()
            self.page.say(status_line(snapshot))
            for controls in list(self._controls.values()):
                controls.follow(snapshot)

    def close(self, farewell: Farewell) -> None:
        """Say that the run has ended, and let everybody have that."""
        self.page.say(f"**{self._snapshot.time:.2f} s** · the run has ended: {farewell.outcome}")
        self._show_curves()
        self.page.server.flush()
        time.sleep(SECONDS_TO_DELIVER)
        self.page.server.stop()

    def _show_curves(self) -> None:
        self._last_curves = time.monotonic()
        self.page.curves.show(np.array(self._history.times), np.array(self._history.rows))

    async def _arrived(self, client: Any) -> None:
        self._controls[client.client_id] = Controls(client.gui, self._opening, self._snapshot, self._outbox.put)

    async def _left(self, client: Any) -> None:
        self._controls.pop(client.client_id, None)


def frame_of(bodies: LiveBodies, snapshot: Snapshot) -> Frame:
    """Where everything is in a snapshot."""
    return Frame(
        time=snapshot.time,
        vertices=bodies.vertices(snapshot.position, snapshot.rigid_position, snapshot.rigid_rotation),
        rigid_position=snapshot.rigid_position,
        contact_points=snapshot.contact_points,
        contact_forces=snapshot.contact_forces,
        pressures=snapshot.pressures,
        normal_forces=snapshot.normal_forces,
    )


def status_line(snapshot: Snapshot) -> str:
    """Time, speed and what the controller says, as Markdown."""
    if snapshot.paused:
        speed = "paused"
    elif snapshot.real_time_factor == snapshot.real_time_factor:
        speed = f"{snapshot.real_time_factor:.2f} x real time"
    else:
        speed = "not begun"
    return " · ".join(filter(None, (f"**{snapshot.time:.2f} s**", speed, snapshot.status)))


def main() -> None:
    """Serve until the run says farewell or is gone."""
    incoming, outgoing = sys.stdin.buffer, os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # viser prints
    opening = receive(incoming)
    outbox = Outbox(outgoing)
    live = LivePage(opening, outbox)
    live.show(opening.first)
    outbox.put(Ready(live.page.port))
    inbox = Inbox(incoming)
    shown = opening.first
    while inbox.farewell is None:
        inbox.wait()
        started = time.monotonic()
        if inbox.newest is not None and inbox.newest is not shown:
            shown = inbox.newest
            live.show(shown)
        time.sleep(max(0.0, 1.0 / FRAMES_PER_SECOND - (time.monotonic() - started)))
    if inbox.newest is not None:
        live.show(inbox.newest)
    live.close(inbox.farewell)


if __name__ == "__main__":
    main()
