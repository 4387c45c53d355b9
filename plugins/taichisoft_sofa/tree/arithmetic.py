"""Arithmetic on data: scenes add, compare, index and iterate over data like values."""

import operator
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np


class Arithmetic:
    """Base class of objects that act as their value in expressions."""

    value: Any
    __hash__ = object.__hash__

    def __setitem__(self, index: Any, item: Any) -> None:
        changed = self.value
        changed[index] = item
        self.value = changed

    def __iter__(self) -> Iterator[Any]:
        return iter(self.value)

    def __contains__(self, item: Any) -> bool:
        return item in self.value

    def __bool__(self) -> bool:
        value = self.value
        return len(value) > 0 if hasattr(value, "__len__") else bool(value)

    def __float__(self) -> float:
        return float(self._number())

    def __int__(self) -> int:
        return int(self._number())

    def __index__(self) -> int:
        return operator.index(self.value)

    def __round__(self, digits: int | None = None) -> Any:
        return round(self.value, digits)

    def __str__(self) -> str:
        return str(self.value)

    def __format__(self, form: str) -> str:
        return format(self.value, form)

    def __neg__(self) -> Any:
        return -_operand(self)

    def __abs__(self) -> Any:
        return abs(_operand(self))

    def __eq__(self, other: object) -> bool:
        mine: Any
        others: Any
        mine, others = (item.value if isinstance(item, Arithmetic) else item for item in (self, other))
        if mine is None or others is None:
            return self is other
        return np.array_equal(mine, others)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Any:
        return np.array(self.value, dtype)

    def _number(self) -> Any:
        value = self.value
        if isinstance(value, str):
            return float(value)
        return value.item() if isinstance(value, np.ndarray) else value


def _operand(item: Any) -> Any:
    """The value of an operand; lists become arrays, so that they are added elementwise."""
    value = item.value if isinstance(item, Arithmetic) else item
    return np.asarray(value) if isinstance(value, list | tuple) else value


def _forward(operation: Callable[[Any, Any], Any]) -> Any:
    return lambda self, other: operation(_operand(self), _operand(other))


def _backward(operation: Callable[[Any, Any], Any]) -> Any:
    return lambda self, other: operation(_operand(other), _operand(self))


for _name in ("add", "sub", "mul", "truediv", "floordiv", "mod", "pow", "matmul"):
    setattr(Arithmetic, f"__{_name}__", _forward(getattr(operator, _name)))
    setattr(Arithmetic, f"__r{_name}__", _backward(getattr(operator, _name)))
for _name in ("lt", "le", "gt", "ge"):
    setattr(Arithmetic, f"__{_name}__", _forward(getattr(operator, _name)))
