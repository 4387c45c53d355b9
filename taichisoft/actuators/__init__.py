"""What drives soft bodies: one module for each kind of actuator, and all actuators of a model together."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
