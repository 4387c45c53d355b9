"""What the console of Windows gives for keys; the reading itself needs Windows."""

import pytest

from taichisoft_controllers.windows_keys import key_events


@pytest.mark.parametrize(
    ("character", "code", "keys"),
    [
        ("+", "", ["+"]),
        ("é", "", ["é"]),
        (" ", "", ["space"]),
        ("\r", "", ["enter"]),
        ("\x1b", "", ["escape"]),  # at once: no sequence begins with it here
        ("\x01", "", ["Ctrl+a"]),
        ("\xe0", "H", ["up"]),
        ("\xe0", "K", ["left"]),
        ("\xe0", "\x8d", ["Ctrl+up"]),
        ("\xe0", "t", ["Ctrl+right"]),
        ("\0", ";", []),  # F1
    ],
)
def test_keys_of_the_windows_console(character: str, code: str, keys: list[str]) -> None:
    assert [str(event) for event in key_events(character, code)] == keys
