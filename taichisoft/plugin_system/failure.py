"""Errors of plug-ins: one line, and the plug-in's own traceback."""

import importlib
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType

from taichisoft.errors import PluginError, PluginFailed, TaichisoftError

# Frames of these files lead to a plug-in, and are left out of its traceback.
OUTSIDE = (str(Path(__file__).parents[1]), str(Path(importlib.__file__).parent), "<frozen importlib")


def plugin_failure(what: str, error: BaseException) -> PluginError:
    """One line about an exception that a plug-in did not expect, with the place in it; to be raised from it."""
    if isinstance(error, TaichisoftError):
        return PluginError(f"{what}: {error}")
    message = " ".join(str(error).split())
    return PluginFailed(f"{what}: {type(error).__name__}{': ' if message else ''}{message}{_place(error)}")


@contextmanager
def failures_of(what: str) -> Iterator[None]:
    """Turn unexpected exceptions of a plug-in into a `PluginFailed` that begins with `what`.

    sys.exit() in a plug-in is one, too, so that a run ends with complete outputs; Ctrl and c passes, and so do
    warnings that the user makes errors.
    """
    try:
        yield
    except (TaichisoftError, KeyboardInterrupt, Warning):
        raise
    except BaseException as error:
        raise plugin_failure(what, error) from error


def plugin_traceback(error: TaichisoftError) -> str:
    """The traceback of an exception of a plug-in, from its entry on, or empty."""
    cause = error.__cause__
    if not isinstance(error, PluginError) or cause is None:
        return ""
    own = _own_part(cause)
    if own is None and not isinstance(cause, SyntaxError):
        return ""
    return "".join(traceback.format_exception(type(cause), cause, own))


def _place(error: BaseException) -> str:
    """The innermost line of the file in which the plug-in was entered: libraries that it calls are not to blame."""
    frames = traceback.extract_tb(_own_part(error))
    if not frames or isinstance(error, SyntaxError):  # which has the place in its message
        return ""
    own = [frame for frame in frames if frame.filename == frames[0].filename]
    return f" ({Path(own[-1].filename).name}, line {own[-1].lineno})"


def _own_part(error: BaseException) -> TracebackType | None:
    """The traceback without the frames that lead to the plug-in; or None.

    The first frame is that of the function which called the plug-in and caught the error, under `failures_of` if it did
    so through that.
    """
    entered = error.__traceback__
    if entered is not None and entered.tb_frame.f_code is failures_of.__wrapped__.__code__:  # type: ignore[attr-defined]
        entered = entered.tb_next
    entered = entered and entered.tb_next
    while entered is not None and entered.tb_frame.f_code.co_filename.startswith(OUTSIDE):
        entered = entered.tb_next
    return entered
