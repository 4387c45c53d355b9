"""Work that a process has begun and not ended: its owner, and whether that process has ended."""

import os
import shutil
import socket
import time
from pathlib import Path

CLOCKS = 60.0
"""By how much the clocks of two machines may differ [s]."""


def owner() -> str:
    """Identity of this process on all machines, "HOST-PID"."""
    return f"{socket.gethostname()}-{os.getpid()}"


def is_gone(owner: str) -> bool:
    """Whether an owner is a process of this machine that has ended; nothing is known of other machines."""
    host, _, pid = owner.rpartition("-")
    if host != socket.gethostname() or not pid.isdecimal():
        return False
    try:
        os.kill(int(pid), 0)
    except ProcessLookupError:
        return True
    except OSError:
        return False
    return False


def partial_folder(folder: Path, name: str) -> Path:
    """Where this process makes what will be called `name` in a folder."""
    return folder / f".{name}.{owner()}.partial"


def abandoned(folder: Path, name: str, time_limit: float) -> list[Path]:
    """Folders of unfinished attempts at `name` whose process has ended.

    Another machine, or another process of this one, may be making the same: its folder is left alone. That of another
    machine is abandoned when nothing was added to it for longer than an attempt may take, `time_limit` [s].
    """
    found = []
    for partial in sorted(folder.glob(f".{name}.*.partial")):
        whose = partial.name.removeprefix(f".{name}.").removesuffix(".partial")
        try:
            is_old = time.time() - partial.stat().st_mtime > time_limit + CLOCKS
        except OSError:  # it has just got its name
            continue
        if is_gone(whose) or (is_old and whose != owner()):
            found.append(partial)
    return found


def remove_abandoned(folder: Path, name: str, time_limit: float) -> None:
    """Remove what unfinished attempts at `name` have left, see `abandoned`."""
    for partial in abandoned(folder, name, time_limit):
        shutil.rmtree(partial, ignore_errors=True)
