"""What every room uses: files, child processes, text, expressions that users write, ranges of quantities."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
