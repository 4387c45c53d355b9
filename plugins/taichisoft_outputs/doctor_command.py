"""The command `taichisoft doctor`: is everything there that taichisoft needs from this machine?"""

import math
import platform
import re
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib.metadata import metadata
from importlib.util import find_spec
from typing import Annotated

import typer

from taichisoft.base import WHOLE, cache_folder, extra, last_line, run_python, say
from taichisoft_outputs.system_libraries import SYSTEM_LIBRARIES, graphics, install_line, packages_for

TIME_LIMIT = 12.0
"""Time that all checks together may take [s]; the command itself takes less than one more, or 7 on a busy machine."""
LATE = "no answer within"
LIBRARY_TIME_LIMIT = 5.0
"""Longest time to load one library [s]."""

WORKERS = 4
"""Checks at a time."""

CHECK = ("-m", "taichisoft_outputs.doctor_checks")
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
