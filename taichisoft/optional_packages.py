"""Packages that need not be installed: a missing one is one line that says what installs it."""

from importlib.util import find_spec

from taichisoft.errors import PackageMissing

WHOLE = "pip install taichisoft"
"""Command that installs what an installation of the engine alone has left out."""


def extra(name: str) -> str:
    """The command that installs an extra."""
    return f"pip install 'taichisoft[{name}]'"


def require(what: str, *modules: str, install: str = WHOLE) -> None:
    """See that modules can be imported, without importing them.

    Args:
        what: the thing that needs them, which begins the error.
        modules: import names.
        install: command that installs them.

    Raises:
        PackageMissing: one cannot be found.
    """
    missing = [module for module in modules if find_spec(module) is None]
    if missing:
        are = "is" if len(missing) == 1 else "are"
        raise PackageMissing(f"{what}: needs {' and '.join(missing)}, which {are} not installed: {install}")
