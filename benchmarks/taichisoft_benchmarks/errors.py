"""Errors of the benchmarks, each one line."""

from taichisoft.errors import TaichisoftError


class BenchmarkError(TaichisoftError):
    """A descriptor, an option or a file of results is not valid."""


class PeerMissing(BenchmarkError):
    """Another program is not installed or cannot do a case, which is skipped."""
