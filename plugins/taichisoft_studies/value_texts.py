"""Values of keys as they are written on a command line."""

from collections.abc import Mapping, Sequence
from typing import Any

from taichisoft.scenes.overrides import apply_override
from taichisoft_studies.extras import StudyError
from taichisoft_studies.study_file import MOST


def varied(texts: Sequence[str]) -> dict[str, Any]:
    """Tables of values from "key=a,b,c" (a list) and "key=low:high:count" (evenly spaced), as a study's file has them.

    Raises:
        StudyError: one does not look like that.
    """
    found: dict[str, Any] = {}
    for text in texts:
        key, separator, values = text.partition("=")
        key, parts = key.strip(), split_values(values)
        if not separator or not key or not all(parts):
            raise StudyError(f"--vary {text}: must look like body.width=20,22,25 or contact.friction=0.2:1.0:5")
        if key in found:
            raise StudyError(f"--vary {key}: is given twice; put its values into one list")
        if len(parts) > MOST:
            raise StudyError(f"--vary {key}: {len(parts)} values are more than the {MOST} runs that a sweep may have")
        found[key] = (
            value_range(text, values) if len(parts) == 1 and ":" in values else [_value(part) for part in parts]
        )
    return found


def split_values(values: str) -> list[str]:
    """Split values at commas, but not at those inside the brackets or quotes of a TOML value."""
    parts, depth, quoted = [""], 0, False
    for letter in values:
        quoted ^= letter == '"'
        depth += (letter in "[{") - (letter in "]}") if not quoted else 0
        if letter == "," and not depth and not quoted:
            parts.append("")
        else:
            parts[-1] += letter
    return [part.strip() for part in parts]


def value_range(text: str, values: str) -> Mapping[str, Any]:
    """The table of a range "low:high:count"; `text` is the whole option, for the error.

    Raises:
        StudyError: it is none.
    """
    parts = values.split(":")
    try:
        low, high = map(float, parts[:2])
        count = int(parts[2]) if len(parts) == 3 else None
        if len(parts) > 3:
            raise ValueError
    except ValueError as error:
        raise StudyError(f"--vary {text}: a range must look like 0.2:1.0:5, lowest, highest and count") from error
    return {"low": low, "high": high, "count": count}


def _value(text: str) -> Any:
    holder: dict[str, Any] = {}
    apply_override(holder, f"value={text}")
    return holder["value"]
