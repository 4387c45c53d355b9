"""Moments of a run: the state is constant while a scene's code runs, so that provided values are cached."""

from collections.abc import Iterator
from contextlib import contextmanager

_moments: list[object] = []


@contextmanager
def frozen_time() -> Iterator[None]:
    """Context within which the state is constant."""
    _moments.append(_moments[-1] if _moments else object())
    try:
        yield
    finally:
        _moments.pop()


def now() -> object | None:
    """The present moment, a new object for each; None if the state may change at any time."""
    return _moments[-1] if _moments else None
