"""Log of the keys of a session: one JSON object per line, with the number of steps before the key was handled."""

import json
import math
from pathlib import Path
from typing import Any

from taichisoft.atomic_file import named_os_errors
from taichisoft.control.keys import KeyEvent
from taichisoft.errors import TaichisoftError

FILE_NAME = "keys.jsonl"


class KeyLogError(TaichisoftError):
    """A key log cannot be written or read."""


class KeyLog:
    """Writes each key at once, so that a killed session leaves a complete log."""

    def __init__(self, path: Path):
        """Create the file.

        Raises:
            KeyLogError: the file cannot be written.
        """
        self._path = path
        with named_os_errors(path, KeyLogError):
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = path.open("w", encoding="utf-8", buffering=1)

    def add(self, step: int, event: KeyEvent) -> None:
        """Write a key handled after `step` steps of the session."""
        more: dict[str, Any] = {"ctrl": True} if event.ctrl else {}
        if event.value is not None:
            more["value"] = event.value
        self._write({"step": step, "key": event.key, **more})

    def end(self, step: int) -> None:
        """Write the total number of steps of the session, and close the file."""
        self._write({"step": step, "end": True})
        self._file.close()

    def _write(self, line: dict[str, Any]) -> None:
        with named_os_errors(self._path, KeyLogError):
            self._file.write(json.dumps(line) + "\n")


class KeyReplay:
    """The keys of an earlier session, each to be replayed after the same number of steps.

    Attributes:
        step_count: number of steps of that session; if it was killed, number of steps up to its last key.
    """

    def __init__(self, path: Path):
        """Read the whole file.

        Raises:
            KeyLogError: the file is missing, or a line is not in the format of `KeyLog`.
        """
        self._events: list[tuple[int, KeyEvent]] = []
        self.step_count = 0
        try:
            lines = path.read_text(encoding="utf-8").splitlines()
        except (OSError, UnicodeDecodeError) as error:
            raise KeyLogError(f"{path}: not readable as a key log: {error}") from error
        for number, line in enumerate(lines, 1):
            step, event = _parse(line, f"{path}, line {number}")
            if step < self.step_count:
                raise KeyLogError(f"{path}, line {number}: step = {step}: must not be below {self.step_count}")
            self.step_count = step
            if event is not None:
                self._events.append((step, event))

    def take(self, step: int) -> list[KeyEvent]:
        """Remove and return the keys handled after `step` steps."""
        taken = []
        while self._events and self._events[0][0] <= step:
            taken.append(self._events.pop(0)[1])
        return taken


def _parse(line: str, where: str) -> tuple[int, KeyEvent | None]:
    try:
        content = json.loads(line)
    except (ValueError, RecursionError) as error:
        raise KeyLogError(f"{where}: not readable as JSON: {error}") from error
    valid = 'must look like {"step": 12, "key": "+"} or {"step": 40, "end": true}'
    if not isinstance(content, dict) or type(content.get("step")) is not int or content["step"] < 0:
        raise KeyLogError(f"{where}: {line.strip()}: {valid}")
    if content.get("end") is True:
        return content["step"], None
    if not isinstance(content.get("key"), str) or not isinstance(content.get("ctrl", False), bool):
        raise KeyLogError(f"{where}: {line.strip()}: {valid}")
    value = content.get("value")
    if value is not None and (type(value) not in (int, float) or not math.isfinite(value)):
        raise KeyLogError(f"{where}: value = {value!r}: must be a finite number")
    return content["step"], KeyEvent(content["key"], content.get("ctrl", False), value)
