"""Functions of worker processes that answer, fail, crash, hang, print, and outlive their parents."""

import os
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from taichisoft.base import Link
from taichisoft.errors import MeshError, SimulationDiverged, TaichisoftError


class Particular(MeshError):
    """Of a class that only this module has."""


def echo(link: Link) -> None:
    """Answer every message with itself."""
    while True:
        link.send(link.receive())


def speak(link: Link) -> None:
    """Print where answers go, then answer."""
    os.write(1, b"from a library in C\n")
    print("from Python", flush=True)
    link.send(sys.stdin.read())


def announce(link: Link) -> None:
    """Answer a few times without being asked, and end."""
    for number in range(3):
        link.send(number)


def fail(link: Link) -> None:
    """End in the way that the parent asks for."""
    how = link.receive()
    if how == "particular":
        raise Particular("a.toml: refused")
    if how == "diverged":
        raise SimulationDiverged("finger", 3, "explodes", "a smaller step")
    if how == "plain":
        raise TaichisoftError("two  spaces stay")
    if how == "foreign":
        raise ValueError("first line\nsecond line")
    if how == "abort":
        os.abort()
    if how == "exit":
        sys.exit("a warning\nno libGL")
    time.sleep(600)


def stay(link: Link) -> None:
    """Say which process this is, and go on."""
    link.send(os.getpid())
    time.sleep(600)


def interrupt_oneself(link: Link) -> None:
    """Go on in spite of Ctrl and c; say whether the terminal is that of the parent."""
    os.kill(os.getpid(), signal.SIGINT)
    link.send(os.getsid(0) == os.getsid(link.receive()))


def close_slowly(link: Link) -> None:
    """Notice that nothing more comes, write a file, and never end."""
    link.time_to_close = 1.0
    path = link.receive()
    link.send("")
    try:
        link.receive()
    except EOFError:
        Path(path).touch()
    time.sleep(600)


def add(one: Any, other: Any) -> Any:
    """The sum."""
    return one + other


def prepare(context: Any) -> Callable[[Any], Any]:
    """A pool's process, whose jobs are names of what it does, with an argument."""
    if context == "broken":
        raise MeshError("the plug-in is broken")

    def be_killed(marks: Path, times: int) -> int:
        number = len(list(marks.iterdir()))
        (marks / str(number)).touch()
        if number < times:
            os.kill(os.getpid(), signal.SIGKILL)
        return number

    def refuse(text: str) -> None:
        raise MeshError(text)

    jobs: dict[str, Callable[..., Any]] = {
        "context": lambda: (os.getpid(), context),
        "sleep": time.sleep,
        "refuse": refuse,
        "divide": lambda number: 1 / number,
        "exit": os._exit,
        "be killed": be_killed,
    }
    return lambda job: jobs[job[0]](*job[1:])
