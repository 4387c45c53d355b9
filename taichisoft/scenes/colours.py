"""Colours as scenes and options write them: "#rrggbb"."""

import re
from typing import Annotated, Any

from pydantic import BeforeValidator


def red_green_blue(colour: str) -> tuple[float, float, float]:
    """Red, green and blue [-], each from 0 to 1, of a colour that is written "#rrggbb".

    Raises:
        ValueError: it is written otherwise; the message says how it must be.
    """
    if not isinstance(colour, str) or not re.fullmatch("#[0-9a-fA-F]{6}", colour):
        raise ValueError(f'{colour!r} must be written #rrggbb in hexadecimal digits, as "#c8321e"')
    red, green, blue = (byte / 255 for byte in bytes.fromhex(colour[1:]))
    return red, green, blue


def _checked(value: Any) -> Any:
    red_green_blue(value)
    return value


Colour = Annotated[str, BeforeValidator(_checked)]
"""A colour in a table of a scene."""
