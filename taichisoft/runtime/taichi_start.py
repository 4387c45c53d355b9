"""Taichi's start, once per process, and the array types that kernels take.

Everything runs in double precision on the CPU. `TAICHISOFT_THREADS` sets the number of threads: otherwise all cores, or
one in a process that multiprocessing started, which has others beside it. Results do not depend on it, because every
sum is gathered in a fixed order by one owner.

In a parallel loop Taichi turns `array[i] += x` into an atomic operation, which neither vectorises nor keeps its
order: kernels write `array[i] = array[i] + x` where one task owns the entry.

With fast_math LLVM may assume that there is no NaN, so kernels cannot be trusted to find one. They need not: every
new state is checked with numpy's isfinite on the host before it is accepted (divergence.py), and comparisons with
NaN inside kernels do no more than end loops.
"""

import ast
import atexit
import contextlib
import ctypes
import functools
import io
import multiprocessing
import os
import sys
import textwrap
from types import SimpleNamespace
from typing import Any

from taichisoft.errors import TaichisoftError
from taichisoft.runtime.first_process import left_kernels, wait_for_kernels
from taichisoft.runtime.kernel_cache import alone_with_kernels, has_kernels  # before Taichi, which needs a home

os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")
os.environ.setdefault("TI_SKIP_VERSION_CHECK", "ON")  # a simulation asks nothing of the network

import taichi as ti
from taichi.lang import kernel_impl
from taichi.lang.ast.ast_transformer_utils import ASTTransformerContext


def thread_count(setting: str) -> int:
    """The number of threads that the environment variable TAICHISOFT_THREADS asks for.

    Raises:
        TaichisoftError: it is no whole number, or negative.
    """
    if not (setting.isascii() and setting.strip().isdigit()):
        raise TaichisoftError(
            f"TAICHISOFT_THREADS = '{setting}': must be a whole number of threads, 1 or more, or 0 for all cores"
        )
    return int(setting) or available_cores()


def available_cores() -> int:
    """Cores that this process may use; more threads would only wait for one another."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _short_position(context: Any, node: ast.AST) -> str:
    """File and line of a node of a kernel.

    Taichi prepares the source text of every node, wrapped and underlined, in case of an error. Without it the gripper
    takes 7.1 instead of 8.8 s of processor time up to its first step, with a filled cache.
    """
    return f'File "{context.file}", line {node.lineno + context.lineno_offset}\n'


ASTTransformerContext.get_pos_info = _short_position

# For every function Taichi asks inspect, which then looks through all modules, whether it stands in a class; and it
# looks for its source, wraps the lines for its messages and parses them again wherever it is called. Without that the
# first step takes 1.7 s of 12 less. What reads a tree may write into it only what every reading writes anew.
kernel_impl._inside_class = lambda level_of_class_stackframe: False
kernel_impl.getsourcefile = functools.cache(kernel_impl.getsourcefile)
kernel_impl.getsourcelines = functools.cache(kernel_impl.getsourcelines)
kernel_impl.textwrap = SimpleNamespace(fill=lambda line, **_: line.rstrip(), dedent=textwrap.dedent)
kernel_impl.ast = SimpleNamespace(parse=functools.cache(ast.parse))

USUAL_THREADS = "0" if multiprocessing.parent_process() is None else "1"
THREADS = thread_count(os.environ.get("TAICHISOFT_THREADS") or USUAL_THREADS)

wait_for_kernels(THREADS)
if not has_kernels():  # else a script would stand still without a word
    print("taichisoft: the first time on a machine Taichi compiles its kernels: 15 seconds or more", file=sys.stderr)


def _start() -> None:
    # Taichi's own analysis of the flow of control takes two thirds of the time to compile, more than in proportion to a
    # kernel's size, and LLVM does its work again: without it no step is slower.
    with contextlib.redirect_stdout(io.StringIO()):  # it prints which back end it starts
        ti.init(
            arch=ti.cpu,
            default_fp=ti.f64,
            default_ip=ti.i32,
            cpu_max_num_threads=THREADS,
            fast_math=True,
            cfg_optimization=False,
            offline_cache=True,
            log_level=ti.WARN,
        )


with alone_with_kernels():
    _start()


def restart() -> None:
    """End Taichi, which leaves its kernels to other processes, and start it again without any kernel."""
    with alone_with_kernels():
        ti.reset()
        left_kernels(THREADS)
        _start()


STARTED_BY = os.getpid()


@atexit.register
def _finish() -> None:
    """Let Taichi write its list of kernels; a forked child has none of its own."""
    if os.getpid() == STARTED_BY:
        with alone_with_kernels():
            ti.reset()
            left_kernels(THREADS)


def _leave_program_alone() -> None:
    """Keep Taichi's program in a forked child for ever: to delete it, the child would wait for threads that are not
    there, and so its end would hang."""
    program = ti.lang.impl.get_runtime().prog
    ctypes.pythonapi.Py_IncRef(ctypes.py_object(program))


if hasattr(os, "register_at_fork"):  # Windows has no fork
    os.register_at_fork(after_in_child=_leave_program_alone)


# On the CPU Taichi 1.7.4 cuts a parallel loop into one stretch of iterations a thread, of at least 512, whatever
# block_dim says. A loop over THREADS * CHUNK that works only where the index is a multiple of CHUNK runs once on each
# thread; there the threads take tasks in turn by a counter.
CHUNK = 512

# What carries a vertex of a surface: the number of a rigid body, or one of these.
STATIC = -1
SOFT = -2

vec3 = ti.types.vector(3, ti.f64)
mat3 = ti.types.matrix(3, 3, ti.f64)

Integers = ti.types.ndarray(dtype=ti.i32, ndim=1)
IntegerTable = ti.types.ndarray(dtype=ti.i32, ndim=2)
IntegerBlocks = ti.types.ndarray(dtype=ti.i32, ndim=3)
Scalars = ti.types.ndarray(dtype=ti.f64, ndim=1)
ScalarTable = ti.types.ndarray(dtype=ti.f64, ndim=2)
ScalarBlocks = ti.types.ndarray(dtype=ti.f64, ndim=3)
Vectors = ti.types.ndarray(dtype=vec3, ndim=1)
VectorTable = ti.types.ndarray(dtype=vec3, ndim=2)
VectorBlocks = ti.types.ndarray(dtype=vec3, ndim=3)
Matrices = ti.types.ndarray(dtype=mat3, ndim=1)
