"""Whether this machine can draw and write videos: `python -m taichisoft_outputs.doctor_checks CHECK`.

Each check runs in a process of its own, since a driver may crash it or hang. It prints what was found, or ends with one
line on standard error that says what is wrong; what it needs is imported when it runs, so that nothing else can fail.
"""

import ctypes
import os
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from taichisoft.errors import TaichisoftError

EGL_VENDOR, EGL_VERSION = 0x3053, 0x3054
VULKAN_INSTANCE_CREATE_INFO = 1


def egl() -> str:
    """Version and vendor of what EGL draws with without a display: a picture that fails does not say."""
    os.environ.setdefault("EGL_PLATFORM", "surfaceless")  # as `stage` does before Open3D starts
    library = ctypes.CDLL("libEGL.so.1")
    library.eglGetDisplay.restype = ctypes.c_void_p
    library.eglGetDisplay.argtypes = [ctypes.c_void_p]
    library.eglInitialize.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p]
    library.eglQueryString.restype = ctypes.c_char_p
    library.eglQueryString.argtypes = [ctypes.c_void_p, ctypes.c_int]
    display = library.eglGetDisplay(None)
    if not display or not library.eglInitialize(display, None, None):
        raise OSError(f"no driver for EGL_PLATFORM={os.environ['EGL_PLATFORM']}")
    return ", ".join(library.eglQueryString(display, name).decode() for name in (EGL_VERSION, EGL_VENDOR))


class _DeviceProperties(ctypes.Structure):
    """VkPhysicalDeviceProperties: what is read of it, and room for the rest (824 bytes in Vulkan 1.0)."""

    _fields_ = [
        ("version", ctypes.c_uint32),
        ("driver", ctypes.c_uint32 * 4),  # version, vendor, device, type
        ("name", ctypes.c_char * 256),
        ("rest", ctypes.c_uint8 * 1024),
    ]


class _InstanceCreateInfo(ctypes.Structure):
    """VkInstanceCreateInfo, all zero but for its type: no layers, no extensions."""

    _fields_ = [("type", ctypes.c_uint64), ("rest", ctypes.c_uint64 * 7)]


def vulkan() -> str:
    """Version and name of the devices that Vulkan draws with."""
    library = ctypes.CDLL("libvulkan.so.1")
    instance, count = ctypes.c_void_p(), ctypes.c_uint32()
    wanted = _InstanceCreateInfo(type=VULKAN_INSTANCE_CREATE_INFO)
    if library.vkCreateInstance(ctypes.byref(wanted), None, ctypes.byref(instance)):
        raise OSError("no driver for Vulkan")
    library.vkEnumeratePhysicalDevices(instance, ctypes.byref(count), None)
    devices = (ctypes.c_void_p * count.value)()
    if library.vkEnumeratePhysicalDevices(instance, ctypes.byref(count), devices) or not count.value:
        raise OSError("no device that Vulkan can draw with")
    found = []
    for device in devices:
        properties = _DeviceProperties()
        library.vkGetPhysicalDeviceProperties(ctypes.c_void_p(device), ctypes.byref(properties))
        major, minor = properties.version >> 22, properties.version >> 12 & 0x3FF
        found.append(f"{major}.{minor}, {properties.name.decode(errors='replace')}")
    return "; ".join(found)


def picture() -> str:
    """Draw a tetrahedron that can be seen."""
    import numpy as np

    from taichisoft_outputs.drawing.camera import fit_camera
    from taichisoft_outputs.drawing.stage import EMPTY, Stage

    corners = np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [0.0, 10.0, 0.0], [0.0, 0.0, 10.0]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    size = (160, 90)
    stage = Stage(size)
    stage.put("tetrahedron", corners, faces, np.tile([0.2, 0.4, 0.8], (4, 1)))
    drawn = stage.image(fit_camera(corners, np.array([0.0, 0.0, 1.0]), "iso", size[0] / size[1]), ["tetrahedron"])
    if (drawn == EMPTY).all():
        raise RuntimeError("the picture is blank")
    return "drawn off-screen"


def video() -> str:
    """Write three pictures as MP4; what ffmpeg calls itself, and where it is."""
    import numpy as np

    from taichisoft_outputs.rendering.video import ffmpeg_program, open_video

    size = (64, 36)
    with TemporaryDirectory() as folder:
        path = Path(folder) / "video.mp4"
        with open_video(path, size, fps=30.0) as add_picture:
            for level in (0, 100, 200):
                add_picture(np.full((size[1], size[0], 3), level, np.uint8))
        if not path.stat().st_size:
            raise RuntimeError("ffmpeg wrote an empty file")
    program = ffmpeg_program()
    answer = subprocess.run([program, "-version"], capture_output=True, text=True, errors="replace", timeout=20)
    words = answer.stdout.split()
    return f"{words[2] if len(words) > 2 else 'unknown version'} in {program}"


if __name__ == "__main__":
    answer = os.fdopen(os.dup(1), "w")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # the renderer prints there, too
    try:
        print({"egl": egl, "vulkan": vulkan, "picture": picture, "video": video}[sys.argv[1]](), file=answer)
    except (ImportError, OSError, RuntimeError, TaichisoftError) as error:
        sys.exit(str(error))
