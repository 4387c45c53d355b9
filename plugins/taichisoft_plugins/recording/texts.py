"""Texts in a recording: of a fixed length, since HDF5 keeps no checksum of those whose length varies."""

from collections.abc import Sequence
from typing import Any

import numpy as np


def write_text(attributes: Any, name: str, text: str) -> None:
    """Write a text as an attribute, in UTF-8."""
    attributes[name] = as_bytes(text)


def write_texts(attributes: Any, name: str, texts: Sequence[str]) -> None:
    """Write any number of texts as one attribute, each as long as the longest."""
    encoded = [text.encode() for text in texts]
    attributes[name] = np.array(encoded, dtype=f"S{max(map(len, encoded), default=1) or 1}")


def read_text(attributes: Any, name: str) -> str:
    """The text of an attribute; that of older layouts has any length."""
    value = attributes[name]
    return value if isinstance(value, str) else bytes(value).decode(errors="replace")


def read_texts(attributes: Any, name: str) -> list[str]:
    """The texts of an attribute."""
    return [bytes(text).decode(errors="replace") for text in attributes[name]]


def as_bytes(text: str, length: int = 0) -> np.bytes_:
    """A text in UTF-8, cut off after so many bytes; 0 for any number."""
    encoded = text.encode()
    return np.bytes_(encoded[: length or len(encoded)] or b"\0")
