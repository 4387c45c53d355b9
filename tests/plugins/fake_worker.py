"""Stands in for the process that draws: `python fake_worker.py LOG WHAT AT TIMES` does WHAT before frame AT.

It does so the first TIMES times that it is started, which it counts by the lines that it writes to LOG: the number of
the frame that it begins with. A frame is of one colour, its index.
"""

import json
import os
import signal
import sys
import time
from pathlib import Path


def worker(log: Path, what: str = "nothing", at: int = 0, times: int = 0) -> tuple[str, ...]:
    """The arguments of Python that `frame_process.WORKER` has to be."""
    return __file__, str(log), what, str(at), str(times)


def main() -> None:
    """Write the frames that standard input asks for."""
    log, what, at, times = Path(sys.argv[1]), sys.argv[2], int(sys.argv[3]), int(sys.argv[4])
    job = json.load(sys.stdin)
    width, height = job["style"]["size"]
    with log.open("a") as lines:
        lines.write(f"{job['first']} {os.getpid()}\n")
    misbehaves = len(log.read_text().splitlines()) <= times
    for number in range(job["first"], len(job["frames"])):
        if misbehaves and number == at:
            misbehave(what)
        sys.stdout.buffer.write(bytes([job["frames"][number] % 256]) * (width * height * 3))
        sys.stdout.buffer.flush()


def misbehave(what: str) -> None:
    """As Open3D and its drivers were seen to do."""
    if what == "hang":
        time.sleep(600)
    elif what == "crash":
        os.kill(os.getpid(), signal.SIGSEGV)
    elif what == "fail":
        sys.exit("a warning\nImportError: libEGL.so.1: cannot open shared object file")
    elif what == "refuse":
        print("there is no body 'ball'", file=sys.stderr)
        sys.exit(3)
    elif what == "stop":
        sys.exit(0)


if __name__ == "__main__":
    main()
