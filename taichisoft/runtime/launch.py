"""A short way from Python into a Taichi kernel, whose arrays come in bundles.

Taichi 1.7.4 examines every argument at every launch: some 10 microseconds for each array, which for the twenty
launches of a step is longer than the arithmetic; and it takes an array of integers for one of floats. `kernel` compiles
through Taichi at the first call, checks arrays against the annotations, hands over pointers, and keeps what it has set
up: a launch with the very bundles of an earlier one costs 2 microseconds, and 0.4 more for each of their arrays.

A bundle is a NamedTuple of arrays, such as the elements of a body; its fields are annotated with the array types of
`runtime`. Taichi sees its arrays one by one, `elements.lame` as `elements_lame`; inside the kernel they are put
together again, and functions decorated with `func` take the bundle whole. What this needs of Taichi's private interface
is in `taichi_private.py`.
"""

import ast
import inspect
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from operator import itemgetter
from threading import Lock
from typing import Any

import numpy as np

from taichisoft.errors import ForkedProcess
from taichisoft.runtime import first_process
from taichisoft.runtime.taichi_private import CompiledKernel, rewrite_kernels, set_array, set_number
from taichisoft.runtime.taichi_start import restart_taichi, ti

# Sets of arrays that a kernel remembers, for problems of several sizes and models side by side. A set keeps its arrays
# alive; code that replaces arrays by larger ones calls `forget`.
REMEMBERED = 16
# Taichi has one program a process, and promises nothing to threads that launch at once.
LAUNCHING = Lock()
KERNELS: list["Kernel"] = []
SHOWING: list[Callable[[str], None]] = []


def kernel(function: Callable[..., None]) -> "Kernel":
    """Decorate a kernel that takes bundles, numpy arrays and numbers, and returns nothing."""
    return Kernel(function)


def func(function: Callable[..., Any]) -> Any:
    """Decorate a function that kernels call; it takes bundles by reference."""
    for name, annotation in function.__annotations__.items():
        if _is_bundle(annotation):
            function.__annotations__[name] = ti.template()
    return ti.func(function)


def forget(*held: Any) -> None:
    """Let all kernels forget the launches with any of the arrays or bundles `held`, so that they can be freed."""
    unwanted = set(map(id, held))
    with LAUNCHING:
        for one in KERNELS:
            one.forget(unwanted)


@contextmanager
def compilations_shown(show: Callable[[str], None]) -> Iterator[None]:
    """Within it, `show` gets the name of every kernel that is about to be compiled, or loaded if it was before."""
    SHOWING.append(show)
    try:
        yield
    finally:
        SHOWING.remove(show)


class Kernel:
    """A Taichi kernel whose parameters are annotated with ti.i32, ti.f64, the array types of `runtime`, or bundles."""

    def __init__(self, function: Callable[..., None]):
        """Nothing is compiled before the first call."""
        self.__doc__ = function.__doc__
        self.__name__ = function.__name__
        parameters = inspect.signature(function).parameters.values()
        self._names = [parameter.name for parameter in parameters]
        self._bundles = {p.name: p.annotation for p in parameters if _is_bundle(p.annotation)}
        flat = [one for parameter in parameters for one in _flattened(parameter)]
        function.__signature__ = inspect.Signature(flat)  # type: ignore[attr-defined]
        function.bundles = self._bundles  # type: ignore[attr-defined]
        self._kernel = ti.kernel(function)
        self._described = [_describe(parameter.annotation) for parameter in flat]
        self._flat_names = [parameter.name for parameter in flat]
        numbers = [
            name for name, (_, dimensions, _) in zip(self._flat_names, self._described, strict=True) if not dimensions
        ]
        # Where the numbers stand among the flat arguments, and how each is handed over.
        self._number_places = [self._flat_names.index(name) for name in numbers]
        self._number_kinds = [self._described[place][0] for place in self._number_places]
        self._pick_numbers = _picker([self._names.index(name) for name in numbers])
        self._pick_held = _picker([index for index, name in enumerate(self._names) if name not in numbers])
        self._remembered: dict[tuple[int, ...], _Launch] = {}
        self._compiled: CompiledKernel | None = None
        KERNELS.append(self)

    def __call__(self, *arguments: Any) -> None:
        """Launch; arrays are changed in place.

        Raises:
            TypeError: an array is not contiguous, or not of the annotated type and number of dimensions; or there are
                too many arguments or too few.
        """
        if len(arguments) != len(self._names):
            raise TypeError(f"kernel {self.__name__} takes {len(self._names)} arguments, not {len(arguments)}")
        identity = tuple(map(id, self._pick_held(arguments)))
        numbers = self._pick_numbers(arguments)
        with LAUNCHING:
            launch = self._remembered.get(identity) or self._prepare(identity, arguments)
            if numbers != launch.numbers:
                self._set_numbers(launch, numbers)
            launch.compiled.launch(launch.context)

    def forget(self, unwanted: set[int]) -> None:
        """Forget the launches with any argument whose `id` is in `unwanted`."""
        for identity in [known for known in self._remembered if not unwanted.isdisjoint(known)]:
            del self._remembered[identity]

    def _set_numbers(self, launch: "_Launch", numbers: tuple[Any, ...]) -> None:
        launch.numbers = numbers
        for place, kind, number in zip(self._number_places, self._number_kinds, numbers, strict=True):
            set_number(launch.context, place, kind, number)

    def _prepare(self, identity: tuple[int, ...], arguments: tuple[Any, ...]) -> "_Launch":
        """A launch with the pointers of the arrays in `arguments`."""
        flat: list[Any] = []
        for name, argument in zip(self._names, arguments, strict=True):
            if name in self._bundles and not isinstance(argument, self._bundles[name]):
                raise TypeError(
                    f"kernel {self.__name__}, {name}: must be {self._bundles[name].__name__}, not {argument!r}"
                )
            flat += argument if name in self._bundles else [argument]
        self._check(flat)
        if self._compiled is None:
            self._compiled = self._compile(flat)
        context = self._compiled.make_context()
        for place, (array, (_, dimensions, outer)) in enumerate(zip(flat, self._described, strict=True)):
            if dimensions:
                set_array(context, place, array, outer)
        if len(self._remembered) == REMEMBERED:
            del self._remembered[next(iter(self._remembered))]
        self._remembered[identity] = launch = _Launch(self._compiled, context, arguments)
        return launch

    def _check(self, flat: list[Any]) -> None:
        for name, array, (kind, dimensions, _) in zip(self._flat_names, flat, self._described, strict=True):
            if dimensions and (array.dtype != kind or array.ndim != dimensions or not array.flags.c_contiguous):
                raise TypeError(
                    f"kernel {self.__name__}, {name}: must be a contiguous {kind.__name__} array of {dimensions} "
                    f"dimensions, not {array.dtype} of {array.ndim}"
                )

    def _compile(self, flat: list[Any]) -> CompiledKernel:
        with suppress(OSError):  # such as a terminal that was closed
            for show in SHOWING:
                show(self.__name__)
        first_process.begin_compilation()
        # Taichi keeps the arguments of the compilation but needs their types alone, so the arrays have no entries.
        alike = [np.empty_like(one[:0]) if isinstance(one, np.ndarray) else one for one in flat]
        compiled = CompiledKernel(self._kernel, alike)
        first_process.end_compilation()
        return compiled

    def restart(self) -> None:
        """Discard the compilation and the launches of a program of Taichi that has ended."""
        self._remembered.clear()
        self._compiled = None


LAUNCH = Kernel.__call__


def _launch_as_first(self: Kernel, *arguments: Any) -> None:
    """Launch in the first process, and hand its kernels over when other processes wait for them."""
    if first_process.must_hand_over():
        with LAUNCHING:
            restart_taichi()
            for one in KERNELS:
                one.restart()
        first_process.resign()
    if not first_process.is_first():
        Kernel.__call__ = LAUNCH  # type: ignore[method-assign]
    LAUNCH(self, *arguments)


if first_process.is_first():
    Kernel.__call__ = _launch_as_first  # type: ignore[method-assign]


def _refuse(self: Kernel, *arguments: Any) -> None:
    raise ForkedProcess(
        "this process was forked after the simulator had started, and would wait for threads that it does not have; "
        "start processes with multiprocessing.get_context('spawn') or 'forkserver', or fork before "
        "taichisoft.Simulation is imported"
    )


def _refuse_launches() -> None:
    """Replace the call for all kernels, so that a launch need not ask whether its process was forked."""
    Kernel.__call__ = _refuse  # type: ignore[method-assign]


if hasattr(os, "register_at_fork"):  # Windows has no fork
    os.register_at_fork(after_in_child=_refuse_launches)


class _Launch:
    """A prepared launch; holding the arrays keeps their `id` from being used again."""

    def __init__(self, compiled: CompiledKernel, context: Any, arguments: tuple[Any, ...]):
        self.compiled = compiled
        self.context = context
        self.numbers: tuple[Any, ...] | None = None
        self._arguments = arguments


def _picker(indices: list[int]) -> Callable[[tuple[Any, ...]], tuple[Any, ...]]:
    """A function that picks the entries at `indices` of a tuple, as a tuple."""
    if not indices:
        return lambda arguments: ()
    if len(indices) == 1:  # itemgetter of one index gives no tuple
        index = indices[0]
        return lambda arguments: (arguments[index],)
    return itemgetter(*indices)


def _is_bundle(annotation: Any) -> bool:
    return isinstance(annotation, type) and issubclass(annotation, tuple) and hasattr(annotation, "_fields")


def _flattened(parameter: inspect.Parameter) -> list[inspect.Parameter]:
    """The parameter itself, or one parameter for each array of a bundle."""
    if not _is_bundle(parameter.annotation):
        return [parameter]
    fields = parameter.annotation.__annotations__
    return [
        parameter.replace(name=f"{parameter.name}_{field}", annotation=annotation)
        for field, annotation in fields.items()
    ]


def _describe(annotation: Any) -> tuple[type, int, int]:
    """Type of number, dimensions of the numpy array (0 for a number), and its dimensions outside an element."""
    if annotation is ti.i32 or annotation is ti.f64:
        return int if annotation is ti.i32 else float, 0, 0
    element = annotation.dtype
    element_dimensions = getattr(element, "ndim", 0)
    scalar = element.dtype if element_dimensions else element
    return np.int32 if scalar is ti.i32 else np.float64, annotation.ndim + element_dimensions, annotation.ndim


def _with_bundles(function: Callable[..., Any], tree: ast.Module) -> ast.Module:
    """A kernel's syntax tree with the arrays of bundles as parameters.

    The body then begins with `elements = ti.static(Elements(elements_corners, ...))`: names, without a copy.
    """
    bundles = getattr(function, "bundles", {})
    if not bundles:
        return tree
    definition: Any = tree.body[0]
    for parameter in reversed(definition.args.args):
        if parameter.arg not in bundles:
            continue
        fields = [f"{parameter.arg}_{field}" for field in bundles[parameter.arg]._fields]
        made = ast.parse(f"{parameter.arg} = ti.static({ast.unparse(parameter.annotation)}({', '.join(fields)}))")
        definition.body.insert(0, made.body[0])
    definition.args.args = [ast.arg(name) for name in inspect.signature(function).parameters]
    for node in ast.walk(definition):
        if not hasattr(node, "lineno"):
            ast.copy_location(node, definition)
    return tree


rewrite_kernels(_with_bundles)
