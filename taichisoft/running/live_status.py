"""Status display of an interactive run: time, speed, pressures, object, last keys."""

import contextlib
import time
from collections.abc import Callable, Iterator

import numpy as np
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from taichisoft.running.messages import print_line
from taichisoft.session.session import Session
from taichisoft.step.report import StepReport
from taichisoft.terminal_text import plain, printable

REFRESHES = 8
"""Redraws of the status per second of wall-clock time."""
SECONDS_BETWEEN_LINES = 5.0
"""Wall-clock time between two lines [s], on consoles that cannot redraw lines."""


@contextlib.contextmanager
def live_status(console: Console, session: Session) -> Iterator[Callable[[StepReport], None]]:
    """Show a run on the console, redrawn in place or else as occasional lines; yields the function to call after steps.

    A separate thread redraws the status, so that a pause shows at once and steps are not delayed. The display ends
    silently when the terminal is closed, which must not stop the outputs of the run.
    """
    status = LiveStatus(console, session)
    if not console.is_terminal or console.is_dumb_terminal:
        yield status.update
        status.print_line()
        return
    live = Live(get_renderable=status.picture, console=console, refresh_per_second=REFRESHES)
    with contextlib.suppress(OSError):
        live.start(refresh=True)
    try:
        yield status.update
    finally:
        with contextlib.suppress(OSError):
            live.stop()


class LiveStatus:
    """Time, speed, pressures, object and keys of a run as text."""

    def __init__(self, console: Console, session: Session):
        self._console = console
        self._session = session
        self._last_line = time.monotonic()
        self._help_was_shown = False
        self._scene = session.simulation.model.scene
        self._object = self._scene.main_object

    def update(self, report: StepReport) -> None:
        """Note a step; on consoles without redrawing, print a line if the last line is old enough."""
        if self._console.is_terminal and not self._console.is_dumb_terminal:
            return
        if self._session.shows_help and not self._help_was_shown:
            self._console.print(self._help())
        self._help_was_shown = self._session.shows_help
        if time.monotonic() - self._last_line >= SECONDS_BETWEEN_LINES:
            self.print_line()

    def print_line(self) -> None:
        """Print the state of the run in one line."""
        self._last_line = time.monotonic()
        parts = [self._clock(), self._pressures()]
        if self._object is not None:
            parts.append(f"{self._object} {self._object_state()}")
        with contextlib.suppress(OSError):
            print_line(self._console, "; ".join(parts))

    def picture(self) -> RenderableType:
        """The state of the run in a constant number of lines, and the help of the keys if requested."""
        rows = Table.grid(padding=(0, 2))
        rows.add_column(style="cyan", no_wrap=True)
        rows.add_column(no_wrap=True, overflow="ellipsis")
        rows.add_row("time", plain(self._clock()))
        rows.add_row("pressure", plain(self._pressures()))
        if self._object is not None:
            rows.add_row(plain(self._object), plain(self._object_state()))
        keys = " ".join(str(event) for event in tuple(self._session.recent_keys))
        rows.add_row("keys", plain(keys or "none yet"))
        hint = "? shows what the keys do, Esc ends the run"
        rows.add_row(
            "",
            Text(
                printable("; ".join(filter(None, [self._session.controller.status, self._session.notice, hint]))),
                style="dim",
            ),
        )
        return Group(rows, self._help()) if self._session.shows_help else rows

    def _clock(self) -> str:
        pace = self._session.pace
        text = f"{self._session.simulation.state.time:.2f} s"
        if self._session.paused:
            return f"{text}, paused"
        if np.isfinite(pace.real_time_factor):
            text += f" at {pace.real_time_factor:.2f} x real time"
        return text if pace.keeps_up else f"{text}, cannot keep up with {pace.speed:g} x"

    def _pressures(self) -> str:
        """Pressures; a single value if all agree to the shown digits."""
        pressures = self._session.simulation.observe().truth.pressures
        shown = {name: f"{value:.1f} kPa" for name, value in pressures.items()}
        if len(set(shown.values())) > 1:
            return ", ".join(f"{name} {value}" for name, value in shown.items())
        return next(iter(shown.values()), "none")

    def _object_state(self) -> str:
        """Lift against gravity since the first state, and the sum of the normal forces of soft bodies."""
        session, index = self._session, list(self._scene.rigid_bodies).index(self._object or "")
        way = session.simulation.state.rigid_position[index] - session.first_state.rigid_position[index]
        forces = session.simulation.observe().truth.normal_forces
        soft = self._scene.soft_bodies.keys()
        force = sum(forces[pair] for pair in forces if self._object in pair and not soft.isdisjoint(pair))
        return f"lifted by {self._scene.up @ way:z.1f} mm, pressed with {force:.0f} mN"

    def _help(self) -> RenderableType:
        table = Table("key", "what it does", title="keys, with Ctrl or without", title_justify="left")
        for key, effect in self._session.bindings.items():
            table.add_row(plain(key), plain(effect))
        return table
