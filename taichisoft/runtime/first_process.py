"""Which of several processes that start at once compiles the kernels, while the others wait for them.

Taichi reads its list of kernels at its start, and writes it at its end alone. So where nobody has left kernels yet, one
process goes ahead, the first. When it has launched kernels for a while without compiling any, and others wait, it ends
Taichi and starts it again: its kernels are then there for all, itself included. With nobody else nothing of this costs.

The first holds a lock of the operating system, which ends with it, however it ends; whoever takes the lock next is the
first, unless kernels are there. The time of that file says until when it is worth waiting: nobody waits long for a
process that compiles nothing.
"""

import atexit
import contextlib
import hashlib
import os
import sys
import time
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import IO

from taichisoft.runtime.kernel_cache import kernel_folder

IDLE = 20.0
"""Longest time that others wait while the first compiles nothing [s]: it may be a notebook that stays open."""
COMPILING = 300.0
"""Longest time that others wait for one kernel [s]; one takes up to 10 s, on a crowded machine more than a minute."""
LAUNCHES = 200
"""Launches without a compilation after which the kernels of a scene are taken for complete: some ten steps."""
LOOKS = 10
"""How often the first looks whether others wait, each time after so many launches; then it is first no longer."""

_first: IO[str] | None = None
_launches = _looks = 0
_compiled = False


def _done(threads: int) -> Path:
    """The file that marks complete kernels of this version, for a number of threads."""
    engine = Path(__file__).parents[1]
    sources = sorted([*engine.glob("runtime/*.py"), *engine.glob("*/kernels/*.py"), engine / "rubber_laws.py"])
    digest = hashlib.sha256(b"".join(source.read_bytes() for source in sources)).hexdigest()
    return kernel_folder() / f"compiled-{digest[:16]}-{threads}"


def wait_for_kernels(threads: int) -> None:
    """Return when compiled kernels exist, or when this process is the one to compile them."""
    global _first
    if find_spec("fcntl") is None:  # Windows: everybody compiles
        return
    done = _done(threads)
    if done.exists():
        return
    first = (done.with_name("first")).open("a")
    try:
        with _waiting():
            _first = first if _is_first(first, done) else None
    except OSError as error:
        if not any(kernel_folder().glob("*.tic")):
            _say(f"{kernel_folder()} cannot be locked ({error.strerror}): processes that start at once each compile")
    if _first is None:
        first.close()
    else:
        atexit.register(resign)  # what is registered later, such as Taichi's own end, comes before it


def begin_compilation() -> None:
    """A kernel is about to be compiled."""
    global _compiled, _launches, _looks
    _compiled, _launches, _looks = True, 0, 0
    if _first is not None:
        _let_wait(_first, COMPILING)


def end_compilation() -> None:
    """A kernel has been compiled."""
    if _first is not None:
        _let_wait(_first, IDLE)


def is_first() -> bool:
    """Whether others may wait for this process."""
    return _first is not None


def must_hand_over() -> bool:
    """Whether the kernels of the first process are complete and others wait for them; called before every launch."""
    global _launches, _looks
    _launches += 1
    if _launches < LAUNCHES:
        return False
    _launches, _looks = 0, _looks + 1
    if _somebody_waits():
        return True
    if _looks == LOOKS:
        resign()
    return False


def resign() -> None:
    """Release the lock; another process can be first then."""
    global _first
    if _first is not None:
        _first.close()
        _first = None


def left_kernels(threads: int) -> None:
    """Record that Taichi has ended and has written the kernels of this process."""
    if _compiled:
        with contextlib.suppress(OSError):
            _done(threads).touch()


def _is_first(first: IO[str], done: Path) -> bool:
    """Wait for the lock; whether this process is to compile."""
    import fcntl

    since, announced = time.monotonic(), False
    while not done.exists():
        try:
            fcntl.flock(first, fcntl.LOCK_EX | fcntl.LOCK_NB)
            _let_wait(first, IDLE)
            return not done.exists()
        except BlockingIOError:
            pass
        if not announced:
            _say("waits for another process, which compiles its kernels")
            announced = True
        # The first may not have written its time yet.
        if time.time() > os.fstat(first.fileno()).st_mtime and time.monotonic() - since > IDLE:
            _say("the other process compiles nothing; this one compiles its kernels itself")
            return False
        time.sleep(0.1)
    return False


def _let_wait(first: IO[str], seconds: float) -> None:
    """Record for how long other processes should wait."""
    with contextlib.suppress(OSError):
        os.utime(first.name, times=(time.time(), time.time() + seconds))


@contextlib.contextmanager
def _waiting() -> Iterator[None]:
    """Show the first process that another one waits."""
    import fcntl

    with kernel_folder().joinpath("waiting").open("a") as file:
        fcntl.flock(file, fcntl.LOCK_SH)
        yield


def _somebody_waits() -> bool:
    import fcntl

    with kernel_folder().joinpath("waiting").open("a") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            return True
    return False


def _say(what: str) -> None:
    print(f"taichisoft: {what}", file=sys.stderr)
