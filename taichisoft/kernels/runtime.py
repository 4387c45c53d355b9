"""Taichi's start, once per process, and the array types that kernels take.

Everything runs in double precision on the CPU. `TAICHISOFT_THREADS` sets the number of threads (all cores
otherwise); results do not depend on it, because every sum is gathered in a fixed order by one owner.

In a parallel loop Taichi turns `array[i] += x` into an atomic operation, which neither vectorises nor keeps its
order: kernels write `array[i] = array[i] + x` where one task owns the entry.
"""

import contextlib
import io
import os

os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")
os.environ.setdefault("TI_SKIP_VERSION_CHECK", "ON")  # a simulation asks nothing of the network

import taichi as ti

THREADS = int(os.environ.get("TAICHISOFT_THREADS", "0")) or os.cpu_count() or 1

with contextlib.redirect_stdout(io.StringIO()):  # ti.init prints which back end it starts
    ti.init(
        arch=ti.cpu,
        default_fp=ti.f64,
        default_ip=ti.i32,
        cpu_max_num_threads=THREADS,
        fast_math=True,
        offline_cache=True,
        log_level=ti.WARN,
    )

# On the CPU Taichi 1.7.4 hands out loop iterations in chunks of 512, whatever block_dim says. A loop over
# tasks * CHUNK that works only where the index is a multiple of CHUNK runs its tasks in parallel.
CHUNK = 512

vec3 = ti.types.vector(3, ti.f64)
mat3 = ti.types.matrix(3, 3, ti.f64)

Integers = ti.types.ndarray(dtype=ti.i32, ndim=1)
IntegerTable = ti.types.ndarray(dtype=ti.i32, ndim=2)
Scalars = ti.types.ndarray(dtype=ti.f64, ndim=1)
ScalarTable = ti.types.ndarray(dtype=ti.f64, ndim=2)
Vectors = ti.types.ndarray(dtype=vec3, ndim=1)
VectorTable = ti.types.ndarray(dtype=vec3, ndim=2)
VectorBlocks = ti.types.ndarray(dtype=vec3, ndim=3)
Matrices = ti.types.ndarray(dtype=mat3, ndim=1)
