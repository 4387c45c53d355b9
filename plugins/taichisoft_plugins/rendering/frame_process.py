"""A child process that draws: each of its frames arrives within a time limit, or the process is ended."""

import json
import subprocess
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from tempfile import TemporaryFile
from typing import Any, Self

import numpy as np

from taichisoft.child_process import PYTHON, how_it_ended

WORKER = ("-m", "taichisoft_plugins.rendering.render_process")
"""Arguments of Python for the process; `render_process` says what it reads and writes."""

REFUSED = 3
"""Exit code of a process that was asked for what no second attempt could give."""

POLL = 0.1
"""Longest time that somebody waits who wants everything to stop [s]."""


class FrameProcess:
    """Reads frames from a process of its own, which cannot hang or crash the caller; use it in a `with` statement.

    One frame is read ahead. The process does not hear the terminal's Ctrl and c: who reads decides.

    Attributes:
        problem: one line that says why there was no further frame; empty before.
        refused: whether that would be the same in a new process.

    Args:
        job: what `render_process` reads; paths may be among its values.
        shape: shape of a frame: height, width, 3.
    """

    def __init__(self, job: dict[str, Any], shape: tuple[int, int, int]):
        self.problem = ""
        self.refused = False
        self._shape = shape
        # Files instead of pipes: a process that neither reads nor is read from cannot block us.
        self._log = TemporaryFile()  # noqa: SIM115 - closed in __exit__
        with TemporaryFile() as description:
            description.write(json.dumps(job, default=str).encode())
            description.seek(0)
            self._process = subprocess.Popen(
                [*PYTHON, *WORKER],
                stdin=description,
                stdout=subprocess.PIPE,
                stderr=self._log,
                start_new_session=True,
            )
        self._reader = ThreadPoolExecutor(1)
        self._coming = self._read_ahead()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.wait()
        self._reader.shutdown()
        self._log.close()
        assert self._process.stdout is not None
        self._process.stdout.close()

    def next_frame(self, time_limit: float, stop_if_asked: Callable[[], None]) -> np.ndarray | None:
        """The next frame, shape (height, width, 3), dtype uint8; None when there is none, see `problem`.

        Args:
            time_limit: duration after which the process is taken to hang [s].
            stop_if_asked: is called while we wait, and may raise.
        """
        latest = time.monotonic() + time_limit
        stop_if_asked()
        while not wait([self._coming], POLL).done:
            stop_if_asked()
            if time.monotonic() >= latest:
                self.problem = f"no answer within {time_limit:g} s"
                return None
        frame = self._coming.result()
        if len(frame) < np.prod(self._shape):
            self._note_end()
            return None
        self._coming = self._read_ahead()
        return np.frombuffer(frame, np.uint8).reshape(self._shape)

    def _read_ahead(self) -> Future[bytes]:
        """Begin to read the next frame; what comes is shorter when there is none."""
        assert self._process.stdout is not None
        return self._reader.submit(self._process.stdout.read, int(np.prod(self._shape)))

    def _note_end(self) -> None:
        """Note why the frames have ended; the process may still be busy with its end."""
        try:
            code = self._process.wait(timeout=10.0)
        except subprocess.TimeoutExpired:
            self.problem = "the process stopped drawing"
            return
        self._log.seek(0)
        self.refused = code == REFUSED
        self.problem = how_it_ended(code, self._log.read()) or "the process ended before its last frame"
