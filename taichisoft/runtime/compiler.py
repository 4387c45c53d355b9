"""Kernels compiled: Taichi makes LLVM's language of them, and a newer LLVM makes machine code of that.

This module alone knows Taichi, whose version is pinned: its private interface, its files of compiled kernels (`*.tic`).
Taichi's kernels and functions are made here from ours, with Taichi's own objects in the place of the expressions of
language.py. A port to another version, or to a fork of Taichi, begins and ends here.

The machine code has the same bits on every processor. For that LLVM may not reassociate sums: the flag that lets it is
taken out of Taichi's text but for the sums of a vector's entries, whose order is a fixed one. No step is slower for it.
LLVM's own passes run once more, now that the text says that arguments are constant.
"""

import ast
import contextlib
import copy
import ctypes
import functools
import inspect
import io
import json
import os
import re
import shutil
import tempfile
import textwrap
import time
from collections.abc import Callable, Iterable, Iterator
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from threading import Lock
from types import CellType, FunctionType, SimpleNamespace
from typing import Any

import numpy as np

from taichisoft.base.files import cache_folder
from taichisoft.base.kept_files import keep
from taichisoft.errors import ForkedProcess, TaichisoftError
from taichisoft.runtime import machine_code
from taichisoft.runtime.language import KERNELS, THREADS, VARIABLE, Arrays, Function, TaichiExpression, is_bundle
from taichisoft.runtime.machine_code import references, symbol

os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")
os.environ.setdefault("TI_SKIP_VERSION_CHECK", "ON")  # a simulation asks nothing of the network

import taichi as ti
from taichi.lang import kernel_impl
from taichi.lang.ast.ast_transformer_utils import ASTTransformerContext

# Taichi's own analyses take four fifths of the time to compile, more than in proportion to a kernel's size, and LLVM
# does their work again. `Kernel.thorough` asks for them.
OPTIONS = {
    "arch": ti.cpu,
    "default_fp": ti.f64,
    "default_ip": ti.i32,
    "fast_math": True,
    "cfg_optimization": False,
    "offline_cache": True,
    "log_level": ti.ERROR,
}
# Taichi cuts a parallel loop into so many pieces, of at least 512 iterations: enough for any number of threads.
PIECES = 64
# Fields of LLVMRuntime that machine_code.py provides.
PROVIDED = {9, 10, 14}
# How long a process compiles before it writes what it has [s]; Taichi then ends and starts again, in 0.2 s.
BATCH = 1.5
OLD = 90 * 86400.0  # kernels of earlier versions are removed after this time [s]


def compile_all(parent: int) -> None:
    """Compile all kernels of the package that nobody has compiled or is compiling, until the process `parent` ends.

    Those in short files come first, so that nobody waits long for many.
    """
    missing = [(name, kernel) for name, kernel in package_kernels().items() if machine_code.kept(name) is None]
    missing.sort(key=lambda pair: Path(pair[1].function.__code__.co_filename).stat().st_size)

    def batch(locks: contextlib.ExitStack) -> Iterator[tuple[str, Any]]:
        started = time.monotonic()
        while missing and time.monotonic() - started < BATCH:
            name, kernel = missing.pop(0)
            if locks.enter_context(machine_code.locked(name, wait=False)) and machine_code.kept(name) is None:
                yield name, kernel

    while missing and os.getppid() == parent:
        with contextlib.ExitStack() as locks:
            for name, data in compile_kernels(batch(locks)).items():
                keep(machine_code.kept_path(name), data)
                if not machine_code.kept_path(name).exists():  # such as a disk that is full: nobody can wait for this
                    return


def ship() -> None:
    """Put the machine code of all kernels into the package, from where wheels take it, and nothing else.

    Raises:
        TaichisoftError: this processor is not of the level that wheels are for.
    """
    if machine_code.target() != machine_code.LEVEL:
        raise TaichisoftError(f"wheels are for {machine_code.LEVEL[0]}, and this processor is not of that level")
    machine_code.compile_package()
    shutil.rmtree(machine_code.SHIPPED, ignore_errors=True)
    machine_code.SHIPPED.mkdir()
    for name in [machine_code.pool_name(), *package_kernels()]:
        shutil.copy(machine_code.kept_path(name), machine_code.SHIPPED)


def package_kernels() -> dict[str, Any]:
    """All kernels of the package by the names under which they are kept."""
    package = Path(__file__).parents[1]
    for path in sorted(package.glob("*/kernels/*.py")):
        import_module(f"{package.name}.{path.parent.parent.name}.kernels.{path.stem}")
    return {machine_code.kept_name(kernel): kernel for kernel in KERNELS}


def compile_kernels(named: Iterable[tuple[str, Any]]) -> dict[str, bytes]:
    """Layout and machine code of kernels, by the names that come with them.

    Raises:
        TaichisoftError: a kernel uses something of Taichi that machine code does not have.
    """
    names = {}
    with tempfile.TemporaryDirectory(prefix="taichisoft-kernels-") as folder:
        _init(PIECES, folder)
        for name, kernel in named:
            names[f"{kernel.__name__}_c{_compile(kernel)[0].kernel_counter}"] = name
        ti.reset()  # Taichi writes what it has compiled
        texts = [_read(path) for path in sorted(Path(folder).glob("*.tic"))]
    return {
        names[meta["compiled_data"]["tasks"][0]["name"].split("_0_kernel_")[0]]: _machine_code(names, meta, text)
        for meta, text in texts
    }


def _compile(kernel: Any) -> tuple[Any, Any, Any]:
    """Taichi's kernel, and what it compiled of it."""
    primal = ti.kernel(_taichi_function(kernel.function, kernel))._primal
    arguments = [kind.empty if isinstance(kind, Arrays) else 0 for _, kind in kernel.flat]
    compiled = primal.compiled_kernels[primal.ensure_compiled(*arguments)]
    program = ti.lang.impl.get_runtime().prog
    config = program.config()
    config.advanced_optimization, config.opt_level = kernel.thorough, int(kernel.thorough)
    return primal, compiled, program.compile_kernel(config, program.get_device_caps(), compiled)


def _init(threads: int, folder: str) -> None:
    with contextlib.redirect_stdout(io.StringIO()):  # it prints which back end it starts
        ti.init(**OPTIONS, cpu_max_num_threads=threads, offline_cache_file_path=folder)


class TaichiKernel:
    """A kernel that Taichi runs, with the interface of MachineCode.

    Attributes:
        run: launches it with a context.
    """

    def __init__(self, kernel: Any):
        """Compile the kernel.

        Raises:
            ForkedProcess: the process was forked after Taichi had started.
        """
        _start_taichi()
        _, self._kernel, self._compiled = _compile(kernel)

    def make_context(self, flat: list[Any], serial: bool) -> tuple[Any, Any]:
        """What a launch gets, twice: the arrays among the arguments `flat`, but no number."""
        context = self._kernel.make_launch_context()
        for place, array in enumerate(flat):
            if isinstance(array, np.ndarray):
                address = array.__array_interface__["data"][0]
                context.set_arg_external_array_with_shape((place,), address, array.nbytes, array.shape, 0)
        return context, context

    def set_number(self, context: Any, place: int, number: float) -> None:
        """Set argument `place` of a context."""
        set_argument = context.set_arg_int if isinstance(number, int) else context.set_arg_float
        set_argument((place,), number)

    def run(self, context: Any) -> None:
        """Launch; Taichi has one program a process, and promises nothing to threads that launch at once."""
        _start_taichi()
        with _LAUNCHING:
            ti.lang.impl.get_runtime().prog.launch_kernel(self._compiled, context)


_LAUNCHING = Lock()


@functools.cache
def _started_by() -> int:
    """Start Taichi; the process in which it has threads."""
    _init(THREADS, str(cache_folder() / "taichi"))
    if hasattr(os, "register_at_fork"):  # Windows has no fork
        # To delete the program, a forked child would wait for threads that do not exist there, and its end would hang.
        program = ctypes.py_object(ti.lang.impl.get_runtime().prog)
        os.register_at_fork(after_in_child=lambda: ctypes.pythonapi.Py_IncRef(program))
    return os.getpid()


def _start_taichi() -> None:
    if _started_by() != os.getpid():
        raise ForkedProcess(
            "this process was forked after Taichi had started, and would wait for threads that it does not have; start "
            "processes with multiprocessing.get_context('spawn') or 'forkserver'"
        )


# Taichi's functions and kernels, made from ours


def _real(value: Any) -> Any:
    """Taichi's own object in the place of ours; anything else as it is."""
    if isinstance(value, TaichiExpression):
        return eval(repr(value), {"ti": ti})
    if isinstance(value, Arrays):
        return ti.types.ndarray(dtype=_real(value.dtype), ndim=value.ndim)
    if isinstance(value, Function):
        return _real_function(value)
    if type(value) in (tuple, list):
        return type(value)(map(_real, value))
    return value


@functools.cache
def _real_function(function: Function) -> Any:
    return ti.func(_taichi_function(function.function))


def _taichi_function(function: Callable[..., Any], kernel: Any = None) -> Callable[..., Any]:
    """A function as Taichi reads it; one of a kernel gets the arrays of bundles one by one."""
    used = {name: _real(value) for name, value in references(function).items()}
    bundles = (
        {} if kernel is None else {each.__name__: each for kind in kernel.bundles.values() for each in _nested(kind)}
    )
    made: Any = FunctionType(
        function.__code__,
        {**used, **bundles, "ti": ti},
        function.__name__,
        function.__defaults__,
        tuple(CellType(used[name]) for name in function.__code__.co_freevars),
    )
    made.__module__, made.__qualname__ = function.__module__, function.__qualname__
    made.__annotations__ = {
        name: ti.template() if is_bundle(kind) else _real(kind) for name, kind in function.__annotations__.items()
    }
    if kernel is not None:
        positional = inspect.Parameter.POSITIONAL_OR_KEYWORD
        made.bundles = kernel.bundles
        made.__signature__ = inspect.Signature(
            [inspect.Parameter(name, positional, annotation=_real(kind)) for name, kind in kernel.flat]
        )
    return made


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
        made = ast.parse(f"{parameter.arg} = ti.static({_rebuilt(parameter.arg, bundles[parameter.arg])})")
        definition.body.insert(0, made.body[0])
    definition.args.args = [ast.arg(name) for name in inspect.signature(function).parameters]
    for node in ast.walk(definition):
        if not hasattr(node, "lineno"):
            ast.copy_location(node, definition)
    return tree


def _rebuilt(name: str, kind: Any) -> str:
    """How a kernel makes a bundle of its parameters, which have the names of `launch._flattened`."""
    if not is_bundle(kind):
        return name
    return (
        f"{kind.__name__}({', '.join(_rebuilt(f'{name}_{field}', of) for field, of in kind.__annotations__.items())})"
    )


def _nested(kind: Any) -> list[Any]:
    """A bundle and all bundles in it."""
    return [kind, *(each for of in kind.__annotations__.values() if is_bundle(of) for each in _nested(of))]


def _short_position(context: Any, node: ast.AST) -> str:
    """File and line of a node of a kernel; Taichi prepares the text of every node for errors, most of its Python."""
    return f'File "{context.file}", line {node.lineno + context.lineno_offset}\n'


def _rewritten(read_tree: Callable[..., Any]) -> Callable[..., Any]:
    """Taichi's reading of a function, with what `_with_bundles` changes in a copy: Taichi keeps the tree."""

    def read(self: Any, *arguments: Any, **named: Any) -> Any:
        tree, context = read_tree(self, *arguments, **named)
        if named.get("is_kernel", True):
            tree = _with_bundles(self.func, copy.deepcopy(tree))
        return tree, context

    return read


# For every function Taichi asks inspect, which then looks through all modules, whether it stands in a class; and it
# looks for its source, wraps the lines for its messages and parses them again wherever it is called. What reads a tree
# may write into it only what every reading writes again.
ASTTransformerContext.get_pos_info = _short_position
kernel_impl._inside_class = lambda level_of_class_stackframe: False
kernel_impl.getsourcefile = functools.cache(kernel_impl.getsourcefile)
kernel_impl.getsourcelines = functools.cache(kernel_impl.getsourcelines)
kernel_impl.textwrap = SimpleNamespace(fill=lambda line, **_: line.rstrip(), dedent=textwrap.dedent)
kernel_impl.ast = SimpleNamespace(parse=functools.cache(ast.parse))
kernel_impl._get_tree_and_ctx = _rewritten(kernel_impl._get_tree_and_ctx)


# From Taichi's files to machine code


def _read(path: Path) -> tuple[dict[str, Any], str]:
    """Metadata and text in LLVM's language of a file `T<hash>.tic`; a checksum ends it."""
    data = path.read_bytes().decode("latin1")
    start = data.index("; ModuleID")
    meta, _ = json.JSONDecoder().raw_decode(data[data.index('{"args"') : start])
    return meta, re.sub(r"\n[0-9a-f]{64}\s*$", "\n", data[start:])


def _machine_code(names: dict[str, str], meta: dict[str, Any], text: str) -> bytes:
    """Layout and object file of a kernel."""
    tasks = [task["name"] for task in meta["compiled_data"]["tasks"]]
    taichi_name = tasks[0].split("_0_kernel_")[0]
    kernel = taichi_name.rsplit("_c", 1)[0]
    fields = {int(field) for field in re.findall(r"%struct\.LLVMRuntime[.\d]*\* %[\w.]+, i64 0, i32 (\d+)", text)}
    if not fields <= PROVIDED:
        raise TaichisoftError(
            f"kernel {kernel}: it asserts, prints or draws random numbers, which machine code does not; "
            f"{VARIABLE}=taichi runs it by Taichi"
        )
    places = []
    for argument in meta["args_type"]["content"]["elements_"]:
        kind, offset = argument["type"], argument["offset"]
        fields_of = kind["content"].get("elements_", []) if kind["type_kind"] == STRUCT else []
        inner = {field["name"]: field for field in fields_of}
        if inner:
            dimensions = len(inner["shape"]["type"]["content"]["elements_"])
            places.append([offset + inner["shape"]["offset"], dimensions, offset + inner["data_ptr"]["offset"]])
        else:
            places.append([offset])
    layout = json.dumps({"size": meta["args_size"], "places": places}).encode()
    return layout + b"\n" + _object_file(text, tasks, symbol(names[taichi_name]))


def _object_file(text: str, tasks: list[str], function: str) -> bytes:
    """Machine code whose only visible function runs all tasks of a kernel one after the other."""
    import llvmlite.binding as llvm

    lines = [
        line if "vector.reduce" in line else line.replace(" reassoc ", " ")
        for line in with_opaque_pointers(text).split("\n")
    ]
    calls = "".join(f"  call void @{task}(ptr %context)\n" for task in tasks)
    lines.append(f"define void @{function}(ptr %context) {{\n{calls}  ret void\n}}\n")
    machine = machine_code.target_machine()
    module = llvm.parse_assembly("\n".join(_with_constant_arguments(lines)), context=llvm.create_context())
    for each in module.functions:
        if not each.is_declaration and each.name != function:
            each.linkage = "internal"
    options = llvm.create_pipeline_tuning_options(speed_level=3)
    options.slp_vectorization, options.loop_vectorization = True, False
    builder = llvm.create_pass_builder(machine, options)
    builder.getModulePassManager().run(module, builder)
    return machine.emit_object(module)


# An argument's place in a launch, and a load from a place; the number of an empty entry of the module's metadata.
ADDRESS = re.compile(r"\s+(%[\w.]+) = getelementptr (?:inbounds )?%arguments, ptr (%[\w.]+),")
LOAD = re.compile(r"\s+(%[\w.]+) = load [^,]+, ptr (%[\w.]+)(?:, align \d+)?$")
CONSTANT = 99999


def _with_constant_arguments(lines: list[str]) -> list[str]:
    """A module that says that no launch changes its arguments, addresses of arrays above all.

    LLVM otherwise fears that each number written into an array changes the address of the next one: it reads the
    address again, and keeps apart what would be one vector.
    """
    starts = [number for number, line in enumerate(lines) if line.startswith("define")]
    marked = lines[: starts[0]]
    for start, stop in pairwise([*starts, len(lines)]):
        addresses = [found.groups() for found in map(ADDRESS.match, lines[start:stop]) if found]
        places, bases = {place for place, _ in addresses}, {base for _, base in addresses}
        for line in lines[start:stop]:
            load = LOAD.match(line)
            constant = load and (load[1] in bases or load[2] in places)
            marked.append(f"{line}, !invariant.load !{CONSTANT}" if constant else line)
    return [*marked, f"!{CONSTANT} = !{{}}"]


# Of Taichi's enumeration of types: what the layouts above need.
STRUCT = 3


# LLVM 17 and later have opaque pointers, Taichi's LLVM 15 writes typed ones: a `*` ends a pointer's type, and the type
# before it, however long, becomes `ptr`. Everything else of the text already says what opaque pointers need:
# getelementptr and load name the type that they work on, calls the type that they return. Names of overloaded
# intrinsics lose the pointed-to type: `v4p0f64` is `v4p0`.

TOKEN = re.compile(r'"[^"]*"|[%@!]?[-\w.$]+|[%@]"[^"]*"|\s+|\.\.\.|.')
SIMPLE = re.compile(r"(?<![\w.%@\"$-])(?:i\d+|double|float|void|%[-\w.$]+)\*+")
INTRINSIC = re.compile(r"@llvm\.[\w.]+")
OPENING = {"]": "[", ">": "<", "}": "{", ")": "("}


def with_opaque_pointers(text: str) -> str:
    """A module in the language of LLVM 15 in that of LLVM 17 and later."""
    arguments = re.search(r"getelementptr (?:inbounds )?(\{.+\}), \1\* %", text)
    if arguments:  # the type of all arguments, which nearly every line repeats
        text = text.replace(arguments[1], "%arguments").replace(
            "\n%struct.", f"\n%arguments = type {arguments[1]}\n%struct.", 1
        )
    lines = text.split("\n")
    for number, line in enumerate(lines):
        if "*" in line:
            line = SIMPLE.sub("ptr", line)
            if "*" in line and not line.startswith(";"):
                line = _collapsed(line)
        if "@llvm." in line:
            line = INTRINSIC.sub(lambda found: _name(found[0]), line)
        lines[number] = line
    return "\n".join(lines)


def _collapsed(line: str) -> str:
    """The line with every type that a `*` follows, and the `*`, replaced by `ptr`."""
    out: list[str] = []
    for token in TOKEN.findall(line):
        if token == "*":
            _drop_type(out)
            token = "ptr"
        out.append(token)
    return "".join(out)


def _drop_type(tokens: list[str]) -> None:
    """Remove the type at the end of the tokens."""
    last = tokens.pop()
    if last in OPENING:
        depth = 1
        while depth:
            token = tokens.pop()
            depth += (token == last) - (token == OPENING[last])
        if last == ")":  # parameters of a function: the type that it returns stands before them
            while tokens[-1].isspace():
                tokens.pop()
            _drop_type(tokens)


def _name(name: str) -> str:
    """An intrinsic's name without the types that its pointers point to."""
    return ".".join(re.sub(r"^((?:v\d+)?p0).+$", r"\1", part) for part in name.split("."))
