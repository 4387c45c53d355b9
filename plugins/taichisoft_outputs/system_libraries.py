"""The Debian and Ubuntu packages whose libraries the wheels of Taichi, gmsh and Open3D load."""

import re
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version


@dataclass(frozen=True)
class SystemLibrary:
    """A package of the system.

    Attributes:
        package: its name for apt-get.
        file: the shared library that is loaded from it; empty for a driver whose file's name depends on the system.
        needed_by: import names of the Python packages that need it.
    """

    package: str
    file: str
    needed_by: tuple[str, ...]


def graphics() -> str:
    """What the installed Open3D draws with off screen: "EGL" before version 0.20, "Vulkan" from then on."""
    for distribution in ("open3d-cpu", "open3d"):
        try:
            installed = version(distribution)
        except PackageNotFoundError:
            continue
        major, minor = map(int, installed.split(".")[:2])
        return "EGL" if (major, minor) < (0, 20) else "Vulkan"
    return "Vulkan"


_OFTEN_NEEDED = (
    SystemLibrary("libx11-6", "libX11.so.6", ("taichi", "gmsh", "open3d")),
    SystemLibrary("libgl1", "libGL.so.1", ("gmsh", "open3d")),
    SystemLibrary("libglu1-mesa", "libGLU.so.1", ("gmsh",)),
    SystemLibrary("libxcursor1", "libXcursor.so.1", ("gmsh",)),
    SystemLibrary("libxinerama1", "libXinerama.so.1", ("gmsh",)),
    SystemLibrary("libxft2", "libXft.so.2", ("gmsh",)),
    SystemLibrary("libgomp1", "libgomp.so.1", ("gmsh", "open3d")),
    SystemLibrary("libegl1", "libEGL.so.1", ("open3d",)),
    SystemLibrary("libudev1", "libudev.so.1", ("open3d",)),
)
_DRAWING = {
    "EGL": (SystemLibrary("libgl1-mesa-dri", "", ("open3d",)),),
    "Vulkan": (
        SystemLibrary("libidn2-0", "libidn2.so.0", ("open3d",)),
        SystemLibrary("libusb-1.0-0", "libusb-1.0.so.0", ("open3d",)),
        SystemLibrary("libvulkan1", "libvulkan.so.1", ("open3d",)),
        SystemLibrary("mesa-vulkan-drivers", "libvulkan_lvp.so", ("open3d",)),
    ),
}
SYSTEM_LIBRARIES = (*_OFTEN_NEEDED, *_DRAWING[graphics()])
"""What the installed wheels need; the packages have these names in Debian 12 and 13 and in Ubuntu."""


def packages_for(problem: str, module: str) -> list[str]:
    """The packages to install when `module` fails with `problem`.

    The loader names one missing library at a time; when it names none of ours, these are all that the module needs.
    """
    named = re.search(r"lib[\w.+-]+?\.so(\.\d+)*", problem)
    exact = [library.package for library in SYSTEM_LIBRARIES if named and library.file == named[0]]
    return exact or [library.package for library in SYSTEM_LIBRARIES if module in library.needed_by]


def install_line(packages: list[str]) -> str:
    """The command that installs packages."""
    return f"sudo apt-get install --no-install-recommends {' '.join(packages)}"
