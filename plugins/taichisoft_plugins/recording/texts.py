"""Texts in a recording: of a fixed length, since HDF5 keeps no checksum of those whose length varies."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from taichisoft_plugins.recording.layout import SIGNAL_COUNT, SIGNAL_NAME_LENGTH


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
    return decoded(attributes[name])


def decoded(texts: Sequence[bytes]) -> list[str]:
    """The texts of an array."""
    return [bytes(text).decode(errors="replace") for text in texts]


def as_bytes(text: str, length: int = 0) -> np.bytes_:
    """A text in UTF-8, cut off after so many bytes; 0 for any number."""
    encoded = text.encode()
    return np.bytes_(encoded[: length or len(encoded)] or b"\0")


def as_signal_names(names: Sequence[str]) -> np.ndarray:
    """Names of signals as a dataset has them, shape (SIGNAL_COUNT,): what is too long is cut off, the rest is empty."""
    encoded = np.zeros(SIGNAL_COUNT, dtype=f"S{SIGNAL_NAME_LENGTH}")
    encoded[: len(names)] = [str(name).encode(errors="replace") for name in names]
    return encoded
