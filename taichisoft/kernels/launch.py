"""A short way from Python into a Taichi kernel.

Taichi 1.7.4 looks at every argument of every launch anew: some 10 microseconds for each array, which for the twenty
launches of a step is longer than the arithmetic; and it takes an array of integers for one of floats. `kernel` compiles
through Taichi at the first call, checks arrays against the annotations, hands over pointers, and keeps what it has set
up: a launch with the very arrays of an earlier one costs 2 to 5 microseconds, whatever their number. It uses Taichi's
inner interface, so its version is pinned.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from operator import itemgetter
from typing import Any

import numpy as np

from taichisoft.kernels.runtime import ti

# Sets of arrays that a kernel remembers, for problems of several sizes and models side by side. A set keeps its arrays
# alive.
REMEMBERED = 16


def kernel(function: Callable[..., None]) -> "Kernel":
    """Decorate a kernel that takes numpy arrays and numbers, and returns nothing."""
    return Kernel(function)


class Kernel:
    """A Taichi kernel whose arguments are annotated with ti.i32, ti.f64 and the array types of `runtime`."""

    def __init__(self, function: Callable[..., None]):
        """Nothing is compiled before the first call."""
        self.__doc__ = function.__doc__
        self.__name__ = function.__name__
        self._kernel = ti.kernel(function)
        self._parameters = [_describe(parameter.annotation) for parameter in self._kernel._primal.arguments]
        kinds = [(kind, dimensions) for kind, dimensions, _ in self._parameters]
        self._arrays = [index for index, (_, dimensions) in enumerate(kinds) if dimensions]
        self._pick_arrays = itemgetter(*self._arrays, self._arrays[0])  # once more: of one it would make no tuple
        self._numbers = [(index, kind) for index, (kind, dimensions) in enumerate(kinds) if not dimensions]
        self._remembered: dict[tuple[int, ...], tuple[Any, tuple[Any, ...]]] = {}
        self._compiled: Any = None

    def __call__(self, *arguments: Any) -> None:
        """Launch; arrays are changed in place.

        Raises:
            TypeError: an array is not contiguous, or not of the annotated type and number of dimensions; or there are
                too many arguments or too few.
        """
        if len(arguments) != len(self._parameters):
            raise TypeError(f"kernel {self.__name__} takes {len(self._parameters)} arguments, not {len(arguments)}")
        identity = tuple(map(id, self._pick_arrays(arguments)))
        known = self._remembered.get(identity)
        context = known[0] if known else self._prepare(identity, arguments)
        for index, kind in self._numbers:
            if kind is int:
                context.set_arg_int((index,), int(arguments[index]))
            else:
                context.set_arg_float((index,), float(arguments[index]))
        self._program.launch_kernel(self._compiled, context)

    def _prepare(self, identity: tuple[int, ...], arguments: tuple[Any, ...]) -> Any:
        """A launch context with the pointers of these arrays."""
        self._check(arguments)
        if self._compiled is None:
            self._compile(arguments)
        context = self._taichi_kernel.make_launch_context()
        for index in self._arrays:
            array = arguments[index]
            address = array.__array_interface__["data"][0]
            shape = array.shape[: self._parameters[index][2]]
            context.set_arg_external_array_with_shape((index,), address, array.nbytes, shape, 0)
        if len(self._remembered) == REMEMBERED:
            del self._remembered[next(iter(self._remembered))]
        # Holding the arrays keeps their identities theirs.
        self._remembered[identity] = context, arguments
        return context

    def _check(self, arguments: tuple[Any, ...]) -> None:
        for index in self._arrays:
            array, (kind, dimensions, _) = arguments[index], self._parameters[index]
            if array.dtype != kind or array.ndim != dimensions or not array.flags.c_contiguous:
                raise TypeError(
                    f"kernel {self.__name__}, argument {index}: must be a contiguous {kind.__name__} array of "
                    f"{dimensions} dimensions, not {array.dtype} of {array.ndim}"
                )

    def _compile(self, arguments: tuple[Any, ...]) -> None:
        primal = self._kernel._primal
        self._taichi_kernel = primal.compiled_kernels[primal.ensure_compiled(*arguments)]
        self._program = ti.lang.impl.get_runtime().prog
        capabilities = self._program.get_device_caps()
        self._compiled = self._program.compile_kernel(self._program.config(), capabilities, self._taichi_kernel)


@contextmanager
def timed_launches(add: Callable[[float], None]) -> Iterator[None]:
    """Within it, `add` gets the seconds of every launch; outside nothing is measured, and nothing costs."""
    launch = Kernel.__call__

    def timed(self: Kernel, *arguments: Any) -> None:
        started = time.perf_counter()
        launch(self, *arguments)
        add(time.perf_counter() - started)

    Kernel.__call__ = timed  # type: ignore[method-assign]
    try:
        yield
    finally:
        Kernel.__call__ = launch  # type: ignore[method-assign]


def _describe(annotation: Any) -> tuple[type, int, int]:
    """Type of number, dimensions of the numpy array (0 for a number), and those that are not within an element."""
    if annotation is ti.i32 or annotation is ti.f64:
        return int if annotation is ti.i32 else float, 0, 0
    element = annotation.dtype
    element_dimensions = getattr(element, "ndim", 0)
    scalar = element.dtype if element_dimensions else element
    return np.int32 if scalar is ti.i32 else np.float64, annotation.ndim + element_dimensions, annotation.ndim
