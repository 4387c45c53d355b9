"""Keys from the terminal of a run: from its beginning to its end the terminal hands them over one by one."""

import os
import select
import signal
import threading
from collections.abc import Callable
from typing import Any, Protocol

from taichisoft.control.keys import KeyEvent, KeyStream
from taichisoft_controllers.keyboard.key_parser import KeyParser
from taichisoft_controllers.keyboard.terminal_mode import TerminalMode

ESCAPE_TIME = 0.15
"""An Esc that nothing follows for so long [s] is the key, not the beginning of an arrow's sequence."""
BACKGROUND_TIME = 0.2
"""How often a run in the background looks whether it is in the foreground again [s]."""

Handler = Callable[[int, Any], Any] | int | None


class RunWithKeys(Protocol):
    """What is needed of a `taichisoft.session.session.Session`."""

    keys: KeyStream

    def stop(self) -> None:
        """End the run; from any thread."""


class TerminalKeys:
    """Puts the keys of the terminal on standard input into a run's stream.

    The terminal is put back by `end`, by Ctrl and z (`fg` goes on), at the exit of the process, and by
    `terminal_guardian` if it is killed.
    """

    def __init__(self, run: RunWithKeys, file_descriptor: int):
        """Switch the terminal to the mode for keys and begin to read.

        Raises:
            OSError: it is no terminal, or has gone.
        """
        self._run = run
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
        """Python calls handlers in the main thread alone, and lets no other set them.

        What the process was told to ignore stays ignored.
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
        signal.raise_signal(number)  # stands still here until somebody continues it
        signal.signal(number, self._suspend)
        self._resume()

    def _resume(self, *_: Any) -> None:
        """The shell had the terminal in between, so it may be in any mode."""
        try:
            self._mode.begin_keys()
        except OSError:
            self._run.stop()

    def _hang_up(self, *_: Any) -> None:
        self._run.stop()

    def _read(self) -> None:
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
                self._run.stop()  # there is nobody any more who could end it
                return
            for event in events:
                self._pass_on(event)

    def _wait(self, seconds: float | None) -> list[int]:
        """What can be read: the end of the run, or the terminal if this process has it."""
        if self._mode.is_for_keys:
            return select.select([self._end_reader, self._fd], [], [], seconds)[0]
        return select.select([self._end_reader], [], [], BACKGROUND_TIME)[0]

    def _receive(self, parser: KeyParser) -> list[KeyEvent] | None:
        """The keys of what has arrived; None when the terminal has gone."""
        try:
            received = os.read(self._fd, 1024)
        except OSError:
            return None
        return parser.feed(received) if received else None

    def _look_for_foreground(self) -> None:
        """`fg` after `bg` continues nothing, since nothing stands still: so the main thread is told here."""
        if self._mode.is_in_foreground and signal.SIGCONT in self._handlers:
            os.kill(os.getpid(), signal.SIGCONT)

    def _pass_on(self, event: KeyEvent) -> None:
        if event == KeyEvent("c", ctrl=True):  # from a terminal that sends keys as numbers, and so no signal
            os.kill(os.getpid(), signal.SIGINT)
        else:
            self._run.keys.put(event)
