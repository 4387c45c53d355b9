"""Errors of model reduction."""

from taichisoft.errors import TaichisoftError


class ReductionError(TaichisoftError):
    """A reduced model cannot be made."""
