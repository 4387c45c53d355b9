"""The process that serves the page of a run: `python -m taichisoft_plugins.web.page_process`, messages in the pipes.

The page has a process of its own so that neither its work nor a viewer can slow the run; only `page_link` starts it,
with the number of the process of the run as argument.
"""

import math
import os
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import IO, Any

import numpy as np

from taichisoft_plugins.web.controls import Controls
from taichisoft_plugins.web.curves import History
from taichisoft_plugins.web.frame import Frame
from taichisoft_plugins.web.messages import PageSetup, Ready, RunEnded, Snapshot, receive, send
from taichisoft_plugins.web.page import KEEP_KEYS_FROM_CAMERA, Page

FRAMES_PER_SECOND = 30.0
"""Most frames that are drawn in a second."""
SECONDS_BETWEEN_TEXTS = 0.2
SECONDS_BETWEEN_CURVES = 0.25
SECONDS_TO_DELIVER = 0.5
"""Time between the last line of text and the end of the page, in which viewers receive it."""


SECONDS_TO_CLOSE = 10.0
"""Time after the end of the run at which the process is gone, whatever hangs."""
SECONDS_BETWEEN_LOOKS = 1.0
"""Time between two looks whether the run still is there [s]."""
GONE = RunEnded("its process is gone")


class Inbox:
    """Keeps the newest snapshot; a thread reads all that come, so that the run never waits for the page.

    The pipe ends with the run, unless a process that forked from the run holds it open: so another thread looks whether
    the run still is our parent.
    """

    def __init__(self, stream: IO[bytes], run: int):
        self._stream, self._run = stream, run
        self._arrived = threading.Event()
        self.newest: Snapshot | None = None
        self.end: RunEnded | None = None
        threading.Thread(target=self._read, name="inbox", daemon=True).start()
        threading.Thread(target=self._watch, name="run", daemon=True).start()

    def wait(self) -> None:
        """Return when something has arrived since the last call."""
        self._arrived.wait()
        self._arrived.clear()

    def _read(self) -> None:
        while self.end is None:
            try:
                message = receive(self._stream)
            except (EOFError, OSError):
                message = GONE
            if isinstance(message, Snapshot):
                self.newest = message
                self._arrived.set()
            else:
                self._take_end(message)

    def _watch(self) -> None:
        while self.end is None:
            if os.getppid() != self._run:
                self._take_end(GONE)
            time.sleep(SECONDS_BETWEEN_LOOKS)

    def _take_end(self, end: RunEnded) -> None:
        exit_anyway = threading.Timer(SECONDS_TO_CLOSE, os._exit, (1,))
        exit_anyway.daemon = True
        exit_anyway.start()
        self.end = end
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
        self.page.curves.show(np.array(self._history.times), np.array(self._history.rows))

    async def _arrived(self, client: Any) -> None:
        self._controls[client.client_id] = Controls(client.gui, self._setup, self._snapshot, self._tell)

    async def _left(self, client: Any) -> None:
        self._controls.pop(client.client_id, None)


def frame_of(setup: PageSetup, snapshot: Snapshot) -> Frame:
    """The frame of a snapshot."""
    vertices = [surface.vertices(snapshot) for surface in setup.surfaces]
    return Frame(
        snapshot.time,
        vertices,
        snapshot.cable_lines,
        snapshot.cable_tensions,
        snapshot.contact_points,
        snapshot.contact_forces,
        snapshot.plotted,
        np.array([axes.place(snapshot) for axes in setup.content.axes.values()]).reshape(-1, 4, 3),
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


def main() -> None:
    """Serve until the run has ended or is gone."""
    incoming, outgoing = sys.stdin.buffer, os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # viser prints
    setup = receive(incoming)
    writing = threading.Lock()

    def tell(message: Any) -> None:
        with writing, suppress(OSError):  # when the run is gone, the inbox says so
            send(outgoing, message)

    live = LivePage(setup, tell)
    live.show(setup.first)
    tell(Ready(live.page.port))
    inbox = Inbox(incoming, int(sys.argv[1]))
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


if __name__ == "__main__":
    main()
