"""Tolerances that users give."""

from taichisoft_reduction.errors import ReductionError


def tolerance_share(option: str, text: str) -> float:
    """A tolerance as a share, from "0.5%" or "0.005".

    Raises:
        ReductionError: it is none.
    """
    try:
        value = float(text.removesuffix("%").strip()) / (100.0 if text.endswith("%") else 1.0)
    except ValueError:
        value = float("nan")
    if not 0.0 < value < 1.0:
        raise ReductionError(f"{option} {text}: must be a share of the largest change above 0, such as 0.5%")
    return value
