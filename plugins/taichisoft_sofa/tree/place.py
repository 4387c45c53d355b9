"""Lines of a scene's code, and the generation of SOFA's Python for which it is written."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType
from typing import NamedTuple

# Moments of a run: the state is constant while a scene's code runs, so that provided values are cached.

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


PACKAGE = __name__.partition(".")[0]
# Global variable of a module with its origin.
ORIGIN = "__sofa_origin__"


class Place(NamedTuple):
    """A line of a file."""

    file: str
    line: int

    def __str__(self) -> str:
        return f"{self.file}, line {self.line}"


@dataclass(frozen=True)
class ModuleOrigin:
    """Origin of a module loaded for a scene.

    Attributes:
        of_scene: whether the module is in the scene's own folder and not part of a library.
        older: whether the module is written for SofaPython, the generation before SofaPython3.
    """

    of_scene: bool
    older: bool


def here() -> Place | None:
    """Line being executed: in the scene's own files if possible, else in a library, else outside this package."""
    library = outside = None
    for frame in _frames_outside():
        origin = frame.f_globals.get(ORIGIN)
        if isinstance(origin, ModuleOrigin) and origin.of_scene:
            return _place(frame)
        if isinstance(origin, ModuleOrigin) and library is None:
            library = _place(frame)
        if outside is None:
            outside = _place(frame)
    return library or outside


def asked_by_older_code() -> bool:
    """Whether the calling code is written for SofaPython, the generation before SofaPython3."""
    frame: FrameType | None = sys._getframe(1)
    while frame is not None and _is_ours(frame):
        frame = frame.f_back
    origin = frame.f_globals.get(ORIGIN) if frame else None
    return isinstance(origin, ModuleOrigin) and origin.older


def _place(frame: FrameType) -> Place:
    return Place(frame.f_code.co_filename, frame.f_lineno)


def _frames_outside() -> Iterator[FrameType]:
    """Frames of callers outside this package, innermost first."""
    frame: FrameType | None = sys._getframe(1)
    while frame is not None:
        if not _is_ours(frame):
            yield frame
        frame = frame.f_back


def _is_ours(frame: FrameType) -> bool:
    return str(frame.f_globals.get("__name__", "")).startswith(f"{PACKAGE}.")
