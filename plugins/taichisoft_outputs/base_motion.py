"""The moment before the base moves, from which lift and slip are counted."""

import numpy as np


def last_at_rest(base_translation: np.ndarray) -> int | None:
    """Index of the last translation, of shape (count, 3), before the base leaves the first one; None where it stays."""
    moved = np.flatnonzero((base_translation != base_translation[0]).any(axis=1))
    return int(moved[0]) - 1 if len(moved) else None
