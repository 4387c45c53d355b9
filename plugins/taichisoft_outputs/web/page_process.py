"""The worker process that serves the page of a run, so that neither its work nor a viewer can slow the run."""

import math
import threading
import time
from collections.abc import Awaitable, Callable, Iterable
from typing import Any

import numpy as np

from taichisoft.base import Link
from taichisoft.control import KeyEvent, Slider
from taichisoft_outputs.web.curves import History
from taichisoft_outputs.web.page import KEEP_KEYS_FROM_CAMERA, SPEEDS, Page, clamped
from taichisoft_outputs.web.page_messages import PageSetup, RunEnded, Snapshot, SpeedWanted

# What one viewer may do: sliders, buttons and hotkeys, all of which become key events of the run.

MOVED_BY_VIEWER = 0.5
"""For so long [s] a slider that a viewer has moved is not set back to what the run has not heard of yet."""

MOST_ABOVE = 12
"""A folder with more sliders stands below the plots."""

LABELS = {"up": "↑ up", "down": "↓ down", "left": "← left", "right": "→ right"}

KEY_NAMES = {
    "up": "↑",
    "down": "↓",
    "left": "←",
    "right": "→",
    "+": "PgUp",
    "-": "PgDn",
    "escape": "Esc",
}
"""What keys of a browser are called on a keyboard."""

HOTKEYS = {
    "up": "arrowup",
    "down": "arrowdown",
    "left": "arrowleft",
    "right": "arrowright",
    "+": "pageup",
    "-": "pagedown",
    **{key: key for key in ("space", "enter", "escape", "tab", "backspace")},
}
"""Names of keys in a browser, which keeps + and - for itself; letters and digits keep their names."""


class Controls:
    """The controls of one viewer."""

    def __init__(self, gui: Any, setup: PageSetup, first: Snapshot, send: Callable[[Any], None]):
        """Put the controls into the viewer's own panel; `send` takes key events and speeds."""
        self._gui, self._setup, self._send = gui, setup, send
        self._sliders: dict[str, tuple[Any, list[float]]] = {}
        self._speed: tuple[Any, Any] | None = None
        self._add_all(first)

    def follow(self, snapshot: Snapshot) -> None:
        """Let sliders follow changes by keys or on another page."""
        for name, (handle, moved) in list(self._sliders.items()):
            slider = snapshot.sliders.get(name)
            if slider is not None and time.monotonic() - moved[0] > MOVED_BY_VIEWER:
                handle.value = _within(slider)
        if self._speed is not None:
            number, unlimited = self._speed
            unlimited.value = snapshot.speed is None
            if snapshot.speed is not None:
                number.value = clamped(snapshot.speed, SPEEDS)

    def _add_all(self, first: Snapshot) -> None:
        setup = self._setup
        for number, group in enumerate(dict.fromkeys(one.group for one in first.sliders.values())):
            some = {name: one for name, one in first.sliders.items() if one.group == group}
            order = (1.0 if len(some) <= MOST_ABOVE else 200.0) + 0.01 * number
            with self._gui.add_folder(group, order=order):
                for name, slider in some.items():
                    self._add_slider(name, slider)
        if setup.controller_bindings:
            with self._gui.add_folder("gripper", order=2.0):
                for keys, effect in setup.controller_bindings.items():
                    named = [key for key in keys.split() if key != "..."]
                    if len(named) == 1:
                        self._add_button(effect, named[0])
                    else:
                        self._add_group(effect, named)
                    self._add_hotkeys(effect, _all_keys(keys))
        with self._gui.add_folder("run", order=3.0):
            if setup.pullable:
                self._gui.add_markdown("Drag a body with shift to pull it.")
            self._add_speed(first)
            for key, effect in setup.run_bindings.items():
                if key in HOTKEYS or key.isalnum():  # "?" is for terminals, which have no buttons
                    self._add_button(effect, key)
                    self._add_hotkeys(effect, [key])

    def _add_slider(self, name: str, slider: Slider) -> None:
        unit = "" if slider.unit == "1" else f" [{slider.unit}]"  # an opening, a share
        label = f"{name.removesuffix('.cavity').replace('_', ' ')}{unit}"
        handle = self._gui.add_slider(
            label,
            min=float(slider.lowest),
            max=float(slider.highest),
            step=float(slider.step),
            initial_value=_within(slider),
        )
        moved = [-math.inf]
        self._sliders[name] = handle, moved

        @handle.on_update
        async def _(event: Any) -> None:
            if event.client is not None and math.isfinite(handle.value):  # otherwise it was `follow`
                moved[0] = time.monotonic()
                self._send(KeyEvent(name, value=float(handle.value)))

    def _add_button(self, effect: str, key: str) -> None:
        """A button that says what it does, in whole where the mouse rests on it, and which key of the page does it."""
        self._gui.add_button(f"{effect} ({KEY_NAMES.get(key, key)})", hint=effect).on_click(self._sender_of(key))

    def _add_group(self, effect: str, keys: list[str]) -> None:
        labels = {LABELS.get(key, key): key for key in keys}
        handle = self._gui.add_button_group(effect, tuple(labels))

        @handle.on_click
        async def _(event: Any) -> None:
            if event.client is not None and handle.value in labels:
                self._send(KeyEvent(labels[handle.value]))

    def _add_hotkeys(self, effect: str, keys: Iterable[str]) -> None:
        for key in keys:
            hotkey = HOTKEYS.get(key, key.upper() if len(key) == 1 and key.isascii() and key.isalnum() else None)
            if hotkey is not None:
                self._gui.add_command(f"{key}: {effect}", hotkey=hotkey).on_trigger(self._sender_of(key))

    def _sender_of(self, key: str) -> Callable[[Any], Awaitable[None]]:
        async def send_key(event: Any) -> None:
            self._send(KeyEvent(key))

        return send_key

    def _add_speed(self, first: Snapshot) -> None:
        speed = 1.0 if first.speed is None else clamped(first.speed, SPEEDS)
        number = self._gui.add_slider("speed [x real time]", *SPEEDS, step=0.05, initial_value=speed)
        unlimited = self._gui.add_checkbox("as fast as it goes", first.speed is None)
        self._speed = number, unlimited

        async def changed(event: Any) -> None:
            if event.client is not None and math.isfinite(number.value):
                self._send(SpeedWanted(None if unlimited.value else clamped(number.value, SPEEDS)))

        async def limited(event: Any) -> None:
            if event.client is not None:
                unlimited.value = False
            await changed(event)

        number.on_update(limited)
        unlimited.on_update(changed)


def _all_keys(keys: str) -> list[str]:
    """The keys that a text names; "1 2 3 ..." stands for all further digits, too."""
    named = keys.split()
    if named[-1] != "...":
        return named
    return [*named[:-1], *map(str, range(int(named[-2]) + 1, 10))]


def _within(slider: Slider) -> float:
    """The value of a slider within its ends: a controller that only shows its pressure may have it beyond them."""
    return clamped(slider.value, (slider.lowest, slider.highest))


INSTANTS_PER_SECOND = 30.0
"""Most instants that are drawn in a second."""
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
        self._history = History(setup.first.instant)
        self.page = Page(setup.host, setup.port, setup.token, setup.content, setup.first.instant)
        self.page.server.gui.add_html(KEEP_KEYS_FROM_CAMERA)
        self.page.view.let_pull(setup.pullable, tell)
        self.page.server.on_client_connect(self._arrived)
        self.page.server.on_client_disconnect(self._left)

    def show(self, snapshot: Snapshot) -> None:
        """Draw a snapshot for all viewers."""
        self._snapshot = snapshot
        self.page.view.show(snapshot.instant)
        self._history.add(snapshot.instant)
        if time.monotonic() - self._last_curves >= SECONDS_BETWEEN_CURVES:
            self._show_curves()
        if time.monotonic() - self._last_text >= SECONDS_BETWEEN_TEXTS:
            self._last_text = time.monotonic()
            self.page.set_status(status_line(snapshot), snapshot.instant)
            for controls in list(self._controls.values()):
                controls.follow(snapshot)

    def close(self, end: RunEnded) -> None:
        """Say that the run has ended, wait until viewers have received it, and close the page."""
        last = self._snapshot.instant
        self.page.set_status(f"**{last.time:.2f} s** · the run has ended: {end.outcome}", last)
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


def status_line(snapshot: Snapshot) -> str:
    """One line of Markdown with the time, the speed and the status of the controller."""
    if snapshot.paused:
        speed = "paused"
    elif math.isnan(snapshot.real_time_factor):
        speed = "not begun"
    else:
        speed = f"{snapshot.real_time_factor:.2f} x real time"
    return " · ".join(filter(None, (f"**{snapshot.instant.time:.2f} s**", speed, snapshot.status)))


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
        time.sleep(max(0.0, 1.0 / INSTANTS_PER_SECOND - (time.monotonic() - started)))
    if inbox.newest is not None:
        live.show(inbox.newest)
    live.close(inbox.end)
