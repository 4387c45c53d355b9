"""taichisoft simulates soft pneumatic grippers: finite elements, cavities, contact and friction."""

__version__ = "0.1.0"
