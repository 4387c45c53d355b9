"""Taichi kernels: the only modules that import taichi. They take and fill numpy arrays."""

from taichisoft.kernels import kernel_cache  # noqa: F401  before Taichi, which ends a process that has no home
