"""What makes Taichi usable: its start, launches, the cache of kernels, threads; arithmetic that several rooms share."""
