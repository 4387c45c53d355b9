"""Handling of the keys of a run: keys of the run itself, and keys for the controller."""

from collections.abc import Callable, Iterator

from taichisoft.control.keys import KeyEvent
from taichisoft.plugin_system.hooks import notify
from taichisoft.session.key_log import FILE_NAME, KeyLog
from taichisoft.session.session import BINDINGS, Session

# Keys that change when steps are made, but not which steps; a replay ignores them.
WAITING_KEYS = ("space", "s")


class KeyHandling:
    """Handles the keys of a session between two steps, and writes its key log."""

    def __init__(self, session: Session, pass_to_controller: Callable[[KeyEvent], None], restart: Callable[[], None]):
        """Prepare; the key log of an interactive run is made at once, other logs with the first key.

        Raises:
            KeyLogError: the log cannot be written.
        """
        self._session = session
        self._pass_to_controller = pass_to_controller
        self._actions: dict[str, Callable[[], None]] = {
            "space": self._toggle_pause,
            "s": self._make_single_step,
            "r": restart,
            "p": lambda: notify("taichisoft_picture_wanted", session=session),
            "?": self._show_help,
            "escape": session.stop,
        }
        assert self._actions.keys() == BINDINGS.keys()
        self._log: KeyLog | None = None
        if session.controller.interactive:
            self._open_log()

    def handle_keys(self) -> None:
        """Handle the keys since the last call."""
        for event in self._new_events():
            self._session.recent_keys.append(event)
            action = self._actions.get(event.key) if event.value is None else None
            if action is not None:
                action()
            else:
                self._pass_to_controller(event)

    def end(self) -> None:
        """Close the log with the number of steps made."""
        if self._log is not None:
            self._log.end(self._session.steps_made)

    def _new_events(self) -> Iterator[KeyEvent]:
        """Keys in their order; keys of a replayed log are written again, keys pressed during a replay are not."""
        session = self._session
        pressed = session.keys.take()
        if session.replay is None:
            for event in pressed:
                self._write(event)
                yield event
            return
        for event in session.replay.take(session.steps_made):
            self._write(event)
            if event.value is not None or event.key not in WAITING_KEYS:
                yield event
        yield from (event for event in pressed if event.value is None and event.key in BINDINGS and event.key != "r")

    def _write(self, event: KeyEvent) -> None:
        if self._log is None:
            self._open_log()
        if self._log is not None:
            self._log.add(self._session.steps_made, event)

    def _open_log(self) -> None:
        if self._session.folder is not None:
            self._log = KeyLog(self._session.folder / FILE_NAME)

    def _toggle_pause(self) -> None:
        self._session.paused = not self._session.paused

    def _make_single_step(self) -> None:
        self._session.paused = True
        self._session.single_steps += 1

    def _show_help(self) -> None:
        self._session.shows_help = not self._session.shows_help
