"""Asks EGL what it draws with on a machine without a display: `python -m taichisoft_plugins.doctor.egl_check`."""

import ctypes
import os
import sys

VENDOR, VERSION = 0x3053, 0x3054


def main() -> None:
    """Print version and vendor; exit code 0 when EGL could be initialised."""
    os.environ.setdefault("EGL_PLATFORM", "surfaceless")  # as `stage` does before Open3D starts
    try:
        library = ctypes.CDLL("libEGL.so.1")
    except OSError as error:
        sys.exit(str(error))
    library.eglGetDisplay.restype = ctypes.c_void_p
    library.eglGetDisplay.argtypes = [ctypes.c_void_p]
    library.eglInitialize.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p]
    library.eglQueryString.restype = ctypes.c_char_p
    library.eglQueryString.argtypes = [ctypes.c_void_p, ctypes.c_int]
    display = library.eglGetDisplay(None)
    if not display or not library.eglInitialize(display, None, None):
        sys.exit(f"no driver for EGL_PLATFORM={os.environ['EGL_PLATFORM']}")
    print(*(library.eglQueryString(display, name).decode() for name in (VERSION, VENDOR)), sep=", ")


if __name__ == "__main__":
    main()
