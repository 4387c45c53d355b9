"""Benchmarks (`python -m taichisoft_benchmarks`) and comparisons with measurements, run from a checkout."""
