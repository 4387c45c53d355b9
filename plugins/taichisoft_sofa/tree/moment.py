"""Moments of a run: while a scene's code runs nothing moves, so that what a run provides is asked for once."""

from collections.abc import Iterator
from contextlib import contextmanager

_moments: list[object] = []


@contextmanager
def one_moment() -> Iterator[None]:
    """Until the end of this context nothing moves."""
    _moments.append(_moments[-1] if _moments else object())
    try:
        yield
    finally:
        _moments.pop()


def now() -> object | None:
    """The present moment, another object each time; None where things may move at any time."""
    return _moments[-1] if _moments else None
