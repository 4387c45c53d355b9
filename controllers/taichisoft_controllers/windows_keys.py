"""Keys from the console of Windows, which hands them over one by one without being told to."""

import sys
import threading

from taichisoft.control.keys import KeyEvent, KeyStream
from taichisoft_controllers.key_parser import KeyParser

POLLING_TIME = 0.02
"""How often the console is asked whether there is a key [s]."""

SPECIAL = ("\0", "\xe0")
"""What comes before the code of a key that types nothing."""

_ARROWS = {"H": "up", "P": "down", "K": "left", "M": "right"}
_ARROWS_WITH_CTRL = {"\x8d": "up", "\x91": "down", "s": "left", "t": "right"}


class WindowsKeys:
    """Puts the keys of the console into a run's stream."""

    def __init__(self, keys: KeyStream):
        """Begin to read."""
        self._keys = keys
        self._ends = threading.Event()
        self._reader = threading.Thread(target=self._read, name="console keys", daemon=True)
        self._reader.start()

    def end(self) -> None:
        """Stop reading."""
        self._ends.set()
        self._reader.join()

    def _read(self) -> None:
        if sys.platform == "win32":
            import msvcrt

            while not self._ends.wait(POLLING_TIME):
                while msvcrt.kbhit():
                    character = msvcrt.getwch()
                    code = msvcrt.getwch() if character in SPECIAL else ""
                    for event in key_events(character, code):
                        self._keys.put(event)


def key_events(character: str, code: str = "") -> list[KeyEvent]:
    """The key that the console gives as a character, or as a code after one of `SPECIAL`; empty if it has no name."""
    if code:
        ctrl = code in _ARROWS_WITH_CTRL
        name = _ARROWS_WITH_CTRL.get(code) or _ARROWS.get(code)
        return [KeyEvent(name, ctrl)] if name else []
    if character == "\x1b":
        return [KeyEvent("escape")]
    return KeyParser().feed(character.encode("utf-8", "replace"))
