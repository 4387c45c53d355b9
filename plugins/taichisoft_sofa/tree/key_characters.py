"""SOFA's characters of keys."""

import string

# The names of Sofa.constants.Key, and the characters passed to controllers.
KEYS = {
    "leftarrow": chr(18),
    "uparrow": chr(19),
    "rightarrow": chr(20),
    "downarrow": chr(21),
    "space": " ",
    "plus": "+",
    "minus": "-",
    "star": "*",
    "slash": "/",
    "equal": "=",
    **{letter: letter for letter in string.ascii_uppercase},
    **{f"KP_{digit}": digit for digit in string.digits},
}


def character(key: str) -> str | None:
    """The character passed to controllers for a key, given by name (`uparrow` or `up`) or as typed; None if unknown.

    Letters are passed as capitals, however they were typed. SOFA has no character for some keys.
    """
    for name in (key, f"{key}arrow"):
        if name in KEYS:
            return KEYS[name]
    return key.upper() if len(key) == 1 else None
