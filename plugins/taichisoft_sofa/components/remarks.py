"""Data of a scene without effect: data with an effect in SOFA only, and unknown data."""

import difflib
import functools
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from taichisoft_sofa.components.typed_values import described
from taichisoft_sofa.tree.component import OF_COMPONENTS
from taichisoft_sofa.tree.value_kinds import Declared, declared

if TYPE_CHECKING:
    from taichisoft_sofa.tree.component import Component

LONGEST = 60
"""Largest number of characters of a value in a line."""


def remarks(component: "Component") -> Iterator[str]:
    """One line for each data of the scene without effect, unless it has no effect in SOFA either."""
    known = {**OF_COMPONENTS, **declared(component.type_name)}
    for name, data in component.data_by_name.items():
        if not data.is_set() or data.is_own():
            continue
        if name not in known:
            said = f"{described(component)}: {name} = {_shown(data.written_text())}"
            yield f"{said}: no such data is known here{_hint(component.type_name, name)}"
        elif known[name].unused and not _is_default(data.given(), known[name]):
            yield f"{described(component)}: {name} = {_shown(data.written_text())} has no effect here"


@functools.cache
def _hint(type_name: str, name: str) -> str:
    near = difflib.get_close_matches(name, [*OF_COMPONENTS, *declared(type_name)], n=1)
    return f"; did you mean '{near[0]}'?" if near else ""


def _is_default(value: Any, known: Declared) -> bool:
    """Whether a value is SOFA's default, for vectors an empty one or zeros."""
    if isinstance(value, np.ndarray):
        return not value.any()
    return bool(value == (known.default if known.default is not None else value))


def _shown(text: str) -> str:
    line = " ".join(text.split())
    return line if len(line) <= LONGEST else f"{line[: LONGEST - 3]}..."
