"""What makes Taichi usable: its start, launches, the cache of kernels, threads; arithmetic that several rooms share."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
