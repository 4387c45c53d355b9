"""Pictures taken by a key during a run, drawn from the present state in other processes."""

import os
import queue
import sys
import threading
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from taichisoft.caller_warnings import warn_caller
from taichisoft_outputs.recording.recording_output import RecordingOutput
from taichisoft_outputs.rendering.render import render_pictures

if TYPE_CHECKING:
    from taichisoft.model import Model
    from taichisoft.session import Session
    from taichisoft.state import State

MOST_WAITING = 8
"""Most pictures that may wait: a held key repeats, and does not mean hundreds of pictures."""

_takers: dict[int, "PictureTaker"] = {}


def take_picture(session: "Session") -> None:
    """Have the present state drawn into the run's folder, as `picture_1_at_2.50s.png` and so on; returns at once."""
    if session.folder is None:
        warn_caller("no picture: this run has no folder to put it in")
        return
    taker = _takers.setdefault(id(session), PictureTaker(session.folder))
    taker.take(session.simulation.model, session.simulation.state)


def finish_pictures(session: "Session") -> None:
    """Wait for the pictures of a session that are not done."""
    taker = _takers.pop(id(session), None)
    if taker is not None:
        taker.finish()


class PictureTaker:
    """Draws one picture after the other in a thread and child processes; what goes wrong is a warning."""

    def __init__(self, folder: Path):
        self._folder = folder
        self._count = 0
        self._jobs: queue.SimpleQueue[tuple[str, Model, State] | None] = queue.SimpleQueue()
        # Not to be waited for by an interpreter that ends: `finish` does that, and an impatient user may stop it.
        self._thread = threading.Thread(target=self._work, name="pictures", daemon=True)

    def take(self, model: "Model", state: "State") -> None:
        """Have a state drawn; never waits. A state does not change, so there is nothing to copy."""
        if self._jobs.qsize() >= MOST_WAITING:
            warn_caller(f"no picture at {state.time:.2f} s: {MOST_WAITING} others are not drawn yet")
            return
        if not self._thread.is_alive():
            self._thread.start()
        self._count += 1
        self._jobs.put((f"picture_{self._count}_at_{state.time:.2f}s", model, state))

    def finish(self) -> None:
        """Wait until all are drawn."""
        self._jobs.put(None)
        self._thread.join()

    def _work(self) -> None:
        if sys.platform == "linux":
            os.nice(10)  # there of this thread and the children it starts: the run comes first
        while (job := self._jobs.get()) is not None:
            name, model, state = job
            try:
                self._draw(name, model, state)
            except Exception as error:  # no caller of a thread could report it
                warn_caller(f"no picture {self._folder / name}.png: {error}")

    def _draw(self, name: str, model: "Model", state: "State") -> None:
        """Draw a state from a recording of a single frame, since the drawing process reads recordings."""
        with TemporaryDirectory(prefix="taichisoft-picture-") as folder:
            recording = RecordingOutput(Path(folder))
            recording.begin(model, state)
            recording.end("picture")
            render_pictures(recording.path, {name: state.time}, self._folder)
