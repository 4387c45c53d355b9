"""The combinations of values that a sweep makes runs of: all of them, or samples."""

import itertools
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from taichisoft_studies.extras import StudyError
from taichisoft_studies.study_file import MOST, Range, Sample, Values


def combinations(varied: Mapping[str, Values], sample: Sample | None, seed: int) -> list[dict[str, Any]]:
    """The values of each run by key; on a grid the last key's values change fastest.

    Raises:
        StudyError: there would be more than MOST.
    """
    if sample is not None:
        if sample.count > MOST:
            raise StudyError(f"sample.count = {sample.count}: more than the {MOST} runs that a sweep may have")
        shares = unit_samples(sample, len(varied), seed)
        return [
            {key: value_at(values, share) for (key, values), share in zip(varied.items(), row, strict=True)}
            for row in shares.tolist()
        ]
    count = math.prod(map(grid_size, varied.values()))
    if count > MOST:
        raise StudyError(f"vary: {count} combinations are more than the {MOST} that a sweep may have")
    lists = {key: grid(values) for key, values in varied.items()}
    return [dict(zip(lists, chosen, strict=True)) for chosen in itertools.product(*lists.values())]


def unit_samples(sample: Sample, dimensions: int, seed: int) -> np.ndarray:
    """Points of the unit cube, shape (sample.count, dimensions); the same seed gives the same ones."""
    from scipy.stats import qmc

    generator = np.random.default_rng(seed)
    if sample.method == "random":
        return generator.random((sample.count, dimensions))
    engine: Any = qmc.LatinHypercube if sample.method == "lhs" else qmc.Sobol
    points: np.ndarray = engine(dimensions, rng=generator).random(sample.count)
    return points


def grid_size(values: Values) -> int:
    """How many values `grid` gives, without making them."""
    if not isinstance(values, Range):
        return len(values)
    assert values.count is not None  # the study's table sees to it
    return min(values.count, int(values.high - values.low) + 1) if values.integer else values.count


def grid(values: Values) -> list[Any]:
    """The values of one key; `count` of them for a range, whole numbers once each."""
    if not isinstance(values, Range):
        return list(values)
    assert values.count is not None
    if values.integer and values.count > values.high - values.low:
        return list(range(int(values.low), int(values.high) + 1))
    shares = [0.5] if values.count == 1 else np.linspace(0.0, 1.0, values.count).tolist()
    if not values.integer:
        return [value_at(values, share) for share in shares]
    return list(dict.fromkeys(round(values.low + share * (values.high - values.low)) for share in shares))


def value_at(values: Values, share: float) -> Any:
    """The value at a share, from 0 to 1, of a range or list, as many digits as a reader can bear."""
    if not isinstance(values, Range):
        return values[min(int(share * len(values)), len(values) - 1)]
    low, high = values.low, values.high
    if values.integer:
        return min(int(low + share * (high - low + 1)), int(high))
    value = low * (high / low) ** share if values.log else low + share * (high - low)
    return float(f"{value:.10g}")
