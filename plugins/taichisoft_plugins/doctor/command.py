"""The command `taichisoft doctor`: is everything there that taichisoft needs from this machine?"""

import platform
import re
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib.metadata import metadata

import typer

from taichisoft.child_process import run_python
from taichisoft_plugins.system_libraries import SYSTEM_LIBRARIES, install_line, packages_for

TIME_LIMIT = 90.0
"""Longest duration of an import or a check [s]."""

IMPORTS = {
    "taichi": "import taichi; taichi.init(arch=taichi.cpu); print(*taichi.__version__, sep='.')",
    "gmsh": "import gmsh; gmsh.initialize(); print(gmsh.__version__)",
    "h5py": "import h5py; print(h5py.__version__)",
    "matplotlib": "import matplotlib; matplotlib.use('Agg'); import matplotlib.pyplot; print(matplotlib.__version__)",
    "open3d": "import open3d; print(open3d.__version__)",
    "viser": "import viser; print(viser.__version__)",
}
"""Python code by module, each run in a process of its own; the last that it prints is the version."""

CHECKS = {"EGL": "egl", "picture": "picture", "ffmpeg": "video"}
"""Names of functions of `checks` by what they look at."""

OPTIONAL = {"viser": "for `taichisoft run --web`: pip install 'taichisoft[web]'"}
"""Modules that need not be there, with what they are for and how to get them."""


@dataclass(frozen=True)
class Finding:
    """One row of the answer.

    Attributes:
        subject: What was looked at.
        found: A version, or what is wrong.
        ok: Whether it will do.
        packages: What apt-get should install; empty when that would not help.
        needed: Whether taichisoft cannot do without it.
    """

    subject: str
    found: str
    ok: bool
    packages: tuple[str, ...] = ()
    needed: bool = True

    @property
    def verdict(self) -> str:
        """The word that begins the row."""
        return "ok" if self.ok else "MISSING" if self.needed else "without"


def doctor() -> None:
    """Check Python, the compiled libraries, off-screen drawing and videos; say what to install."""
    findings = examine()
    width = max(len(finding.subject) for finding in findings)
    for finding in findings:
        typer.echo(f"{finding.verdict:7} {finding.subject:{width}}  {finding.found}")
    packages = sorted({package for finding in findings for package in finding.packages})
    if packages:
        typer.echo(f"\nOn Debian and Ubuntu: {install_line(packages)}")
    if not all(finding.ok for finding in findings if finding.needed):
        raise typer.Exit(1)


def examine() -> list[Finding]:
    """All findings, in the order in which they are shown."""
    # Two at a time: each import reads some hundred megabytes.
    with ThreadPoolExecutor(max_workers=2) as pool:
        imports = [pool.submit(_examine_import, module, code) for module, code in IMPORTS.items()]
        checks = [pool.submit(_examine, subject, check) for subject, check in CHECKS.items()]
        libraries = pool.submit(_examine_libraries)
    return [_examine_python(), *(job.result() for job in (*imports, *checks, libraries))]


def _examine_python() -> Finding:
    limits = dict(re.findall(r"(>=|<)(\d+\.\d+)", metadata("taichisoft")["Requires-Python"]))
    lowest, above = (tuple(map(int, limits[sign].split("."))) for sign in (">=", "<"))
    ok = lowest <= sys.version_info[:2] < above
    needed = "" if ok else f" (from {limits['>=']}, below {limits['<']})"
    return Finding("python", platform.python_version() + needed, ok)


def _examine_import(module: str, code: str) -> Finding:
    child = run_python(["-c", code], TIME_LIMIT)
    if child.problem and module in OPTIONAL:
        absent = "not installed" if "No module named" in child.problem else child.problem
        return Finding(module, f"{absent}; {OPTIONAL[module]}", False, needed=False)
    if child.problem:
        return Finding(module, child.problem, False, tuple(packages_for(child.problem, module)))
    return Finding(module, child.output.split()[-1], True)


def _examine(subject: str, check: str) -> Finding:
    """Run one of the functions of `checks`."""
    if check == "egl" and sys.platform != "linux":
        return Finding(subject, "only needed on Linux", True)
    child = run_python(["-m", "taichisoft_plugins.doctor.checks", check], TIME_LIMIT)
    # What writes videos is a program that pip brings.
    packages = packages_for(child.problem, "open3d") if child.problem and check != "video" else []
    return Finding(subject, child.problem or child.output.strip(), not child.problem, tuple(packages))


def _examine_libraries() -> Finding:
    """Try all libraries at once: an import stops at the first one that is missing."""
    if sys.platform != "linux":
        return Finding("libraries", "only looked at on Linux", True)
    loads = "import ctypes; ctypes.CDLL('{}')".format
    missing = [
        library for library in SYSTEM_LIBRARIES if library.file and run_python(["-c", loads(library.file)], 20).problem
    ]
    found = ", ".join(library.file for library in missing) or "all found"
    return Finding("libraries", found, not missing, tuple(library.package for library in missing))
