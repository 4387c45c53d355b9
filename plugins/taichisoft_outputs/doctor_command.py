"""The command `taichisoft doctor`: is everything there that taichisoft needs from this machine?"""

import ctypes
import math
import os
import platform
import re
import subprocess
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib.metadata import metadata
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import typer

from taichisoft.base import WHOLE, cache_folder, extra, last_line, run_python, say
from taichisoft.errors import TaichisoftError
from taichisoft_outputs.system_libraries import SYSTEM_LIBRARIES, graphics, install_line, packages_for

# Whether this machine can draw and write videos: `python -m taichisoft_outputs.doctor_command CHECK`.
#
# Each check runs in a process of its own, since a driver may crash it or hang. It prints what was found, or ends with
# one line on standard error that says what is wrong; what it needs is imported when it runs, so that nothing else can
# fail.

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
    """Write three frames as MP4; what ffmpeg calls itself, and where it is."""
    import numpy as np

    from taichisoft_outputs.rendering.video import ffmpeg_program, open_video

    size = (64, 36)
    with TemporaryDirectory() as folder:
        path = Path(folder) / "video.mp4"
        with open_video(path, size, fps=30.0) as add_frame:
            for level in (0, 100, 200):
                add_frame(np.full((size[1], size[0], 3), level, np.uint8))
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


TIME_LIMIT = 12.0
"""Time that all checks together may take [s]; the command itself takes less than one more, or 7 on a busy machine."""
LATE = "no answer within"
LIBRARY_TIME_LIMIT = 5.0
"""Longest time to load one library [s]."""

WORKERS = 4
"""Checks at a time."""

CHECK = ("-m", "taichisoft_outputs.doctor_command")
PROGRAMS: dict[str, tuple[Sequence[str], str]] = {
    "taichi": (
        ("-c", "import taichi; taichi.init(arch=taichi.cpu); print(*taichi.__version__, sep='.')"),
        "taichi",
    ),
    "gmsh": (("-c", "import gmsh; gmsh.initialize(); print(gmsh.__version__)"), "gmsh"),
    "h5py": (("-c", "import h5py; print(h5py.__version__)"), "h5py"),
    "matplotlib": (
        ("-c", "import matplotlib as m; m.use('Agg'); import matplotlib.pyplot; print(m.__version__)"),
        "matplotlib",
    ),
    "open3d": (("-c", "import open3d; print(open3d.__version__)"), "open3d"),
    "viser": (("-c", "import viser; print(viser.__version__)"), "viser"),
    graphics(): ((*CHECK, graphics().lower()), "open3d"),
    "picture": ((*CHECK, "picture"), "open3d"),
    "ffmpeg": ((*CHECK, "video"), ""),
}
"""By what is looked at, the arguments of a Python process whose last line of output is the answer, and the module whose
system libraries are missing when it fails."""

OPTIONAL = {
    "gmsh": f"meshing needs it: {WHOLE}",
    "matplotlib": f"plots and reports of meshes need it: {WHOLE}",
    "open3d": f"pictures need it: {WHOLE}",
    "viser": f"`taichisoft run --web` needs it: {extra('web')}",
}
"""Modules that need not be there, with what they are for and how to get them."""


@dataclass(frozen=True)
class Finding:
    """One row of the answer.

    Attributes:
        subject: what was looked at.
        found: a version, or what is wrong.
        ok: whether it will do.
        packages: what apt-get should install; empty when that would not help.
        needed: whether taichisoft cannot do without it.
    """

    subject: str
    found: str
    ok: bool
    packages: tuple[str, ...] = ()
    needed: bool = True

    @property
    def verdict(self) -> str:
        """The word that begins the row."""
        if self.found.startswith(LATE):
            return "late"
        return "ok" if self.ok else "MISSING" if self.needed else "without"


def doctor(
    time_limit: Annotated[
        float, typer.Option(min=1.0, help="Time that all checks may take together \\[s].")
    ] = TIME_LIMIT,
) -> None:
    """Check Python, the compiled libraries, off-screen drawing and videos; say what to install."""
    findings = examine(time_limit)
    width = max(len(finding.subject) for finding in findings)
    for finding in findings:
        say(f"{finding.verdict:7} {finding.subject:{width}}  {finding.found}")
    packages = sorted({package for finding in findings for package in finding.packages})
    if packages:
        typer.echo(f"\nOn Debian and Ubuntu: {install_line(packages)}")
    if not all(finding.ok for finding in findings if finding.needed):
        raise typer.Exit(1)


def examine(time_limit: float = TIME_LIMIT) -> list[Finding]:
    """All findings, in the order in which they are shown, after so many seconds at most."""
    cache_folder()  # sets a cache folder for Taichi if the user has no home folder
    deadline = time.monotonic() + time_limit
    # A running check ends at the deadline; later checks do not start.
    with ThreadPoolExecutor(max_workers=WORKERS) as pool:
        jobs = [pool.submit(_examine, subject, deadline) for subject in PROGRAMS]
        jobs.append(pool.submit(_examine_libraries, deadline))
    return [_examine_python(), *(job.result() for job in jobs)]


def _examine_python() -> Finding:
    limits = dict(re.findall(r"(>=|<)(\d+\.\d+)", metadata("taichisoft")["Requires-Python"]))
    lowest, above = (tuple(map(int, limits[sign].split("."))) for sign in (">=", "<"))
    ok = lowest <= sys.version_info[:2] < above
    needed = "" if ok else f" (from {limits['>=']}, below {limits['<']})"
    return Finding("python", platform.python_version() + needed, ok)


def _time_left(deadline: float) -> float:
    """Time [s] until a moment of the clock, and a little more where it has passed: what is asked then has no chance."""
    return min(max(deadline - time.monotonic(), 0.1), 3600.0)


def _examine(subject: str, deadline: float = math.inf) -> Finding:
    """Run one of PROGRAMS, until a moment of the clock at most."""
    if subject == graphics() and sys.platform != "linux":
        return Finding(subject, "only needed on Linux", True)
    if subject == graphics() and find_spec("open3d") is None:
        return Finding(subject, "not needed without open3d", True)
    arguments, module = PROGRAMS[subject]
    child = run_python(arguments, _time_left(deadline))
    if not child.problem:
        return Finding(subject, last_line(child.output), True)
    if module in OPTIONAL and f"No module named '{module}'" in child.problem:
        return Finding(subject, f"not installed; {OPTIONAL[module]}", False, needed=False)
    if child.problem.startswith(LATE):
        hint = "the check hangs, or the machine is busy: --time-limit 120 waits longer"
        return Finding(subject, f"{LATE} the time limit; {hint}", False)
    needed = subject != "ffmpeg" or find_spec("imageio_ffmpeg") is not None  # left out where the engine is alone
    packages = tuple(packages_for(child.problem, module)) if module else ()
    return Finding(subject, child.problem, False, packages, needed)


def _examine_libraries(deadline: float = math.inf) -> Finding:
    """Try all libraries at once: an import stops at the first one that is missing."""
    if sys.platform != "linux":
        return Finding("libraries", "only looked at on Linux", True)
    loads = "import ctypes; ctypes.CDLL('{}')".format
    missing = []
    for library in SYSTEM_LIBRARIES:
        if not any(map(find_spec, library.needed_by)):
            continue
        limit = min(LIBRARY_TIME_LIMIT, _time_left(deadline))
        problem = run_python(["-c", loads(library.file)], limit).problem if library.file else ""
        if problem.startswith(LATE):
            return Finding("libraries", f"{LATE} the time limit; not all were looked at", False)
        if problem:
            missing.append(library)
    found = ", ".join(library.file for library in missing) or "all found"
    return Finding("libraries", found, not missing, tuple(library.package for library in missing))
