"""A child process that draws: each of its frames arrives within a time limit, or the process is ended."""

import json
import queue
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from tempfile import TemporaryFile
from typing import Any, Self

import numpy as np

from taichisoft.child_process import how_it_ended

WORKER = ("-m", "taichisoft_plugins.rendering.render_process")
"""Arguments of Python for the process; `render_process` says what it reads and writes."""

REFUSED = 3
"""Exit code of a process that was asked for what no second attempt could give."""

POLL = 0.1
"""Longest time that somebody waits who wants everything to stop [s]."""


class FrameProcess:
    """Reads frames from a process of its own, which cannot hang or crash the caller; use it in a `with` statement.

    At most two frames are in memory. The process does not hear the terminal's Ctrl and c: who reads decides.

    Attributes:
        problem: One line that says why there was no further frame; empty before.
        refused: Whether that would be the same in a new process.

    Args:
        job: What `render_process` reads.
        shape: Shape of a frame: height, width, 3.
    """

    def __init__(self, job: dict[str, Any], shape: tuple[int, int, int]):
        self.problem = ""
        self.refused = False
        self._shape = shape
        self._frames: queue.Queue[bytes] = queue.Queue(maxsize=1)
        self._closed = False
        # Files instead of pipes: a process that neither reads nor is read from cannot block us.
        self._log = TemporaryFile()  # noqa: SIM115 - closed in __exit__
        with TemporaryFile() as description:
            description.write(json.dumps(job).encode())
            description.seek(0)
            self._process = subprocess.Popen(
                [sys.executable, *WORKER],
                stdin=description,
                stdout=subprocess.PIPE,
                stderr=self._log,
                start_new_session=True,
            )
        threading.Thread(target=self._read, name="frames", daemon=True).start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._closed = True
        self._process.kill()
        self._process.wait()
        self._log.close()

    def next_frame(self, time_limit: float, stop_if_asked: Callable[[], None]) -> np.ndarray | None:
        """The next frame, shape (height, width, 3), dtype uint8; None when there is none, see `problem`.

        Args:
            time_limit: Duration after which the process is taken to hang [s].
            stop_if_asked: Is called while we wait, and may raise.
        """
        latest = time.monotonic() + time_limit
        while True:
            stop_if_asked()
            try:
                frame = self._frames.get(timeout=POLL)
            except queue.Empty:
                if time.monotonic() < latest:
                    continue
                self.problem = f"no answer within {time_limit:g} s"
                return None
            if not frame:
                self._note_end()
                return None
            return np.frombuffer(frame, np.uint8).reshape(self._shape)

    def _read(self) -> None:
        """Pass all frames on, and an empty one at the end."""
        size = int(np.prod(self._shape))
        assert self._process.stdout is not None
        with self._process.stdout as frames:
            frame = b"all"
            while frame:
                frame = frames.read(size)
                self._pass_on(frame if len(frame) == size else b"")

    def _pass_on(self, frame: bytes) -> None:
        while not self._closed:
            try:
                return self._frames.put(frame, timeout=POLL)
            except queue.Full:
                continue

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
