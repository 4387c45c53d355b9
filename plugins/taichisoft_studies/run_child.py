"""The process beside a worker that makes its runs: it can be killed when one takes too long, and may crash.

Taichi and its kernels are loaded once for many runs, since that takes longer than a short run.
"""

import json
import os
import queue
import signal
import subprocess
import threading
from collections.abc import Sequence
from typing import Any

from taichisoft.child_process import PYTHON, how_it_ended
from taichisoft_studies.run_process import READY

START_LIMIT = 600.0
"""Time that the process has to load Taichi and the plug-ins [s]; on a busy network disk it may take minutes."""

_child: "RunChild | None" = None


class ChildLost(Exception):
    """The process ended in the middle of a run; the text says how.

    Attributes:
        killed: whether somebody ended it by a signal, as a system does that is short of memory.
    """

    def __init__(self, problem: str, killed: bool = False):
        super().__init__(problem)
        self.killed = killed


class ChildTimeout(Exception):
    """The process took too long, and was killed."""


class RunChild:
    """A process that makes runs, one after the other."""

    def __init__(self, plugins: Sequence[str], with_engine: bool):
        """Start it, and wait until it is ready.

        Args:
            plugins: paths of the plug-ins that it loads.
            with_engine: whether it loads Taichi before it is ready, outside of any run's time limit.

        Raises:
            ChildLost: it cannot start; the text says why.
        """
        self.plugins, self.with_engine = tuple(plugins), with_engine
        self._process = subprocess.Popen(
            [*PYTHON, "-m", "taichisoft_studies.run_process", str(int(with_engine)), *plugins],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, "TAICHISOFT_THREADS": "1", "OMP_NUM_THREADS": "1"},
        )
        self._answers: queue.Queue[str] = queue.Queue()
        threading.Thread(target=self._listen, daemon=True).start()
        try:
            ready = self._next(START_LIMIT)
        except ChildTimeout as error:
            raise ChildLost(f"it did not start within {START_LIMIT:g} s") from error
        if READY not in ready:
            self.kill()
            raise ChildLost(str(ready.get("error")))

    @property
    def alive(self) -> bool:
        """Whether it can take a job."""
        return self._process.poll() is None

    def ask(self, kind: str, job: str, time_limit: float) -> dict[str, Any]:
        """Have a job done, and return the answer.

        Raises:
            ChildTimeout: it was not done within `time_limit` [s].
            ChildLost: the process ended.
        """
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps({"kind": kind, "job": job}) + "\n")
            self._process.stdin.flush()
        except OSError as error:
            raise self._lost() from error
        return self._next(time_limit)

    def kill(self) -> None:
        """End it at once."""
        self._process.kill()
        self._process.wait()

    def _listen(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._answers.put(line)
        self._answers.put("")

    def _next(self, time_limit: float) -> dict[str, Any]:
        try:
            line = self._answers.get(timeout=time_limit)
        except queue.Empty as error:
            self.kill()
            raise ChildTimeout from error
        if not line:
            raise self._lost()
        answer: dict[str, Any] = json.loads(line)
        return answer

    def _lost(self) -> ChildLost:
        code = self._process.wait()
        return ChildLost(how_it_ended(code, "") or "exit code 0", -code in (signal.SIGKILL, signal.SIGTERM))


def child_with(plugins: Sequence[str], with_engine: bool) -> RunChild:
    """The process of this worker with these plug-ins: the one that is there, or a new one; see `RunChild`.

    Raises:
        ChildLost: it cannot start.
    """
    global _child
    if _child is None or not _child.alive or (_child.plugins, _child.with_engine) != (tuple(plugins), with_engine):
        if _child is not None:
            _child.kill()
        _child = RunChild(plugins, with_engine)
    return _child
