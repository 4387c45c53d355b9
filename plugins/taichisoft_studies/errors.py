"""Packages that only studies need: one that is missing is one line that says how to install it."""

from importlib.util import find_spec

from taichisoft.errors import TaichisoftError

INSTALL = "pip install 'taichisoft[studies]'"
LARGE = {"torch": "pip install torch"}
"""Command that installs a package which is too large for the extra."""


class StudyError(TaichisoftError):
    """A study cannot be understood or done."""


def require(command: str, *modules: str) -> None:
    """See that modules can be imported, without importing them.

    Raises:
        StudyError: one is missing; names the command that needs it and what installs it.
    """
    missing = [module for module in modules if find_spec(module) is None]
    if missing:
        ways = dict.fromkeys(LARGE.get(module, INSTALL) for module in missing)
        raise StudyError(f"{command}: needs {' and '.join(missing)}, which is not installed: {' and '.join(ways)}")
