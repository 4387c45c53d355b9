"""The language of kernels: Taichi's names, the types of arrays, functions and threads.

Taichi takes half a second to import and is needed only to compile, so `ti` here stands for it: `ti.i32` or
`ti.types.vector(3, ti.f64)` is kept as an expression, in whose place compiler.py puts Taichi's own object.

Everything runs in double precision on the CPU. `TAICHISOFT_THREADS` sets the number of threads: otherwise all cores, or
one in a process that multiprocessing started, which has others beside it. Results do not depend on it, because every
sum is gathered in a fixed order by one owner.

In a parallel loop Taichi turns `array[i] += x` into an atomic operation, which neither vectorises nor keeps its
order: kernels write `array[i] = array[i] + x` where one task owns the entry.

LLVM may assume that there is no NaN, so kernels cannot be trusted to find one. They need not: every new state is
checked with numpy's isfinite on the host before it is accepted (divergence.py), and comparisons with NaN inside
kernels do no more than end loops.
"""

import functools
import os
import sys
from collections.abc import Callable
from typing import Any

import numpy as np

from taichisoft.errors import TaichisoftError

VARIABLE = "TAICHISOFT_KERNELS"
"""Environment variable: "taichi" lets Taichi run the kernels instead of machine code that is kept."""

KERNELS: list[Any] = []
"""All kernels that were decorated."""


class TaichiExpression:
    """An expression in terms of the module `ti`, equal to any other of the same text."""

    def __init__(self, text: str, arguments: tuple[Any, ...] = ()):
        self._text = text
        self._arguments = arguments

    def __getattr__(self, name: str) -> "TaichiExpression":
        if name.startswith("_"):
            raise AttributeError(name)
        return TaichiExpression(f"{self._text}.{name}")

    def __call__(self, *arguments: Any) -> "TaichiExpression":
        return TaichiExpression(f"{self._text}({', '.join(map(repr, arguments))})", arguments)

    def __repr__(self) -> str:
        return self._text

    def __eq__(self, other: object) -> bool:
        return isinstance(other, TaichiExpression) and other._text == self._text

    def __hash__(self) -> int:
        return hash(self._text)


ti: Any = TaichiExpression("ti")


class Arrays:
    """The type of numpy arrays of numbers, vectors or matrices.

    Attributes:
        dtype: type of an entry: ti.i32, ti.f64, a vector or a matrix of these.
        ndim: number of dimensions apart from those of an entry.
        numbers: numpy's type of the numbers.
        empty: an array of this type without entries.
    """

    def __init__(self, dtype: TaichiExpression, ndim: int):
        self.dtype, self.ndim = dtype, ndim
        *shape, scalar = dtype._arguments or (dtype,)
        self.numbers = np.int32 if scalar == ti.i32 else np.float64
        self.empty = np.empty([0] * ndim + shape, self.numbers)

    def __repr__(self) -> str:
        return f"ti.types.ndarray(dtype={self.dtype}, ndim={self.ndim})"


class Function:
    """A function that kernels call; it cannot be called from Python."""

    def __init__(self, function: Callable[..., Any]):
        functools.update_wrapper(self, function)
        self.function = function


def func(function: Callable[..., Any]) -> Any:
    """Decorate a function that kernels call; it takes bundles by reference."""
    return Function(function)


def is_bundle(annotation: Any) -> bool:
    """Whether a type is a bundle: a NamedTuple of arrays."""
    return isinstance(annotation, type) and issubclass(annotation, tuple) and hasattr(annotation, "_fields")


def thread_count(setting: str) -> int:
    """The number of threads that the environment variable TAICHISOFT_THREADS asks for.

    Raises:
        TaichisoftError: the setting is not a whole number, or negative.
    """
    if not (setting.isascii() and setting.strip().isdigit()):
        raise TaichisoftError(
            f"TAICHISOFT_THREADS = '{setting}': must be a whole number of threads, 1 or more, or 0 for all cores"
        )
    return int(setting) or available_cores()


def available_cores() -> int:
    """Cores that this process may use; more threads would only wait for one another."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _usual_threads() -> str:
    multiprocessing = sys.modules.get("multiprocessing")  # its children have imported it
    return "1" if multiprocessing and multiprocessing.parent_process() is not None else "0"


THREADS = thread_count(os.environ.get("TAICHISOFT_THREADS") or _usual_threads())

# On the CPU Taichi 1.7.4 cuts a parallel loop into one stretch of iterations a thread, of at least 512, whatever
# block_dim says. A loop over threads * CHUNK that works only where the index is a multiple of CHUNK runs once on each
# thread; there the threads take tasks in turn by a counter.
CHUNK = 512

# A vertex of a surface is carried by the rigid body of its number, or by one of:
STATIC = -1
SOFT = -2

vec3: Any = ti.types.vector(3, ti.f64)
mat3: Any = ti.types.matrix(3, 3, ti.f64)

Integers: Any = Arrays(ti.i32, 1)
IntegerTable: Any = Arrays(ti.i32, 2)
IntegerBlocks: Any = Arrays(ti.i32, 3)
Scalars: Any = Arrays(ti.f64, 1)
ScalarTable: Any = Arrays(ti.f64, 2)
ScalarBlocks: Any = Arrays(ti.f64, 3)
Vectors: Any = Arrays(vec3, 1)
VectorTable: Any = Arrays(vec3, 2)
VectorBlocks: Any = Arrays(vec3, 3)
Matrices: Any = Arrays(mat3, 1)
