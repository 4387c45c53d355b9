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

import atexit
import contextlib
import io
import multiprocessing
import os
import sys

from taichisoft.errors import TaichisoftError
from taichisoft.runtime.first_process import left_kernels, wait_for_kernels
from taichisoft.runtime.kernel_cache import alone_with_kernels, has_kernels
from taichisoft.runtime.taichi_private import keep_program, ti


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


def restart_taichi() -> None:
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


if hasattr(os, "register_at_fork"):  # Windows has no fork
    os.register_at_fork(after_in_child=keep_program)


# On the CPU Taichi 1.7.4 cuts a parallel loop into one stretch of iterations a thread, of at least 512, whatever
# block_dim says. A loop over THREADS * CHUNK that works only where the index is a multiple of CHUNK runs once on each
# thread; there the threads take tasks in turn by a counter.
CHUNK = 512

# A vertex of a surface is carried by the rigid body of its number, or by one of:
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
