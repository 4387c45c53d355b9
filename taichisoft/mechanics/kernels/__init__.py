"""Taichi kernels; see CONTRIBUTING.md for how one is written."""
