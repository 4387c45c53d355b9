"""A short way from Python into a kernel, whose arrays come in bundles.

`kernel` checks arrays against the annotations, hands over pointers, and keeps what it has set up: a launch with the
very arguments of the last one costs half a microsecond. It runs machine code that was kept (machine_code.py); what is
not there is compiled first. With TAICHISOFT_KERNELS=taichi, or where no machine code is kept, Taichi runs the kernels.

A bundle is a NamedTuple of arrays, such as the elements of a body; its fields are annotated with the array types of
language.py. Taichi sees its arrays one by one, `elements.lame` as `elements_lame`; inside the kernel they are put
together again, and functions decorated with `func` take the bundle whole.

Launches from several threads may run at once, if each has arrays of its own.
"""

import inspect
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from threading import RLock, get_ident
from typing import Any

from taichisoft.errors import TaichisoftError
from taichisoft.runtime import machine_code
from taichisoft.runtime.language import KERNELS, VARIABLE, Arrays, is_bundle, ti

# Sets of arrays that a kernel remembers for a thread, for problems of several sizes and models side by side. A set
# keeps its arrays alive; code that replaces arrays by larger ones calls `forget`.
REMEMBERED = 16
SHOWING: list[Callable[[str], None]] = []
TIMING: list[Callable[[float], None]] = []
_preparing = RLock()

SETTING = os.environ.get(VARIABLE) or "machine-code"
if SETTING not in ("machine-code", "taichi"):
    raise TaichisoftError(f"{VARIABLE} = '{SETTING}': must be machine-code or taichi")


def kernel(function: Callable[..., None]) -> "Kernel":
    """Decorate a kernel that takes bundles, numpy arrays and numbers, and returns nothing."""
    return Kernel(function)


def forget(*held: Any) -> None:
    """Let all kernels forget the launches with any of the arrays or bundles `held`, so that they can be freed."""
    unwanted = set(map(id, held))
    with _preparing:
        for each in KERNELS:
            each.forget(unwanted)


def forget_launches_of_thread() -> None:
    """Let all kernels forget the launches that this thread made, before it ends."""
    with _preparing:
        for each in KERNELS:
            for identity in [known for known in each._remembered if known[0] == get_ident()]:
                each._drop(identity)


@contextmanager
def compilations_shown(show: Callable[[str], None]) -> Iterator[None]:
    """Within it, `show` gets the name of every kernel that is about to be compiled."""
    SHOWING.append(show)
    try:
        yield
    finally:
        SHOWING.remove(show)


@contextmanager
def timed_launches(add: Callable[[float], None]) -> Iterator[None]:
    """Within it, `add` gets the seconds of every launch, without the Python around it; outside nothing costs."""
    TIMING.append(add)
    _renew_starts()
    try:
        yield
    finally:
        TIMING.remove(add)
        _renew_starts()


def _renew_starts() -> None:
    for each in KERNELS:
        each._starts.clear()


def _timed(start: Callable[[], None]) -> None:
    started = time.perf_counter()
    start()
    seconds = time.perf_counter() - started
    for add in TIMING:
        add(seconds)


class Kernel:
    """A kernel whose parameters are annotated with ti.i32, ti.f64, the array types of `language`, or bundles.

    Attributes:
        function: the function that was decorated.
        thorough: whether Taichi searches for common expressions, which takes long and pays for large kernels alone.
        bundles: bundles among its parameters.
        flat: names and types of its parameters, with one for each array of a bundle.
    """

    def __init__(self, function: Callable[..., None], serial: bool = False):
        """Nothing is compiled before the first call."""
        self.__doc__ = function.__doc__
        self.__name__ = function.__name__
        self.function = function
        self.thorough = False
        self._serial = serial
        parameters = inspect.signature(function).parameters.values()
        self._names = [parameter.name for parameter in parameters]
        self.bundles = {p.name: p.annotation for p in parameters if is_bundle(p.annotation)}
        self.flat = [pair for p in parameters for pair in _flattened(p.name, p.annotation)]
        # Where the numbers stand among the flat arguments, and how each is handed over.
        self._number_places = [
            (place, int if annotation == ti.i32 else float)
            for place, (_, annotation) in enumerate(self.flat)
            if not isinstance(annotation, Arrays)
        ]
        numbers = {self.flat[place][0] for place, _ in self._number_places}
        self._numbers = [place for place, name in enumerate(self._names) if name in numbers]
        self._held = [place for place, name in enumerate(self._names) if name not in numbers]
        # Launches by thread and arrays, and what starts one with the very arguments of the last time.
        self._remembered: dict[tuple[int, ...], _Launch] = {}
        self._starts: dict[tuple[int, ...], Callable[[], None]] = {}
        self._compiled: Any = None
        KERNELS.append(self)

    def __call__(self, *arguments: Any) -> None:
        """Launch; arrays are changed in place.

        Raises:
            TypeError: an array is not contiguous, or not of the annotated type and number of dimensions; or there are
                too many arguments or too few.
        """
        start = self._starts.get((get_ident(), *map(id, arguments)))
        if start is None:
            start = self._prepare(arguments)
        start()

    def serial(self) -> "Kernel":
        """The same kernel run by one thread, which wakes no other."""
        return Kernel(self.function, serial=True)

    def forget(self, unwanted: set[int]) -> None:
        """Forget the launches with any argument whose `id` is in `unwanted`."""
        for identity in [known for known in self._remembered if not unwanted.isdisjoint(known[1:])]:
            self._drop(identity)

    def _drop(self, identity: tuple[int, ...]) -> None:
        self._starts.pop(self._remembered.pop(identity).identity, None)

    def _prepare(self, arguments: tuple[Any, ...]) -> Callable[[], None]:
        """What starts a launch with these arguments, which is kept: that with the same arrays gets other numbers."""
        if len(arguments) != len(self._names):
            raise TypeError(f"kernel {self.__name__} takes {len(self._names)} arguments, not {len(arguments)}")
        thread = get_ident()
        of_arrays = (thread, *map(id, map(arguments.__getitem__, self._held)))
        launch = self._remembered.get(of_arrays) or self._make_launch(of_arrays, arguments)
        self._starts.pop(launch.identity, None)
        for (place, kind), number in zip(self._number_places, map(arguments.__getitem__, self._numbers), strict=True):
            launch.compiled.set_number(launch.context, place, kind(number))
        launch.arguments, launch.identity = arguments, (thread, *map(id, arguments))
        start = self._starts[launch.identity] = partial(_timed, launch.start) if TIMING else launch.start
        return start

    def _make_launch(self, identity: tuple[int, ...], arguments: tuple[Any, ...]) -> "_Launch":
        """A launch with the pointers of the arrays in `arguments`."""
        flat: list[Any] = []
        for name, argument in zip(self._names, arguments, strict=True):
            if name in self.bundles and not isinstance(argument, self.bundles[name]):
                raise TypeError(
                    f"kernel {self.__name__}, {name}: must be {self.bundles[name].__name__}, not {argument!r}"
                )
            flat += _arrays(argument)
        self._check(flat)
        with _preparing:
            if self._compiled is None:
                self._compiled = self._compile()
            launch = _Launch(self._compiled, flat, self._serial)
            of_thread = [known for known in self._remembered if known[0] == identity[0]]
            if len(of_thread) >= REMEMBERED:
                self._drop(of_thread[0])
            self._remembered[identity] = launch
        return launch

    def _check(self, flat: list[Any]) -> None:
        for array, (name, kind) in zip(flat, self.flat, strict=True):
            if not isinstance(kind, Arrays):
                continue
            if array.dtype != kind.numbers or array.ndim != kind.empty.ndim or not array.flags.c_contiguous:
                raise TypeError(
                    f"kernel {self.__name__}, {name}: must be a contiguous {kind.numbers.__name__} array of "
                    f"{kind.empty.ndim} dimensions, not {array.dtype} of {array.ndim}"
                )

    def _compile(self) -> Any:
        """The kernel's machine code, or what Taichi makes of it."""
        if SETTING == "machine-code" and machine_code.is_supported():
            return machine_code.load(self, self._compile_now, self._show)
        self._show()
        from taichisoft.runtime.compiler import TaichiKernel

        return TaichiKernel(self)

    def _compile_now(self, name: str) -> bytes:
        from taichisoft.runtime.compiler import compile_kernels

        return compile_kernels([(name, self)])[name]

    def _show(self) -> None:
        with suppress(OSError):  # such as a terminal that was closed
            for show in SHOWING:
                show(self.__name__)


class _Launch:
    """A prepared launch; holding the arguments of its last start keeps their `id` from being used again."""

    __slots__ = ("arguments", "compiled", "context", "identity", "start")

    def __init__(self, compiled: Any, flat: list[Any], serial: bool):
        self.compiled = compiled
        self.context, address = compiled.make_context(flat, serial)
        self.start = partial(compiled.run, address)
        self.arguments: tuple[Any, ...] = ()
        self.identity: tuple[int, ...] = ()


def _flattened(name: str, annotation: Any) -> list[tuple[str, Any]]:
    """Name and type of a parameter itself, or of each array of a bundle and of the bundles in it."""
    if not is_bundle(annotation):
        return [(name, annotation)]
    return [pair for field, kind in annotation.__annotations__.items() for pair in _flattened(f"{name}_{field}", kind)]


def _arrays(bundle: Any) -> list[Any]:
    """The arrays of a bundle and of the bundles in it, in the order of `_flattened`; anything else as it is."""
    return [array for field in bundle for array in _arrays(field)] if isinstance(bundle, tuple) else [bundle]
