"""The command `taichisoft doctor`: is everything there that taichisoft needs from this machine?"""

import platform
import re
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib.metadata import metadata

import typer

from taichisoft_plugins.child_process import run_python
from taichisoft_plugins.system_libraries import SYSTEM_LIBRARIES, install_line, packages_for

TIME_LIMIT = 90.0

IMPORTS = {
    "taichi": "import taichi; taichi.init(arch=taichi.cpu); print(*taichi.__version__, sep='.')",
    "gmsh": "import gmsh; gmsh.initialize(); print(gmsh.__version__)",
    "h5py": "import h5py; print(h5py.__version__)",
    "open3d": "import open3d; print(open3d.__version__)",
}
"""Python code by module, each run in a process of its own; it prints the version last."""


@dataclass(frozen=True)
class Finding:
    """One row of the answer.

    Attributes:
        subject: what was looked at.
        found: a version, or what is wrong.
        ok: whether it will do.
        packages: what apt-get should install; empty when that would not help.
    """

    subject: str
    found: str
    ok: bool
    packages: tuple[str, ...] = ()


def doctor() -> None:
    """Check Python, the compiled libraries and off-screen drawing; say what to install."""
    findings = examine()
    width = max(len(finding.subject) for finding in findings)
    for finding in findings:
        typer.echo(f"{'ok     ' if finding.ok else 'MISSING'} {finding.subject:{width}}  {finding.found}")
    packages = sorted({package for finding in findings for package in finding.packages})
    if packages:
        typer.echo(f"\nOn Debian and Ubuntu: {install_line(packages)}")
    if not all(finding.ok for finding in findings):
        raise typer.Exit(1)


def examine() -> list[Finding]:
    """All findings, in the order in which they are shown."""
    # Two at a time: each import reads some hundred megabytes.
    with ThreadPoolExecutor(max_workers=2) as pool:
        imports = [pool.submit(_examine_import, module, code) for module, code in IMPORTS.items()]
        picture = pool.submit(_examine_picture)
        libraries = pool.submit(_examine_libraries)
    return [_examine_python(), *(job.result() for job in imports), picture.result(), libraries.result()]


def _examine_python() -> Finding:
    limits = dict(re.findall(r"(>=|<)(\d+\.\d+)", metadata("taichisoft")["Requires-Python"]))
    lowest, above = (tuple(map(int, limits[sign].split("."))) for sign in (">=", "<"))
    ok = lowest <= sys.version_info[:2] < above
    needed = "" if ok else f" (from {limits['>=']}, below {limits['<']})"
    return Finding("python", platform.python_version() + needed, ok)


def _examine_import(module: str, code: str) -> Finding:
    child = run_python(["-c", code], TIME_LIMIT)
    if child.problem:
        return Finding(module, child.problem, False, tuple(packages_for(child.problem, module)))
    return Finding(module, child.output.split()[-1], True)


def _examine_picture() -> Finding:
    child = run_python(["-m", "taichisoft_plugins.picture_check"], TIME_LIMIT)
    if child.problem:
        return Finding("picture", child.problem, False, tuple(packages_for(child.problem, "open3d")))
    return Finding("picture", "drawn off-screen", True)


def _examine_libraries() -> Finding:
    """Try all at once: an import stops at the first one that is missing."""
    if sys.platform != "linux":
        return Finding("libraries", "only looked at on Linux", True)
    missing = []
    for library in SYSTEM_LIBRARIES:
        if library.file and run_python(["-c", f"import ctypes; ctypes.CDLL('{library.file}')"], 20).problem:
            missing.append(library)
    if missing:
        files = ", ".join(library.file for library in missing)
        return Finding("libraries", files, False, tuple(library.package for library in missing))
    return Finding("libraries", "all found", True)
