"""Values of the keys that vary: read from a command line, and combined for the runs of a sweep."""

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from taichisoft.scenes import apply_override
from taichisoft_studies.errors import StudyError
from taichisoft_studies.study_file import MOST, Range, Sample, Values


def varied(texts: Sequence[str]) -> dict[str, Any]:
    """Tables of values from "key=a,b,c" (a list) and "key=low:high:count" (evenly spaced), as a study's file has them.

    Raises:
        StudyError: a text has another form, or a key is given twice.
    """
    found: dict[str, Any] = {}
    for text in texts:
        key, separator, values = text.partition("=")
        key, parts = key.strip(), _split_values(values)
        if not separator or not key or not all(parts):
            raise StudyError(f"--vary {text}: must look like body.width=20,22,25 or contact.friction=0.2:1.0:5")
        if key in found:
            raise StudyError(f"--vary {key}: is given twice; put its values into one list")
        if len(parts) > MOST:
            raise StudyError(f"--vary {key}: {len(parts)} values are more than the {MOST} runs that a sweep may have")
        is_range = len(parts) == 1 and ":" in values and not values.startswith('"')
        found[key] = _range(text, values) if is_range else [value_from(part) for part in parts]
    return found


def value_from(text: str) -> Any:
    """The value that a text stands for: TOML, or the text itself."""
    holder: dict[str, Any] = {}
    apply_override(holder, f"value={text}")
    return holder["value"]


def combinations(varied: Mapping[str, Values], sample: Sample | None, seed: int) -> list[dict[str, Any]]:
    """The values of each run by key; on a grid the last key's values change fastest.

    Raises:
        StudyError: there would be more than MOST.
    """
    if sample is not None:
        if sample.count > MOST:
            raise StudyError(f"sample.count = {sample.count}: more than the {MOST} runs that a sweep may have")
        rows = unit_samples(sample, len(varied), seed).tolist()
        return [{key: _value_at(varied[key], share) for key, share in zip(varied, row, strict=True)} for row in rows]
    count = math.prod(map(_grid_size, varied.values()))
    if count > MOST:
        raise StudyError(f"vary: {count} combinations are more than the {MOST} that a sweep may have")
    return [dict(zip(varied, chosen, strict=True)) for chosen in itertools.product(*map(grid, varied.values()))]


def unit_samples(sample: Sample, dimensions: int, seed: int) -> np.ndarray:
    """Points of the unit cube, shape (sample.count, dimensions); the same seed gives the same ones."""
    from scipy.stats import qmc

    generator = np.random.default_rng(seed)
    if sample.method == "random":
        return generator.random((sample.count, dimensions))
    engine: Any = qmc.LatinHypercube if sample.method == "lhs" else qmc.Sobol
    points: np.ndarray = engine(dimensions, rng=generator).random(sample.count)
    return points


def grid(values: Values) -> list[Any]:
    """The values of one key; `count` of them for a range, whole numbers once each."""
    if not isinstance(values, Range):
        return list(values)
    assert values.count is not None  # the study's table sees to it
    if values.integer and values.count > values.high - values.low:
        return list(range(int(values.low), int(values.high) + 1))
    shares = [0.5] if values.count == 1 else np.linspace(0.0, 1.0, values.count).tolist()
    if not values.integer:
        return [_value_at(values, share) for share in shares]
    return list(dict.fromkeys(round(values.low + share * (values.high - values.low)) for share in shares))


def _grid_size(values: Values) -> int:
    """Number of values that `grid` gives, without making them."""
    if not isinstance(values, Range):
        return len(values)
    assert values.count is not None
    return min(values.count, int(values.high - values.low) + 1) if values.integer else values.count


def _value_at(values: Values, share: float) -> Any:
    """The value at a share, from 0 to 1, of a range or list, rounded to ten digits."""
    if not isinstance(values, Range):
        return values[min(int(share * len(values)), len(values) - 1)]
    low, high = values.low, values.high
    if values.integer:
        return min(int(low + share * (high - low + 1)), int(high))
    value = low * (high / low) ** share if values.log else low + share * (high - low)
    return float(f"{value:.10g}")


def _split_values(values: str) -> list[str]:
    """Split values at commas, but not at commas inside the brackets or quotes of a TOML value."""
    parts, depth, quoted = [""], 0, False
    for letter in values:
        quoted ^= letter == '"'
        depth += (letter in "[{") - (letter in "]}") if not quoted else 0
        if letter == "," and not depth and not quoted:
            parts.append("")
        else:
            parts[-1] += letter
    return [part.strip() for part in parts]


def _range(text: str, values: str) -> Mapping[str, Any]:
    """The table of a range "low:high:count"; `text` is the whole option, for the error."""
    try:
        low, high, *count = values.split(":")
        table = {"low": float(low), "high": float(high)}
        return {**table, "count": int(*count)} if count else table
    except (ValueError, TypeError) as error:
        raise StudyError(f"--vary {text}: a range must look like 0.2:1.0:5, lowest, highest and count") from error
