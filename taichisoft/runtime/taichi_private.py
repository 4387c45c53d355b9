"""All that is used of Taichi's private interface, which is why Taichi's version is pinned.

A port to another version, or to a fork of Taichi, begins here. Taichi is imported here, once the environment is ready.

Launches go past Taichi's own `Kernel.__call__`, which takes 10 microseconds for each array (`launch.py`). Compilation
goes past what Taichi does for its error messages, which is most of the Python in it. Beside this file,
`kernel_cache.py` knows two names of files that Taichi writes.
"""

import ast
import copy
import ctypes
import functools
import os
import textwrap
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

import numpy as np

from taichisoft.runtime import kernel_cache  # noqa: F401  before Taichi, which needs a home

os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")
os.environ.setdefault("TI_SKIP_VERSION_CHECK", "ON")  # a simulation asks nothing of the network

import taichi as ti
from taichi.lang import kernel_impl
from taichi.lang.ast.ast_transformer_utils import ASTTransformerContext


def _short_position(context: Any, node: ast.AST) -> str:
    """File and line of a node of a kernel.

    Taichi prepares the source text of every node, wrapped and underlined, in case of an error. Without it the gripper
    takes 7.1 instead of 8.8 s of processor time up to its first step, with a filled cache.
    """
    return f'File "{context.file}", line {node.lineno + context.lineno_offset}\n'


ASTTransformerContext.get_pos_info = _short_position

# For every function Taichi asks inspect, which then looks through all modules, whether it stands in a class; and it
# looks for its source, wraps the lines for its messages and parses them again wherever it is called. Without that the
# first step takes 1.7 s of 12 less. What reads a tree may write into it only what every reading writes again.
kernel_impl._inside_class = lambda level_of_class_stackframe: False
kernel_impl.getsourcefile = functools.cache(kernel_impl.getsourcefile)
kernel_impl.getsourcelines = functools.cache(kernel_impl.getsourcelines)
kernel_impl.textwrap = SimpleNamespace(fill=lambda line, **_: line.rstrip(), dedent=textwrap.dedent)
kernel_impl.ast = SimpleNamespace(parse=functools.cache(ast.parse))


def rewrite_kernels(rewrite: Callable[[Callable[..., Any], ast.Module], ast.Module]) -> None:
    """Let `rewrite` change the syntax tree of each kernel before Taichi compiles it; it gets a copy of the tree."""
    read_tree = kernel_impl._get_tree_and_ctx

    def read(self: Any, *arguments: Any, **named: Any) -> Any:
        tree, context = read_tree(self, *arguments, **named)
        if named.get("is_kernel", True):
            tree = rewrite(self.func, copy.deepcopy(tree))  # Taichi keeps the tree for the next reading
        return tree, context

    kernel_impl._get_tree_and_ctx = read


class CompiledKernel:
    """A kernel compiled for the types of its arguments."""

    def __init__(self, kernel: Any, arguments: Sequence[Any]):
        """Compile what `ti.kernel` made for these arguments: arrays without entries, and numbers."""
        primal = kernel._primal
        self._kernel = primal.compiled_kernels[primal.ensure_compiled(*arguments)]
        self._program = _program()
        capabilities = self._program.get_device_caps()
        self._compiled = self._program.compile_kernel(self._program.config(), capabilities, self._kernel)

    def make_context(self) -> Any:
        """The arguments of a launch, none of them set."""
        return self._kernel.make_launch_context()

    def launch(self, context: Any) -> None:
        """Run the kernel; returns when it has ended."""
        self._program.launch_kernel(self._compiled, context)


def set_array(context: Any, place: int, array: np.ndarray, outer_dimensions: int) -> None:
    """Hand over an array as argument `place`; its last dimensions may be the dimensions of vectors or matrices."""
    address = array.__array_interface__["data"][0]
    context.set_arg_external_array_with_shape((place,), address, array.nbytes, array.shape[:outer_dimensions], 0)


def set_number(context: Any, place: int, kind: type, number: float) -> None:
    """Hand over a number of type int or float as argument `place`."""
    if kind is int:
        context.set_arg_int((place,), int(number))
    else:
        context.set_arg_float((place,), float(number))


@contextmanager
def timed_launches(add: Callable[[float], None]) -> Iterator[None]:
    """Within it, `add` gets the seconds of every launch, without the Python around it; outside nothing costs."""
    launch = CompiledKernel.launch

    def timed(self: CompiledKernel, context: Any) -> None:
        started = time.perf_counter()
        launch(self, context)
        add(time.perf_counter() - started)

    CompiledKernel.launch = timed  # type: ignore[method-assign]
    try:
        yield
    finally:
        CompiledKernel.launch = launch  # type: ignore[method-assign]


def keep_program() -> None:
    """Keep Taichi's program in a forked child for ever: to delete it, the child would wait for threads that do not
    exist there, and its end would hang."""
    ctypes.pythonapi.Py_IncRef(ctypes.py_object(_program()))


def _program() -> Any:
    return ti.lang.impl.get_runtime().prog
