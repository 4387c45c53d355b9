"""Errors of the benchmarks that a user is told in one line."""

from taichisoft.errors import TaichisoftError


class BenchmarkError(TaichisoftError):
    """A descriptor, an option or a file of results is not valid."""


class PeerMissing(BenchmarkError):
    """Another program that a case compares with is not installed, or cannot do the case; the case is skipped."""
