"""Values of a style as they are written on a command line."""

import re

from taichisoft_plugins.drawing.style import StyleError


def parse_size(text: str) -> tuple[int, int]:
    """Width and height [pixels] from "1280x720".

    Raises:
        StyleError: it is written otherwise.
    """
    size = re.fullmatch(r"(\d{1,6})x(\d{1,6})", text.strip().lower())
    if size is None:
        raise StyleError(f"size '{text}' must be written as width x height in pixels, 1280x720")
    return int(size[1]), int(size[2])


def parse_point(name: str, text: str | None) -> tuple[float, float, float] | None:
    """A point [mm] from "300,-200,150"; None for none.

    Raises:
        StyleError: it is written otherwise; begins with `name`.
    """
    if text is None:
        return None
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        raise StyleError(f"{name} '{text}' must be three numbers in mm, as 300,-200,150") from None
    return x, y, z
