"""The laboratory, run from a checkout: benchmarks (`python -m taichisoft_benchmarks`), studies and tries of faults."""
