"""Taichi kernels: the only modules that import taichi. They take and fill numpy arrays."""
