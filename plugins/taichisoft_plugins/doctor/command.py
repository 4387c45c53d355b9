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

IMPORTS = {
    "taichi": "import taichi; taichi.init(arch=taichi.cpu); print(*taichi.__version__, sep='.')",
    "gmsh": "import gmsh; gmsh.initialize(); print(gmsh.__version__)",
    "h5py": "import h5py; print(h5py.__version__)",
    "matplotlib": "import matplotlib; matplotlib.use('Agg'); import matplotlib.pyplot; print(matplotlib.__version__)",
    "open3d": "import open3d; print(open3d.__version__)",
    "viser": "import viser; print(viser.__version__)",
}
"""Python code by module, each run in a process of its own; it prints the version last."""

OPTIONAL = {"viser": "for `taichisoft run --web`: pip install 'taichisoft[web]'"}
"""What for and how to get it, by module that need not be there."""


@dataclass(frozen=True)
class Finding:
    """One row of the answer.

    Attributes:
        subject: what was looked at.
        found: a version, or what is wrong.
        ok: whether it will do.
        packages: what apt-get should install; empty when that would not help.
        needed: whether taichisoft does not do without it.
    """

    subject: str
    found: str
    ok: bool
    packages: tuple[str, ...] = ()
    needed: bool = True

    @property
    def verdict(self) -> str:
        """One word."""
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
        others = [pool.submit(job) for job in (_examine_egl, _examine_picture, _examine_video, _examine_libraries)]
    return [_examine_python(), *(job.result() for job in (*imports, *others))]


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


def _examine_egl() -> Finding:
    """By which driver Open3D draws without a display: a picture that fails does not say."""
    if sys.platform != "linux":
        return Finding("EGL", "only needed on Linux", True)
    child = run_python(["-m", "taichisoft_plugins.doctor.egl_check"], TIME_LIMIT)
    if child.problem:
        return Finding("EGL", child.problem, False, tuple(packages_for(child.problem, "open3d")))
    return Finding("EGL", child.output.strip(), True)


def _examine_picture() -> Finding:
    child = run_python(["-m", "taichisoft_plugins.doctor.picture_check"], TIME_LIMIT)
    if child.problem:
        return Finding("picture", child.problem, False, tuple(packages_for(child.problem, "open3d")))
    return Finding("picture", "drawn off-screen", True)


def _examine_video() -> Finding:
    child = run_python(["-m", "taichisoft_plugins.doctor.video_check"], TIME_LIMIT)
    return Finding("ffmpeg", child.problem or child.output.strip(), not child.problem)


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
