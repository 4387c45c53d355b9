"""The worker process that serves the page of a run, so that neither its work nor a viewer can slow the run."""

import math
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from taichisoft.worker import Link
from taichisoft_outputs.web.controls import Controls
from taichisoft_outputs.web.curves import History
from taichisoft_outputs.web.frame import PageFrame
from taichisoft_outputs.web.page import KEEP_KEYS_FROM_CAMERA, Page
from taichisoft_outputs.web.page_messages import PageSetup, RunEnded, Snapshot

FRAMES_PER_SECOND = 30.0
"""Most frames that are drawn in a second."""
SECONDS_BETWEEN_TEXTS = 0.2
SECONDS_BETWEEN_CURVES = 0.25
SECONDS_TO_DELIVER = 0.5
"""Time between the last line of text and the end of the page, in which viewers receive it."""

TIME_TO_CLOSE = 10.0
"""Time after the end of the run at which the process is gone, whatever hangs [s]."""


class Inbox:
    """Keeps the newest snapshot; a thread takes all that come, so that the run never waits for the page."""

    def __init__(self, link: Link):
        self._link = link
        self._arrived = threading.Event()
        self.newest: Snapshot | None = None
        self.end: RunEnded | None = None
        threading.Thread(target=self._take, name="inbox", daemon=True).start()

    def wait(self) -> None:
        """Return when something has arrived since the last call."""
        self._arrived.wait()
        self._arrived.clear()

    def _take(self) -> None:
        while self.end is None:
            try:
                message = self._link.receive()
            except EOFError:
                message = RunEnded("its process is gone")
            if isinstance(message, Snapshot):
                self.newest = message
            else:
                self.end = message
            self._arrived.set()


class LivePage:
    """The page of a run, with controls for every viewer."""

    def __init__(self, setup: PageSetup, tell: Callable[[Any], None]):
        """Serve the page; `tell` sends a message to the run, from any thread."""
        self._setup, self._tell = setup, tell
        self._controls: dict[int, Controls] = {}
        self._snapshot = setup.first
        self._last_text = self._last_curves = 0.0
        first = frame_of(setup, setup.first)
        self._history = History(first)
        self.page = Page(setup.host, setup.port, setup.token, setup.content, first)
        self.page.server.gui.add_html(KEEP_KEYS_FROM_CAMERA)
        self.page.server.on_client_connect(self._arrived)
        self.page.server.on_client_disconnect(self._left)

    def show(self, snapshot: Snapshot) -> None:
        """Draw a snapshot for all viewers."""
        self._snapshot = snapshot
        frame = frame_of(self._setup, snapshot)
        self.page.view.show(frame)
        self._history.add(frame)
        if time.monotonic() - self._last_curves >= SECONDS_BETWEEN_CURVES:
            self._show_curves()
        if time.monotonic() - self._last_text >= SECONDS_BETWEEN_TEXTS:
            self._last_text = time.monotonic()
            self.page.set_status(status_line(snapshot))
            for controls in list(self._controls.values()):
                controls.follow(snapshot)

    def close(self, end: RunEnded) -> None:
        """Say that the run has ended, wait until viewers have received it, and close the page."""
        self.page.set_status(f"**{self._snapshot.time:.2f} s** · the run has ended: {end.outcome}")
        self._show_curves()
        self.page.server.flush()
        time.sleep(SECONDS_TO_DELIVER)
        self.page.server.stop()

    def _show_curves(self) -> None:
        self._last_curves = time.monotonic()
        history = self._history
        self.page.curves.show(np.array(history.times), np.array(history.rows), history.signals)

    async def _arrived(self, client: Any) -> None:
        self._controls[client.client_id] = Controls(client.gui, self._setup, self._snapshot, self._tell)

    async def _left(self, client: Any) -> None:
        self._controls.pop(client.client_id, None)


def frame_of(setup: PageSetup, snapshot: Snapshot) -> PageFrame:
    """The frame of a snapshot."""
    vertices = [surface.vertices(snapshot) for surface in setup.surfaces]
    return PageFrame(
        snapshot.time,
        vertices,
        snapshot.lines,
        snapshot.contact_points,
        snapshot.contact_forces,
        snapshot.plotted,
        np.array([axes.place(snapshot) for axes in setup.content.axes.values()]).reshape(-1, 4, 3),
        snapshot.signals,
    )


def status_line(snapshot: Snapshot) -> str:
    """One line of Markdown with the time, the speed and the status of the controller."""
    if snapshot.paused:
        speed = "paused"
    elif math.isnan(snapshot.real_time_factor):
        speed = "not begun"
    else:
        speed = f"{snapshot.real_time_factor:.2f} x real time"
    return " · ".join(filter(None, (f"**{snapshot.time:.2f} s**", speed, snapshot.status)))


def serve(link: Link) -> None:
    """Serve the page until the run has ended or is gone.

    The first message is a `PageSetup`, answered by the page's port; after it come snapshots, and `RunEnded` at last.
    """
    setup = link.receive()
    link.time_to_close = TIME_TO_CLOSE
    live = LivePage(setup, link.send)
    live.show(setup.first)
    link.send(live.page.port)
    inbox = Inbox(link)
    shown = setup.first
    while inbox.end is None:
        inbox.wait()
        started = time.monotonic()
        if inbox.newest is not None and inbox.newest is not shown:
            shown = inbox.newest
            live.show(shown)
        time.sleep(max(0.0, 1.0 / FRAMES_PER_SECOND - (time.monotonic() - started)))
    if inbox.newest is not None:
        live.show(inbox.newest)
    live.close(inbox.end)
