"""Warnings that point to the line of the user's program that led to them, and not to one in here."""

import sys
import warnings

_PACKAGES = ("taichisoft", "functools")
"""All import names of this project begin so; `functools` is between two of them where a value is cached."""


def warn_caller(line: str) -> None:
    """Warn, at the innermost call that no package of this project makes.

    Args:
        line: what is wrong, where, and what would be right.
    """
    frame, level = sys._getframe(1), 2
    while frame.f_back is not None and frame.f_globals.get("__name__", "").startswith(_PACKAGES):
        frame, level = frame.f_back, level + 1
    warnings.warn(line, stacklevel=level)
