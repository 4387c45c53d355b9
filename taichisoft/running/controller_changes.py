"""Changes of a controller while the run goes on: tuned settings, and a newer version of its plug-in's file."""

import json
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from taichisoft.caller_warnings import warn_caller
from taichisoft.control.controller import Controller
from taichisoft.errors import TaichisoftError
from taichisoft.plugin_system.failure import failures_of
from taichisoft.plugin_system.plugins import plugin_files, reload_plugin
from taichisoft.running.controller_memory import saved_as_json
from taichisoft.session.session import Session

SECONDS_BETWEEN_LOOKS = 0.5
"""Wall-clock time between two looks at the files of the plug-in [s]."""
TUNED = "tuned settings"
"""What a controller remembers has the settings that were tuned under this name."""


def memory_as_json(session: Session) -> str:
    """What the session's controller remembers, with the settings that were tuned; empty where it does not save."""
    memory = saved_as_json(session.controller)
    return json.dumps({**json.loads(memory), TUNED: session.tuned}) if memory and session.tuned else memory


class ControllerChanges:
    """Makes the controller of a session anew when settings are tuned, or when the file of its plug-in was saved."""

    def __init__(self, session: Session):
        """Note what the files of the controller's plug-in are like now; only an interactive run looks at them."""
        self._session, self._waits = session, False
        self._plugin, self._stamp = "", _stamp(Path())
        self._next_look = 0.0
        if session.make_controller is not None and session.controller.interactive and not session.replaying:
            self._plugin = _plugin_of(session.controller)
            self._stamp = _stamp(plugin_files().get(self._plugin, Path()))

    def begin(self) -> None:
        """Reset the controller, and have it go on from what it remembered if the session says so."""
        session, self._waits = self._session, False
        saved = dict(session.saved) if session.saved is not None else None
        if saved is not None and TUNED in saved:
            session.tuned = {**saved.pop(TUNED), **session.tuned}
            if session.make_controller is not None:
                session.controller = self._made()
        controller = session.controller
        with failures_of(f"{_name(controller)} failed in reset()"):
            controller.reset(session.simulation.model)
        if saved is not None:
            with failures_of(f"{_name(controller)} failed in restore()"):
                controller.restore(saved)

    def begin_again(self) -> None:
        """As `begin`, by a newer version of the file if there is one that waits."""
        if self._waits:
            self._replace(None)
        self.begin()

    def tune(self, name: str, value: float) -> bool:
        """Take another value of a tunable setting; False where the controller has none of that name."""
        session = self._session
        if name not in session.controller.tunable or session.make_controller is None:
            return False
        slider, before = session.controller.tunable[name], dict(session.tuned)
        session.tuned[name] = min(max(value, slider.lowest), slider.highest)
        if not self._replace(self._memory()):
            session.tuned = before
        return True

    def look(self) -> None:
        """Load the plug-in anew if its file was saved: at once where the controller saves, else at the next start."""
        if not self._plugin or time.monotonic() < self._next_look:
            return
        self._next_look = time.monotonic() + SECONDS_BETWEEN_LOOKS
        stamp = _stamp(plugin_files().get(self._plugin, Path()))
        if stamp == self._stamp or not stamp:  # an editor that replaces a file removes it for a moment
            return
        self._stamp, memory = stamp, self._memory()
        try:
            reload_plugin(self._plugin)
        except TaichisoftError as error:
            self._say(f"the old version of plug-in '{self._plugin}' goes on: {error}")
            return
        if memory is None:
            self._waits = True
            self._say(f"plug-in '{self._plugin}' was loaded anew; its controller, which does not save, waits for r")
        elif self._replace(memory, is_tried=True):
            self._say(f"plug-in '{self._plugin}' was loaded anew, and its controller goes on")

    def _memory(self) -> Mapping[str, Any] | None:
        memory = saved_as_json(self._session.controller)
        return json.loads(memory) if memory else None

    def _replace(self, memory: Mapping[str, Any] | None, is_tried: bool = False) -> bool:
        """Put a new controller in the place of the old one, which stays if anything about the new one fails.

        With `is_tried` another one is asked first what it would do now, so that an error in `control` ends no run.
        """
        session = self._session
        try:
            if is_tried:
                trial = self._ready(memory)
                with failures_of(f"{_name(trial)} failed in control()"):
                    trial.control(session.simulation.observe())
            session.controller = self._ready(memory)
        except TaichisoftError as error:
            self._say(f"the old controller goes on: {error}")
            return False
        return True

    def _ready(self, memory: Mapping[str, Any] | None) -> Controller:
        """A new controller that goes on from what another one remembers."""
        with failures_of(f"{_name(self._session.controller)} cannot be made anew"):
            made = self._made()
        with failures_of(f"{_name(made)} failed in reset()"):
            made.reset(self._session.simulation.model)
        if memory is not None:
            with failures_of(f"{_name(made)} failed in restore()"):
                made.restore(memory)
        return made

    def _made(self) -> Controller:
        session = self._session
        assert session.make_controller is not None
        made = session.make_controller(session.tuned)
        if made.interactive != session.controller.interactive:
            made.interactive = session.controller.interactive
        return made

    def _say(self, text: str) -> None:
        # Without the time Python would not show the same text a second time.
        self._session.notice = " ".join(f"at {self._session.simulation.state.time:.6g} s: {text}".split())
        warn_caller(self._session.notice)


def _name(controller: Controller) -> str:
    return f"controller {type(controller).__module__}.{type(controller).__qualname__}"


def _plugin_of(controller: Controller) -> str:
    """Name of the plug-in in a file or folder that has the controller's class; "" for any other."""
    module = sys.modules.get(type(controller).__module__)
    place = Path(getattr(module, "__file__", None) or "/").resolve()
    return next((name for name, path in plugin_files().items() if path in (place, *place.parents)), "")


def _stamp(path: Path) -> tuple[tuple[str, int, int], ...]:
    """Names, times and sizes of the Python files of a plug-in."""
    files = sorted(path.rglob("*.py")) if path.is_dir() and path != Path() else [path] * path.is_file()
    found = []
    for file in files:
        try:
            status = file.stat()
        except OSError:
            continue
        found.append((str(file), status.st_mtime_ns, status.st_size))
    return tuple(found)
