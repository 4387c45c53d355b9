"""A short way from Python into a Taichi kernel.

Taichi 1.7.4 looks at every argument of every launch anew: some 10 microseconds for each array, which for the twenty
launches of a step is as long as much of the arithmetic; and it takes an array of integers for one of floats. `kernel`
compiles through Taichi at the first call, checks arrays against the annotations, and hands over pointers: 102 instead
of 235 microseconds for 21 arguments. It uses Taichi's inner interface, so its version is pinned.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from taichisoft.kernels.runtime import ti


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
        self._compiled: Any = None

    def __call__(self, *arguments: Any) -> None:
        """Launch; arrays are changed in place.

        Raises:
            TypeError: an array is not contiguous, or not of the annotated type and number of dimensions.
        """
        for index, (argument, (kind, dimensions, _)) in enumerate(zip(arguments, self._parameters, strict=True)):
            if dimensions and (
                argument.dtype != kind or argument.ndim != dimensions or not argument.flags.c_contiguous
            ):
                raise TypeError(
                    f"kernel {self.__name__}, argument {index}: must be a contiguous {kind.__name__} array of "
                    f"{dimensions} dimensions, not {argument.dtype} of {argument.ndim}"
                )
        if self._compiled is None:
            self._compile(arguments)
        context = self._taichi_kernel.make_launch_context()
        for index, (argument, (kind, dimensions, shape_dimensions)) in enumerate(
            zip(arguments, self._parameters, strict=True)
        ):
            if dimensions:
                address = argument.__array_interface__["data"][0]
                shape = argument.shape[:shape_dimensions]
                context.set_arg_external_array_with_shape((index,), address, argument.nbytes, shape, 0)
            elif kind is int:
                context.set_arg_int((index,), int(argument))
            else:
                context.set_arg_float((index,), float(argument))
        self._program.launch_kernel(self._compiled, context)

    def _compile(self, arguments: tuple[Any, ...]) -> None:
        primal = self._kernel._primal
        self._taichi_kernel = primal.compiled_kernels[primal.ensure_compiled(*arguments)]
        self._program = ti.lang.impl.get_runtime().prog
        capabilities = self._program.get_device_caps()
        self._compiled = self._program.compile_kernel(self._program.config(), capabilities, self._taichi_kernel)


def _describe(annotation: Any) -> tuple[type, int, int]:
    """Type of number, dimensions of the numpy array (0 for a number), and those that are not within an element."""
    if annotation is ti.i32 or annotation is ti.f64:
        return int if annotation is ti.i32 else float, 0, 0
    element = annotation.dtype
    element_dimensions = getattr(element, "ndim", 0)
    scalar = element.dtype if element_dimensions else element
    return np.int32 if scalar is ti.i32 else np.float64, annotation.ndim + element_dimensions, annotation.ndim
