"""Key events from the bytes that a terminal sends: characters, control codes and escape sequences."""

import codecs
import re

from taichisoft.control import KeyEvent

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
