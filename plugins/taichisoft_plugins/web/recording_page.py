"""The page of a recording: to play, to scrub, and to follow while its run goes on."""

import time
from pathlib import Path
from typing import Any

import numpy as np

from taichisoft_plugins.recording.layout import RecordingError
from taichisoft_plugins.recording.reader import Recording, read_recording
from taichisoft_plugins.web.address import Address
from taichisoft_plugins.web.curves import MOST_POINTS, row_of
from taichisoft_plugins.web.page import Page
from taichisoft_plugins.web.playback import Playback
from taichisoft_plugins.web.recorded_frames import cast_of, frame_of

UNFINISHED = "unfinished"
FRAMES_PER_SECOND = 30.0
SECONDS_BETWEEN_LOOKS = 1.0
"""Into the file of a run that goes on."""
SECONDS_TO_CLOSE = 3.0
"""While a run closes its file, nobody can read it."""
SPEEDS = (0.05, 4.0)


class RecordingPage:
    """Serves a recording; all viewers see the same moment, and each may choose it.

    Attributes:
        playback: where they are.
        page: what they see.
    """

    def __init__(self, path: Path, address: Address):
        """Serve the first frame.

        Raises:
            RecordingError: the file is no recording, it has no frame yet, or positions were not recorded.
            WebError: nothing can listen at the address.
        """
        self._recording = recording = _opened(path)
        if recording.frame_count == 0:
            raise RecordingError(f"{path}: has no frame yet")
        self._cast = cast_of(recording)
        first = frame_of(recording, 0)
        self.playback = Playback(recording.times)
        self._shown = -1
        self._last_look = time.monotonic()
        self._read_curves()
        self.page = Page(address.host, address.port, self._cast, first)
        self._add_controls(self.page.server.gui)

    def tick(self, seconds: float) -> None:
        """So much wall-clock time [s] has passed since the last call: show what is due."""
        playback = self.playback
        if self._recording.outcome == UNFINISHED and time.monotonic() - self._last_look > SECONDS_BETWEEN_LOOKS:
            self._look_for_more()
        playback.advance(seconds)
        frame = playback.frame
        if frame != self._shown:
            self._shown = frame
            self._show(frame)

    def serve(self) -> None:
        """Until Ctrl and c."""
        last = time.monotonic()
        while True:
            now = time.monotonic()
            self.tick(now - last)
            last = now
            time.sleep(max(0.0, 1.0 / FRAMES_PER_SECOND - (time.monotonic() - now)))

    def close(self) -> None:
        """End the page."""
        self.page.server.stop()
        self._recording.close()

    def _show(self, frame: int) -> None:
        shown = frame_of(self._recording, frame)
        self.page.view.show(shown)
        self.page.say(f"**{shown.time:.2f} s** of {self._recording.path.name} · {self._recording.outcome}")
        self._slider.value = self.playback.position
        past = self._plotted <= frame
        self.page.curves.show(self.playback.clock[self._plotted[past]], self._rows[past])

    def _look_for_more(self) -> None:
        """Open the file anew: a run that ends writes more into it than frames."""
        self._last_look = time.monotonic()
        self._recording.close()  # first, since HDF5 would take what is open for the file of the same name
        self._recording = _opened(self._recording.path, SECONDS_TO_CLOSE)
        self._shown = -1
        self.playback.extend(self._recording.times)
        self._read_curves()
        self._slider.max = max(self.playback.length, self._slider.step)

    def _read_curves(self) -> None:
        """What the plots show of all frames, of as many as they can hold."""
        recording, count = self._recording, self._recording.frame_count
        self._plotted = np.unique(np.linspace(0, count - 1, min(count, MOST_POINTS)).astype(int))
        columns = [
            recording.column(name)[self._plotted] if recording.has(name) else np.zeros((len(self._plotted), 0))
            for name in ("pressure", "normal_force", "rigid_position")
        ]
        rows = [
            row_of(self._cast, _named(recording.cavities, pressure), _named(recording.pairs, force), place)
            for pressure, force, place in zip(*columns, strict=True)
        ]
        self._rows = np.array(rows)
        self._rows[:, -1] -= self._rows[0, -1]

    def _add_controls(self, gui: Any) -> None:
        playback = self.playback
        step = max(self._recording.step_size * self._recording.every, 1e-3)
        with gui.add_folder("playback", order=1.0):
            self._slider = gui.add_slider("time [s]", 0.0, max(playback.length, step), step, 0.0)
            play = gui.add_button("play, and pause")
            speed = gui.add_slider("speed [x real time]", *SPEEDS, 0.05, 1.0)
        gui.add_command("space: play, and pause", hotkey="space").on_trigger(lambda _: playback.play_or_pause())
        play.on_click(lambda _: playback.play_or_pause())

        @self._slider.on_update
        def _(event: Any) -> None:
            if event.client is not None:  # else it followed
                playback.playing = False
                playback.position = min(max(self._slider.value, 0.0), playback.length)

        @speed.on_update
        def _(event: Any) -> None:
            playback.speed = min(max(speed.value, SPEEDS[0]), SPEEDS[1])


def _opened(path: Path, patience: float = 0.0) -> Recording:
    """A recording whose frames are all there, also those that were written while it was opened.

    Raises:
        RecordingError: it cannot be read, not even after `patience` [s].
    """
    deadline = time.monotonic() + patience
    while True:
        try:
            recording = read_recording(path)
            break
        except RecordingError:
            if not path.is_file() or time.monotonic() > deadline:
                raise
            time.sleep(0.1)
    if recording.outcome == UNFINISHED:
        recording.refresh()
    return recording


def _named(names: list[str], values: np.ndarray) -> dict[str, float]:
    """Nothing where nothing was recorded; before the first step there are no values, which count as zero."""
    return dict(zip(names, np.nan_to_num(values).tolist(), strict=len(values) > 0))
