"""Keys typed in the terminal in which the run was started."""

import codecs
import os
import re
import select
import signal
import sys
import termios
import threading
from collections.abc import Callable
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from taichisoft.base import warn_caller
from taichisoft.control import KeyEvent
from taichisoft.errors import ControllerFailed
from taichisoft_controllers.terminal_mode import TerminalMode

if TYPE_CHECKING:
    from taichisoft.running import Session

# Key events from the bytes that a terminal sends: characters, control codes and escape sequences.

ESCAPE = "\x1b"

# CSI ("ESC [", parameters, a final character) or SS3 ("ESC O", a modifier in old terminals, a final character).
# With one more ESC before it, Alt was held. The Linux console sends "ESC [ [ A" for its function keys.
_SEQUENCE = re.compile(
    r"(?P<alt>\x1b?)\x1b(?:\[(?P<parameters>[0-?]{0,64})[ -/]{0,4}(?:\[[A-E]|(?P<csi>[@-Z\\-~]))"
    r"|O(?P<modifier>[0-9;]{0,8})(?P<ss3>[@-~]))"
)
_UNFINISHED_SEQUENCE = re.compile(r"\x1b?\x1b(?:\[[0-?]{0,64}[ -/]{0,4}\[?|O[0-9;]{0,8})?")

_ARROWS = {"A": "up", "B": "down", "C": "right", "D": "left"}
# The keypad in its application mode, which some programs leave switched on.
_KEYPAD = dict(zip("jklmnopqrstuvwxy", "*+,-./0123456789", strict=True)) | {"M": "enter", "X": "="}
_CHARACTERS = {
    " ": KeyEvent("space"),
    "\r": KeyEvent("enter"),
    "\n": KeyEvent("enter"),
    "\t": KeyEvent("tab"),
    "\x7f": KeyEvent("backspace"),
    "\b": KeyEvent("backspace"),
    ESCAPE: KeyEvent("escape"),
    "\0": KeyEvent("space", ctrl=True),
    "\x1f": KeyEvent("-", ctrl=True),  # what most terminals send for Ctrl and -, and also for Ctrl and _
}
# Bits of a modifier parameter, which is 1 plus them: Alt, super, hyper and meta make other keys of a key.
_CONTROL, _OTHERS = 4, 2 | 8 | 16 | 32


class KeyParser:
    """Turns bytes into key events; what is cut off in the middle of a sequence waits for the rest.

    Combinations with Alt, function keys and other sequences that have no name in `KeyEvent` are left out.
    """

    def __init__(self) -> None:
        self._decoder = codecs.getincrementaldecoder("utf-8")("replace")
        self._waiting = ""

    @property
    def is_waiting(self) -> bool:
        """Whether there is the beginning of a sequence, or an Esc that may be one."""
        return bool(self._waiting)

    def feed(self, received: bytes) -> list[KeyEvent]:
        """Return the keys that are complete with what was received."""
        self._waiting += self._decoder.decode(received)
        events = []
        while self._waiting and not _UNFINISHED_SEQUENCE.fullmatch(self._waiting):
            event = self._take_one()
            if event is not None:
                events.append(event)
        return events

    def flush(self) -> list[KeyEvent]:
        """Give up waiting for the rest of a sequence, since nothing followed: an Esc alone is the key."""
        waiting, self._waiting = self._waiting, ""
        return [KeyEvent("escape")] if waiting in (ESCAPE, 2 * ESCAPE) else []

    def _take_one(self) -> KeyEvent | None:
        sequence = _SEQUENCE.match(self._waiting)
        if sequence is not None:
            self._waiting = self._waiting[sequence.end() :]
            return None if sequence["alt"] else _event_of_sequence(sequence)
        # Alt and a key, or the wreck of a sequence: neither is the Esc that ends a run.
        with_alt = self._waiting[0] == ESCAPE and self._waiting[1] != ESCAPE
        taken, self._waiting = self._waiting[: 1 + with_alt], self._waiting[1 + with_alt :]
        return None if with_alt else _event_of_character(taken)


def _event_of_sequence(sequence: re.Match[str]) -> KeyEvent | None:
    if sequence["ss3"] in _KEYPAD:
        return KeyEvent(_KEYPAD[sequence["ss3"]])
    final = sequence["ss3"] or sequence["csi"]
    if final in ("a", "b", "c", "d") and not sequence["parameters"]:  # rxvt: SS3 with Ctrl, CSI with shift
        return KeyEvent(_ARROWS[final.upper()], ctrl=bool(sequence["ss3"]))
    parameters = _numbers(sequence["parameters"] or f"1;{sequence['modifier'] or ''}")
    modifier = parameters[1] if len(parameters) > 1 else 1
    if final in _ARROWS:
        return _modified(KeyEvent(_ARROWS[final]), modifier)
    if final == "u":  # "ESC [ 43 ; 5 u" is Ctrl and +
        return _modified(_event_of_code(parameters[0]), modifier)
    if final == "~" and len(parameters) == 3 and parameters[0] == 27:  # "ESC [ 27 ; 5 ; 43 ~" is the same in xterm
        return _modified(_event_of_code(parameters[2]), modifier)
    return None


def _numbers(parameters: str) -> list[int]:
    """The parameters without their sub-parameters; 1 where one is missing."""
    texts = [part.partition(":")[0] for part in parameters.split(";")]
    return [int(text) if text.isdecimal() else 1 for text in texts]


def _modified(event: KeyEvent | None, modifier: int) -> KeyEvent | None:
    if event is None or modifier - 1 & _OTHERS:
        return None
    return KeyEvent(event.key, ctrl=event.ctrl or bool(modifier - 1 & _CONTROL))


def _event_of_code(code: int) -> KeyEvent | None:
    return _event_of_character(chr(code)) if code < 0x110000 else None


def _event_of_character(character: str) -> KeyEvent | None:
    if character in _CHARACTERS:
        return _CHARACTERS[character]
    if character < " ":  # the code of a letter or sign without its upper bits
        return KeyEvent(chr(ord(character) | (0x60 if character < ESCAPE else 0x40)), ctrl=True)
    return KeyEvent(character) if character.isprintable() and character != "\ufffd" else None


# Keys from the terminal of a run: from its beginning to its end the terminal hands them over one by one.

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


# The source of a run's keys: the terminal in which the run was started.

_sources: dict[int, Any] = {}


def begin_keys(session: "Session") -> None:
    """Read keys from the terminal for a run with an interactive controller, unless an earlier session gives them."""
    if session.replaying or not session.controller.interactive:
        return
    outputs_give_keys = any(output.gives_keys for output in session.outputs)
    if sys.stdin is None or not sys.stdin.isatty():
        if not outputs_give_keys:
            warn_caller("standard input is not a terminal, so no keys come from there; Ctrl and c ends the run")
        return
    if find_spec("termios") is None:  # as on Windows
        if not outputs_give_keys:
            raise ControllerFailed(
                "keys from the terminal need Linux or macOS; steer by the web page (--web), repeat a session (--keys), "
                "or take a controller that needs no keys (scripted, closed-loop)"
            )
        return

    _sources[id(session)] = TerminalKeys(session, sys.stdin.fileno())


def end_keys(session: "Session") -> None:
    """Give the terminal back."""
    source = _sources.pop(id(session), None)
    if source is not None:
        source.end()
