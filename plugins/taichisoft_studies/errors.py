"""The error of studies."""

from taichisoft.errors import TaichisoftError


class StudyError(TaichisoftError):
    """A study cannot be understood or done."""
