"""What can go wrong with a page."""

import importlib.util

from taichisoft.errors import TaichisoftError


class WebError(TaichisoftError):
    """A web page cannot be served."""


def require_viser() -> None:
    """Raise WebError, which says what to install, unless viser is there."""
    if importlib.util.find_spec("viser") is None:
        raise WebError("a web page needs the package viser, which is not installed; run: pip install 'taichisoft[web]'")
