"""Machine code of kernels, kept between processes: an object file each, which the next process loads in a millisecond.

A kept file has a line with the SHA-256 of the rest, a line of JSON that says where a launch puts each argument, and an
object file in which one function takes a RuntimeContext of Taichi's. Its name has a key of all that the code depends
on: the source of the kernel and of all functions that it calls, the constants in them, the compiler, and the processor.
Any processor of the level x86-64-v3 runs the same code, and so gets the same bits. Files that come with the package are
looked at first, then those in the user's cache; what is in neither is compiled (compiler.py), once on a machine.

Of Taichi's LLVMRuntime the code reads three fields: a pool of threads (pool.ll), the function that runs a loop on it,
and a few bytes in which one part of a kernel leaves the bounds of the next one's loop. Those bytes belong to the Python
thread that launches, so that launches from several threads may run at once.
"""

import atexit
import ctypes
import functools
import hashlib
import json
import linecache
import os
import platform
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from enum import Enum
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

import numpy as np

from taichisoft.base.kept_files import keep, kept_folder, read_kept
from taichisoft.runtime.language import THREADS, Arrays, Function, TaichiExpression, available_cores, is_bundle

HERE = Path(__file__).parent
SHIPPED = HERE / "kernels"
SUFFIX = ".kernel"
# Bytes from the start of Taichi 1.7.4's LLVMRuntime to its fields 9, 10 and 14 (llvm/runtime_module/runtime.cpp).
POOL = 2 * 24 + 4 * 8 + 8 + 512 * 8 + 512 * 8
PARALLEL_FOR = POOL + 8
TEMPORARIES = PARALLEL_FOR + 8 + 3 * 1024 * 8
TEMPORARIES_SIZE = 1 << 20  # Taichi's own, which a kernel cannot exceed
POOL_SIZE = 512
LOOKS = 500  # of a waiting thread before it sleeps: a few microseconds
LEVEL = "x86-64-v3", ""
V3 = ("avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe", "xsave")
_LOADED: dict[str, "MachineCode"] = {}
_THREAD = threading.local()
ALONE = "alone"
_pack_integer, _pack_float = struct.Struct("<i").pack_into, struct.Struct("<d").pack_into
_Function = ctypes.CFUNCTYPE(None, ctypes.c_void_p)


def is_supported() -> bool:
    """Whether machine code is kept for this system; elsewhere Taichi runs the kernels."""
    return sys.platform == "linux" and platform.machine() == "x86_64"


@functools.cache
def target() -> tuple[str, str]:
    """Name and features of the processor to compile for, in LLVM's terms."""
    llvm = _llvm()
    features = llvm.get_host_cpu_features()
    if all(features.get(name, False) for name in V3):
        return LEVEL
    return llvm.get_host_cpu_name(), features.flatten()


def load(kernel: Any, compile_now: Callable[[str], bytes], show: Callable[[], None]) -> "MachineCode":
    """A kernel's machine code; before it is compiled, `show` is called.

    Args:
        kernel: the kernel.
        compile_now: compiles it in this process, to be kept under a name.
        show: tells that it is being compiled.

    Raises:
        TaichisoftError: the kernel uses something of Taichi that machine code does not have.
    """
    name = kept_name(kernel)
    if name not in _LOADED:
        data = kept(name)
        if data is None:
            show()
            data = _compiled(kernel, name, compile_now)
        _LOADED[name] = MachineCode(name, data)
    return _LOADED[name]


class MachineCode:
    """A kernel as machine code.

    Attributes:
        run: launches it, given the address of a context.
    """

    def __init__(self, name: str, data: bytes):
        layout, code = data.split(b"\n", 1)
        self._layout = json.loads(layout)
        self._places = self._layout["places"]
        self.run = _Function(_linked(code, symbol(name)))

    def make_context(self, flat: list[Any], serial: bool) -> tuple["_Context", int]:
        """What a launch of this thread gets, and its address: the arrays among the arguments `flat`, but no number.

        A `serial` launch wakes no other thread.
        """
        context = _Context(self._layout["size"], serial)
        for place, array in zip(self._places, flat, strict=True):
            if isinstance(array, np.ndarray):
                shape, dimensions, pointer = place
                struct.pack_into(f"<{dimensions}i", context.arguments, shape, *array.shape[:dimensions])
                struct.pack_into("<Q", context.arguments, pointer, _address(array))
        return context, _address(context.words)

    def set_number(self, context: "_Context", place: int, number: float) -> None:
        """Set argument `place` of a context."""
        pack_into = _pack_integer if isinstance(number, int) else _pack_float
        pack_into(context.arguments, *self._places[place], number)


class _Context:
    """Taichi's RuntimeContext: addresses of arguments and LLVMRuntime, a thread's number, an address for results."""

    __slots__ = ("_thread", "arguments", "words")

    def __init__(self, size: int, serial: bool):
        self._thread = _thread_arrays(serial)
        runtime, temporaries = self._thread
        self.arguments = np.zeros(max(8, size), np.uint8)
        self.words = np.array([_address(self.arguments), _address(runtime), 0, _address(temporaries)], np.uint64)


def _thread_arrays(serial: bool) -> tuple[np.ndarray, np.ndarray]:
    """LLVMRuntime and temporaries of this Python thread."""
    known = _THREAD.__dict__
    serial = serial or ALONE in known
    if serial not in known:
        runtime, temporaries = np.zeros(TEMPORARIES + 8, np.uint8), np.zeros(TEMPORARIES_SIZE, np.uint8)
        pool = _pool()
        loop = pool.serial_for if serial else pool.parallel_for
        for place, address in ((POOL, pool.address), (PARALLEL_FOR, loop), (TEMPORARIES, _address(temporaries))):
            struct.pack_into("<Q", runtime, place, address)
        known[serial] = runtime, temporaries
    return known[serial]


def run_loops_alone() -> None:
    """Let this Python thread run parallel loops without the pool, beside others that do so; results are the same."""
    _THREAD.__dict__[ALONE] = True


class _Pool:
    """The threads that run parallel loops, of which a loop at a time gets all."""

    def __init__(self) -> None:
        self._memory = np.zeros(POOL_SIZE, np.uint8)
        self.address = _address(self._memory)
        name = pool_name()
        code = kept(name)
        if code is None:
            code = target_machine().emit_object(_llvm().parse_assembly(_pool_source()))
            keep(kept_path(name), code)
        self.parallel_for, self.serial_for = _linked(code, "parallel_for"), _address_of("serial_for")
        self._start = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int, ctypes.c_int)(_address_of("start_pool"))
        self.start()
        os.register_at_fork(after_in_child=self.start)

    def start(self) -> None:
        """Start the threads: at first, and in a forked child, which has none."""
        self._memory[:] = 0
        self._start(self.address, THREADS, LOOKS if THREADS > 1 else 0)


_pool = functools.cache(_Pool)


def pool_name() -> str:
    """Name of the file with the machine code of the pool."""
    return f"pool-{hashlib.sha256(repr((_pool_source(), target())).encode()).hexdigest()[:32]}"


def _pool_source() -> str:
    return (HERE / "pool.ll").read_text()


def symbol(name: str) -> str:
    """The function in the object file of a kept kernel."""
    return name.replace("-", "_")


def kept_name(kernel: Any) -> str:
    """Name of a kernel's file, with a key of all that its machine code depends on."""
    parts = (_compiler_source(), kernel.thorough, *target(), _digest(kernel.function))
    return f"{kernel.__name__}-{hashlib.sha256(repr(parts).encode()).hexdigest()[:32]}"


@functools.cache
def _compiler_source() -> bytes:
    return (HERE / "compiler.py").read_bytes()


@functools.cache
def _digest(function: Callable[..., Any]) -> str:
    """A digest of a function's source, its annotations, and all that it refers to."""
    lines = linecache.getlines(function.__code__.co_filename)
    first, last = function.__code__.co_firstlineno, max(_line_numbers(function.__code__))
    if last > len(lines):
        raise TypeError(f"kernel or function {function.__qualname__}: its source is not in a file")
    parts = ["".join(lines[first - 1 : last])]
    for values in (function.__annotations__, references(function)):
        parts += [f"{name} = {_described(value)}" for name, value in sorted(values.items())]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def references(function: Callable[..., Any]) -> dict[str, Any]:
    """Values of the names outside a function that it uses."""
    cells = zip(function.__code__.co_freevars, function.__closure__ or (), strict=True)
    enclosed = {name: cell.cell_contents for name, cell in cells}
    names = {name for code in _codes(function.__code__) for name in code.co_names}
    return {name: function.__globals__[name] for name in names & function.__globals__.keys()} | enclosed


def _codes(code: CodeType) -> Iterator[CodeType]:
    """A code object and those nested in it."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _codes(constant)


def _line_numbers(code: CodeType) -> Iterator[int]:
    return (line for each in _codes(code) for _, _, line in each.co_lines() if line)


def _described(value: Any) -> str:
    """A text that differs where a value differs that a kernel refers to.

    Raises:
        TypeError: there is none for a value of this type.
    """
    if isinstance(value, Function):
        return _digest(value.function)
    if is_bundle(value):
        return f"{value.__name__}: {_described(tuple(value.__annotations__.items()))}"
    if isinstance(value, TaichiExpression | Arrays | int | float | str | np.generic | None):
        return repr(value)
    if isinstance(value, tuple | list):
        return f"[{', '.join(map(_described, value))}]"
    if isinstance(value, type) and issubclass(value, Enum):
        return repr(list(value))
    if isinstance(value, ModuleType):
        return value.__name__
    if hasattr(value, "__code__"):
        return _digest(value)
    if callable(value):  # a built-in function, a type, or a kernel whose name an attribute has
        return value.__name__
    raise TypeError(f"a kernel refers to {value!r}, and a {type(value).__name__} is not known not to change")


def kept(name: str) -> bytes | None:
    """What was kept under a name."""
    for folder in (SHIPPED, kept_folder("kernels")):
        if (data := read_kept(folder / f"{name}{SUFFIX}")) is not None:
            return data
    return None


def kept_path(name: str) -> Path:
    """The file in which a kernel is kept for other processes."""
    return kept_folder("kernels") / f"{name}{SUFFIX}"


@contextmanager
def locked(name: str, wait: bool) -> Iterator[bool]:
    """Within it no other process compiles the kernel of a name; yields False if one does and this one shall not wait.

    The lock is the operating system's, and ends with its process, however it ends.
    """
    import fcntl

    path = kept_folder("kernels") / f"{name}.lock"
    try:
        file = path.open("w")
    except OSError:  # nothing can be written there: everybody compiles
        yield True
        return
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        except OSError:  # another process has it, or the file system has no locks
            yield wait
            return
        yield True
        with suppress(OSError):
            path.unlink()


def _compiled(kernel: Any, name: str, compile_now: Callable[[str], bytes]) -> bytes:
    """Compile a kernel: one of ours with all others, in processes of their own, one of a user's here."""
    ours = kernel.function.__module__.startswith("taichisoft.")
    if ours:
        _tell_of_compilation()
    if ours and os.access(kept_folder("kernels"), os.W_OK):
        while any([helper.poll() is None for helper in _helpers()]):
            if (data := kept(name)) is not None:
                return data
            time.sleep(0.01)
    with locked(name, wait=True):
        data = kept(name)  # another process may have compiled it meanwhile
        if data is None:
            data = compile_now(name)
            keep(kept_path(name), data)
    return data


def compile_package() -> None:
    """Compile all kernels of the package that are not kept, on all cores."""
    for helper in _helpers():
        helper.wait()


@functools.cache
def _tell_of_compilation() -> None:
    print("taichisoft: compiles its kernels, once on this machine: 10 seconds or more", file=sys.stderr)


@functools.cache
def _helpers() -> list[subprocess.Popen[bytes]]:
    """Processes that compile all kernels of the package, one a core: Taichi's part of it is Python."""
    code = (
        f"import sys; sys.path[:] = {sys.path!r}\n"
        f"from taichisoft.runtime.compiler import compile_all; compile_all({os.getpid()})"
    )
    command = [sys.executable, "-P", "-c", code]
    null = subprocess.DEVNULL
    helpers = [subprocess.Popen(command, stdin=null, stdout=null, stderr=null) for _ in range(available_cores())]
    atexit.register(lambda: [helper.terminate() for helper in helpers])
    return helpers


@functools.cache
def _llvm() -> Any:
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    return llvm


def target_machine() -> Any:
    """LLVM's machine to compile for; every thread needs its own."""
    llvm = _llvm()
    cpu, features = target()
    return llvm.Target.from_default_triple().create_target_machine(
        cpu=cpu, features=features, opt=3, reloc="pic", codemodel="small"
    )


@functools.cache
def _engine() -> Any:
    """LLVM's loader of object files, which finds the functions of libm."""
    llvm = _llvm()
    llvm.load_library_permanently("libm.so.6")
    return llvm.create_mcjit_compiler(llvm.parse_assembly(""), target_machine())


def _linked(code: bytes, function: str) -> int:
    """Load an object file; the address of one of its functions."""
    engine = _engine()
    engine.add_object_file(_llvm().ObjectFileRef.from_data(code))
    engine.finalize_object()
    return _address_of(function)


def _address_of(function: str) -> int:
    return _engine().get_function_address(function)


def _address(array: np.ndarray) -> int:
    return array.__array_interface__["data"][0]
