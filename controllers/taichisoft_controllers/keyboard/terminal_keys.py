"""Keys from the terminal of a run: from its beginning to its end the terminal hands them over one by one."""

import os
import select
import signal
import termios
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from taichisoft.control import KeyEvent
from taichisoft_controllers.keyboard.key_parser import KeyParser
from taichisoft_controllers.keyboard.terminal_mode import TerminalMode

if TYPE_CHECKING:
    from taichisoft.session import Session

ESCAPE_TIME = 0.15
"""Pause after an Esc [s] that makes it the key, not the beginning of an arrow's sequence."""
BACKGROUND_TIME = 0.2
"""Interval at which a run in the background looks whether it is in the foreground again [s]."""

Handler = Callable[[int, Any], Any] | int | None


class TerminalKeys:
    """Puts the keys of a terminal into a run's stream, by a thread of its own.

    The terminal is put back by `end`, by Ctrl and z (`fg` goes on), at the exit of the process, and by the child of
    `TerminalMode` if it is killed.
    """

    def __init__(self, session: "Session", file_descriptor: int):
        """Switch the terminal to the mode for keys and begin to read.

        Args:
            session: the run that gets the keys, and is stopped when the terminal has gone.
            file_descriptor: the terminal's.

        Raises:
            termios.error: the file is not a terminal, or the terminal has gone.
        """
        self._session = session
        self._fd = file_descriptor
        self._mode = TerminalMode(file_descriptor)
        self._handlers: dict[int, Handler] = {}
        self._end_reader, self._end_writer = os.pipe()
        self._reader = threading.Thread(target=self._read, name="terminal keys", daemon=True)
        try:
            self._handle_signals()
            self._mode.begin_keys()
        except BaseException:
            self.end()
            raise
        self._reader.start()

    def end(self) -> None:
        """Stop reading and put the terminal back."""
        os.close(self._end_writer)
        if self._reader.ident is not None:
            self._reader.join()
        os.close(self._end_reader)
        for number, handler in self._handlers.items():
            signal.signal(number, handler)
        self._mode.end()

    def _handle_signals(self) -> None:
        """Handle suspension, continuation and hang-up; signals that the process ignores stay ignored.

        Python calls handlers in the main thread alone, and lets no other set them.
        """
        if threading.current_thread() is not threading.main_thread():
            return
        for number, handler in (
            (signal.SIGTSTP, self._suspend),
            (signal.SIGCONT, self._resume),
            (signal.SIGHUP, self._hang_up),
        ):
            if signal.getsignal(number) not in (signal.SIG_IGN, None):
                self._handlers[number] = signal.signal(number, handler)

    def _suspend(self, number: int, _frame: Any) -> None:
        self._mode.end_keys()
        signal.signal(number, signal.SIG_DFL)
        signal.raise_signal(number)  # the process stops here until it is continued
        signal.signal(number, self._suspend)
        self._resume()

    def _resume(self, *_: Any) -> None:
        """Switch to the mode for keys: the shell had the terminal in between, so it may be in any mode."""
        try:
            self._mode.begin_keys()
        except termios.error:
            self._session.stop()

    def _hang_up(self, *_: Any) -> None:
        self._session.stop()

    def _read(self) -> None:
        """Read keys until the end of the run; runs in the thread."""
        parser = KeyParser()
        while True:
            ready = self._wait(ESCAPE_TIME if parser.is_waiting else None)
            if self._end_reader in ready:
                return
            if not self._mode.is_for_keys:
                self._look_for_foreground()
                continue
            events = self._receive(parser) if ready else parser.flush()
            if events is None:
                self._session.stop()  # no user is left who could end it
                return
            for event in events:
                self._pass_on(event)

    def _wait(self, seconds: float | None) -> list[int]:
        """Wait for something to read and return it: the end of the run, or the terminal if this process has it."""
        if self._mode.is_for_keys:
            return select.select([self._end_reader, self._fd], [], [], seconds)[0]
        return select.select([self._end_reader], [], [], BACKGROUND_TIME)[0]

    def _receive(self, parser: KeyParser) -> list[KeyEvent] | None:
        """Return the keys that have arrived; None when the terminal has gone."""
        try:
            received = os.read(self._fd, 1024)
        except OSError:
            return None
        return parser.feed(received) if received else None

    def _look_for_foreground(self) -> None:
        """Notify the main thread of `fg` after `bg`, for which the shell sends no signal."""
        if self._mode.is_in_foreground and signal.SIGCONT in self._handlers:
            os.kill(os.getpid(), signal.SIGCONT)

    def _pass_on(self, event: KeyEvent) -> None:
        if event == KeyEvent("c", ctrl=True):  # from a terminal that sends keys as numbers, and so no signal
            os.kill(os.getpid(), signal.SIGINT)
        else:
            self._session.keys.put(event)
