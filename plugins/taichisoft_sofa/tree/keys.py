"""The characters by which SOFA calls keys."""

import string

# The names of Sofa.constants.Key, and the character that a controller is given for each.
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
    """The character that a controller is given for a key: by its name (`uparrow`, or just `up`), or typed.

    Letters are given as capitals, whether or not they were typed as such; a key that SOFA has no character for is none.
    """
    for name in (key, f"{key}arrow"):
        if name in KEYS:
            return KEYS[name]
    return key.upper() if len(key) == 1 else None
