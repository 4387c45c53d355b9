"""The Debian and Ubuntu packages whose libraries the wheels of Taichi, gmsh and Open3D load."""

import re
from dataclasses import dataclass


@dataclass(frozen=True)
class SystemLibrary:
    """A package of the system.

    Attributes:
        package: its name for apt-get.
        file: the shared library that is loaded from it; empty for a driver, which is found by other ways.
        needed_by: import names of the Python packages that need it.
    """

    package: str
    file: str
    needed_by: tuple[str, ...]


SYSTEM_LIBRARIES = (
    SystemLibrary("libx11-6", "libX11.so.6", ("taichi", "gmsh", "open3d")),
    SystemLibrary("libgl1", "libGL.so.1", ("gmsh", "open3d")),
    SystemLibrary("libglu1-mesa", "libGLU.so.1", ("gmsh",)),
    SystemLibrary("libxcursor1", "libXcursor.so.1", ("gmsh",)),
    SystemLibrary("libxinerama1", "libXinerama.so.1", ("gmsh",)),
    SystemLibrary("libxft2", "libXft.so.2", ("gmsh",)),
    SystemLibrary("libgomp1", "libgomp.so.1", ("open3d",)),
    SystemLibrary("libegl1", "libEGL.so.1", ("open3d",)),
    SystemLibrary("libudev1", "libudev.so.1", ("open3d",)),
    SystemLibrary("libgl1-mesa-dri", "", ("open3d",)),
)


def packages_for(problem: str, module: str) -> list[str]:
    """The packages to install when `module` fails with `problem`.

    The loader names one missing library at a time; when it names none of ours, these are all that the module needs.
    """
    named = re.search(r"lib[\w+-]+\.so(\.\d+)*", problem)
    exact = [library.package for library in SYSTEM_LIBRARIES if named and library.file == named[0]]
    return exact or [library.package for library in SYSTEM_LIBRARIES if module in library.needed_by]


def install_line(packages: list[str]) -> str:
    """The command that installs packages."""
    return f"sudo apt-get install --no-install-recommends {' '.join(packages)}"
