"""The page of a recording: to play, to scrub, and to follow while its run goes on."""

import time
from pathlib import Path
from typing import Any

import numpy as np

from taichisoft.errors import MeshError
from taichisoft.mechanics import ACTUATOR_KINDS
from taichisoft.mesh import SectionPlane
from taichisoft_outputs.drawing.colouring import sample_instants
from taichisoft_outputs.drawing.overlay import SAMPLES
from taichisoft_outputs.drawing.surface_painter import cut_open
from taichisoft_outputs.recording.layout import UNFINISHED
from taichisoft_outputs.recording.reader import Recording, read_recording
from taichisoft_outputs.web.address import Address
from taichisoft_outputs.web.curves import MOST_POINTS, ON_PAGE, plotted_row
from taichisoft_outputs.web.page import SPEEDS, Page, clamped
from taichisoft_outputs.web.page_messages import PageInstant, PageScene, lines_shown

INSTANTS_PER_SECOND = 30.0
SECONDS_BETWEEN_LOOKS = 1.0
"""The file of a run that goes on is looked at again after so many seconds."""


class Playback:
    """A position in the instants of a recording.

    Attributes:
        clock: time at which each instant is shown [s], from 0; a new start of the run takes none, (instant_count,).
        position: time of the viewers on that clock [s].
        playing: whether it moves on.
        speed: recorded over wall-clock time.
    """

    def __init__(self, times: np.ndarray):
        """Begin to play at the first instant; times [s] of all instants, shape (instant_count,)."""
        self.position = 0.0
        self.playing = True
        self.speed = 1.0
        self.extend(times)

    def extend(self, times: np.ndarray) -> None:
        """Set the times of all instants, after more were recorded."""
        self.clock = np.concatenate([[0.0], np.cumsum(np.maximum(np.diff(times), 0.0))])

    @property
    def length(self) -> float:
        """Time that the whole recording takes [s]."""
        return float(self.clock[-1])

    @property
    def instant(self) -> int:
        """Index of the last instant that is not later than the position."""
        return int(np.searchsorted(self.clock, self.position + 1e-9, side="right")) - 1

    def advance(self, seconds: float) -> None:
        """Move on by a wall-clock time [s]; stands still at the end, and goes on when more is recorded."""
        if self.playing:
            self.position = min(self.position + seconds * self.speed, self.length)

    def play_or_pause(self) -> None:
        """Stop, or go on: at the end from the start."""
        self.playing = not self.playing
        if self.playing and self.position >= self.length:
            self.position = 0.0


class RecordingPage:
    """Serves a recording; all viewers see the same moment, and each may choose it.

    Attributes:
        playback: where the viewers are.
        page: what they see.
    """

    def __init__(self, path: Path, address: Address, section: str = ""):
        """Serve the first instant, cut open by a section (see `SectionPlane.parse`) that viewers can change."""
        self._plane, self._problem = SectionPlane.parse(section) if section else None, ""
        self._recording = recording = read_recording(path)
        self.playback = Playback(recording.times)
        self._shown = -1
        self._last_look = time.monotonic()
        self._read_curves()
        axes = recording.axes_of_bodies
        content = PageScene(recording.scene, recording.body_surfaces, recording.planes, recording.actuators, axes)
        self.page = Page(address.host, address.port, address.token, content, instant_of(recording, 0))
        self._show_whole_scales()
        self._add_controls(self.page.server.gui, section)

    def tick(self, seconds: float) -> None:
        """Show what is due; `seconds` of wall-clock time have passed since the last call."""
        playback = self.playback
        if self._recording.outcome == UNFINISHED and time.monotonic() - self._last_look > SECONDS_BETWEEN_LOOKS:
            self._look_for_more()
        playback.advance(seconds)
        if playback.instant != self._shown:
            self._shown = playback.instant
            self._show(self._shown)

    def serve(self) -> None:
        """Serve until Ctrl and c."""
        last = time.monotonic()
        while True:
            now = time.monotonic()
            self.tick(now - last)
            last = now
            time.sleep(max(0.0, 1.0 / INSTANTS_PER_SECOND - (time.monotonic() - now)))

    def close(self) -> None:
        """End the page."""
        self.page.server.stop()
        self._recording.close()

    def _show(self, number: int) -> None:
        shown = instant_of(self._recording, number)
        section = None
        if self._plane is not None:
            plane = self._plane.facing(self.page.view.eye)
            section = cut_open(self._recording, self._recording.surfaces, number, plane)
        self.page.view.show(shown, section)
        status = f"**{shown.time:.2f} s** of {self._recording.path.name} · {self._recording.outcome}"
        self.page.set_status(self._problem or status, shown)
        self._slider.value = self.playback.position
        past = self._plotted <= number
        signals = {name: values[past] for name, values in self._signals.items()}
        self.page.curves.show(self.playback.clock[self._plotted[past]], self._rows[past], signals)

    def _look_for_more(self) -> None:
        self._last_look = time.monotonic()
        self._recording.refresh()
        self._shown = -1
        self.playback.extend(self._recording.times)
        self._read_curves()
        self._slider.max = max(self.playback.length, self._slider.step)

    def _show_whole_scales(self) -> None:
        """Let the scales reach over the whole run, as in its pictures; later instants widen them."""
        recording = self._recording
        sampled = sample_instants(range(recording.instant_count), SAMPLES)
        forces = [np.linalg.norm(recording.contacts(number)[1], axis=1).max(initial=0.0) for number in sampled]
        efforts = {}
        for kind in ACTUATOR_KINDS:
            along = recording.segment_efforts(kind, np.array(sampled)) if kind.drawn == "lines" else []
            own = [recording.column(kind.effort.name)] if kind.drawn == "walls" else along
            efforts[kind.name] = np.concatenate([np.zeros(1), *(one.ravel() for one in own)])
        self.page.view.reach_to(efforts, max(forces, default=0.0))

    def _read_curves(self) -> None:
        """Read what the plots show, of as many instants as they can hold."""
        count = self._recording.instant_count
        self._plotted = np.unique(np.linspace(0, count - 1, min(count, MOST_POINTS)).astype(int))
        self._rows = _plotted(self._recording, self._plotted)
        self._rows[:, -1] -= _plotted(self._recording, self._recording.lift_start)[-1]
        signals = self._recording.column("signals")[self._plotted]
        self._signals = {name: signals[:, number] for number, name in enumerate(self._recording.signals)}

    def _add_controls(self, gui: Any, section: str) -> None:
        playback = self.playback
        step = max(self._recording.step_size * self._recording.every, 1e-3)
        with gui.add_folder("playback", order=1.0):
            self._slider = gui.add_slider("time [s]", 0.0, max(playback.length, step), step, 0.0)
            play = gui.add_button("play, and pause")
            speed = gui.add_slider("speed [x real time]", *SPEEDS, 0.05, 1.0)
            plane = gui.add_text("section", section, hint="a plane that cuts bodies open [mm]: y=0, z<12.5, x+2*y=30")
        gui.add_command("space: play, and pause", hotkey="space").on_trigger(lambda _: playback.play_or_pause())
        play.on_click(lambda _: playback.play_or_pause())

        @self._slider.on_update
        def _(event: Any) -> None:
            if event.client is not None:  # otherwise it followed the playback
                playback.playing = False
                playback.position = clamped(self._slider.value, (0.0, playback.length))

        @plane.on_update
        def _(event: Any) -> None:
            try:
                self._plane, self._problem = SectionPlane.parse(plane.value) if plane.value.strip() else None, ""
            except MeshError as error:  # most often of a plane that is still being written
                self._problem = str(error)
            self._shown = -1

        @speed.on_update
        def _(event: Any) -> None:
            playback.speed = clamped(speed.value, SPEEDS)


def instant_of(recording: Recording, number: int) -> PageInstant:
    """An instant of a recording."""
    lines = {
        kind.name: lines_shown(recording.line_points(kind, number), recording.segment_efforts(kind, number))
        for kind in ACTUATOR_KINDS
        if kind.drawn == "lines"
    }
    time, plotted = float(recording.row("time", number)), _plotted(recording, number)
    return PageInstant(time, recording.poses(number), lines, *recording.contacts(number), plotted)


def _plotted(recording: Recording, instants: Any) -> np.ndarray:
    efforts = [recording.read(kind.effort.name, instants) for kind in ACTUATOR_KINDS]
    figures = {figure.name: recording.figure(figure, instants) for figure in ON_PAGE}
    places = recording.read("rigid_position", instants)
    return plotted_row(recording.scene, np.concatenate(efforts, axis=-1), figures, places)
