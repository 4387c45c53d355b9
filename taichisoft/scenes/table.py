"""What every table of a scene has in common: kinds of values, and keys that are checked.

Units: millimetre, kilogram, second; so forces are in mN and pressures and moduli in kPa.
"""

import ast
import inspect
import textwrap
from collections.abc import Mapping
from contextlib import suppress
from itertools import pairwise
from typing import Annotated, ClassVar, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

LARGEST, LONGEST, SMALLEST = 1e30, 1e9, 1e-18
"""What exceeds these is not a number of any robot in any unit, and would only be found out as a singular matrix."""


def _not_vanishing(value: float) -> float:
    if value < SMALLEST:
        raise ValueError(f"{value:g} must be {SMALLEST:g} or more")
    return value


# Strict: no text and no truth value is taken for a number.
Number = Annotated[float, Field(strict=True, ge=-LARGEST, le=LARGEST)]
Positive = Annotated[float, Field(strict=True, gt=0, le=LARGEST), AfterValidator(_not_vanishing)]
NotNegative = Annotated[float, Field(strict=True, ge=0, le=LARGEST)]
PoissonRatio = Annotated[float, Field(strict=True, gt=-1, lt=0.5)]
Component = Annotated[float, Field(strict=True, ge=-LONGEST, le=LONGEST)]
Vector = tuple[Component, Component, Component]
NodeNumber = Annotated[int, Field(strict=True, ge=0)]
Groups = list[Annotated[int, Field(strict=True)]]
KeySets = tuple[tuple[str, ...], ...]
# Without the signs that join names: "finger.cavity" is a cavity, "finger|cube" a pair, "base/cube.h5" a path. Without
# control characters, which terminals obey and at which texts in files end.
Name = Annotated[str, Field(pattern=r"^[^.|/\x00-\x1f\x7f-\x9f]+$", max_length=200)]


class Table(BaseModel):
    """A table of a scene: unknown keys, NaN and infinity are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, defer_build=True)

    alternatives: ClassVar[KeySets] = ()
    """Sets of keys; exactly one key of each set must be given."""
    no_effect_beside: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    """Keys that another one makes useless; they are no mistake at their defaults: a scene written out has them all."""

    @model_validator(mode="after")
    def _check_keys(self) -> Self:
        for keys in self.alternatives:
            given = [key for key in keys if getattr(self, key) is not None]
            if len(given) != 1:
                raise ValueError(f"exactly one of {', '.join(keys)} is needed; given: {', '.join(given) or 'none'}")
        for chosen, keys in self.no_effect_beside.items():
            useless = [key for key in keys if getattr(self, key) != type(self).model_fields[key].default]
            if useless and getattr(self, chosen) is not None:
                raise ValueError(f"{', '.join(useless)} would have no effect beside {chosen}; remove it")
        return self


def key_descriptions(table: type[BaseModel]) -> dict[str, str]:
    """Docstrings of a table's keys. Pydantic would read them from the source at every start, in a third of a second."""
    described = {key: field.description or "" for key, field in table.model_fields.items()}
    for kind in reversed(table.__mro__):
        with suppress(OSError, TypeError):  # a class without source
            (definition,) = ast.parse(textwrap.dedent(inspect.getsource(kind))).body
            for key, docstring in pairwise(definition.body):  # type: ignore[attr-defined]
                match key, docstring:
                    case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(value=ast.Constant(value=str(text))):
                        described[name] = inspect.cleandoc(text)
    return {key: described[key] for key in table.model_fields}


def check_order(table: Table, *quantities: str) -> None:
    """Raise ValueError where the lowest value of a quantity exceeds the highest."""
    for quantity in quantities:
        low, high = getattr(table, f"lowest_{quantity}"), getattr(table, f"highest_{quantity}")
        if low is not None and high is not None and low > high:
            raise ValueError(f"lowest_{quantity} ({low:g}) must not exceed highest_{quantity} ({high:g})")
