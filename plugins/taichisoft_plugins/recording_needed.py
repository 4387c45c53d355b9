"""Outputs that are made of the recording at the end: whether it will be there is checked before the first step."""

from collections.abc import Sequence
from typing import Any

from taichisoft.errors import TaichisoftError
from taichisoft_plugins.recording import RecordingOutput


class RecordingNeeded(TaichisoftError):
    """An output of a run needs the recording, which the run does not write."""


def check_recording(outputs: Sequence[Any]) -> None:
    """See that a recording is written, and ended, before every output that says `needs_recording = True`.

    Raises:
        RecordingNeeded: it is not.
    """
    recorded = False
    for output in outputs:
        recorded = recorded or isinstance(output, RecordingOutput)
        if getattr(output, "needs_recording", False) and not recorded:
            name = type(output).__name__.removesuffix("Output").lower()
            raise RecordingNeeded(f"output '{name}' needs the output 'recording' before it: --outputs recording,{name}")
