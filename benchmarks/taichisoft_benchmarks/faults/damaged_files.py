"""Recordings whose process is killed, and damaged recordings and tables of studies."""

import os
import random
import signal
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from taichisoft_benchmarks.faults.damage import DAMAGES
from taichisoft_benchmarks.faults.tries import how_it_went

STEPS = 150
"""Steps of the recorded run."""
LIMIT = 5.0
"""Longest time that a damaged recording may take to be refused [s]."""

Run = tuple[Any, Any, Sequence[tuple[Any, Any]]]
"""Model, first state, and the state and the report of every step."""


def tiny_run(steps: int) -> Run:
    """The fixture's tiny gripper, which closes on its cube."""
    from taichisoft.control import Control
    from taichisoft.pytest_fixtures import TINY_GRIPPER
    from taichisoft.running import Simulation, load_scene

    simulation = Simulation(load_scene(TINY_GRIPPER))
    first, made = simulation.state, []
    for step in range(steps):
        names = simulation.model.cavities.names
        report = simulation.step(Control(pressure=dict.fromkeys(names, min(0.1 * step, 9.0))))
        _ = report.observation  # now, since a forked process must not start kernels
        made.append((simulation.state, report))
    return simulation.model, first, made


def record(run: Run, folder: Path) -> None:
    """Record a run."""
    from taichisoft_outputs.recording.recording_output import RecordingOutput

    model, first, steps = run
    output = RecordingOutput(folder)
    output.begin(model, first)
    for state, report in steps:
        output.record(state, report)
    output.end("completed")


def read_all(path: Path) -> Any:
    """Every frame of a recording.

    Raises:
        RecordingError: the recording is damaged.
    """
    from taichisoft_outputs.recording.reader import read_recording

    with read_recording(path) as recording:
        return recording.rows_of_frames(0, recording.frame_count)


def killed_recordings(tries: int) -> list[str]:
    """Kill a process that records again and again into one folder, at random moments.

    To begin and to close take most of the time of so short a run, so that most kills fall into these windows.
    """
    run, failures, dice = tiny_run(STEPS), [], random.Random(1)
    with TemporaryDirectory() as name:
        folder = Path(name)
        record(run, folder)
        for number in range(tries):
            child = os.fork()
            if child == 0:
                while True:
                    record(run, folder)
            time.sleep(dice.uniform(0.0, 0.3))
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            try:
                read_all(folder / "recording.h5")
            except Exception as error:
                failures.append(f"{number}: {error}")
    return failures


def damaged_recordings(tries: int, steps: int = STEPS) -> list[str]:
    """Damage a recording and read all of it: it is refused soon and in one line, or no number has changed.

    How many are refused goes to the error output; that none is refused at all is a failure.
    """
    from taichisoft_outputs.recording.layout import RecordingError

    failures, refused, longest = [], 0, 0.0
    with TemporaryDirectory() as name:
        folder, broken = Path(name), Path(name) / "broken.h5"
        record(tiny_run(steps), folder)
        content, whole = (folder / "recording.h5").read_bytes(), read_all(folder / "recording.h5")
        for number in range(tries):
            broken.write_bytes(DAMAGES[number % len(DAMAGES)](content, random.Random(number)))
            started = time.monotonic()
            try:
                rows = read_all(broken)
                if any(rows[path].tobytes() != whole[path].tobytes() for path in whole):
                    failures.append(f"{number}: other numbers are read")
            except RecordingError as error:
                refused += 1
                if "\n" in str(error):
                    failures.append(f"{number}: several lines: {str(error)!r}")
            except Exception as error:
                failures.append(f"{number}: {type(error).__name__}: {error}")
            longest = max(longest, seconds := time.monotonic() - started)
            if seconds > LIMIT:
                failures.append(f"{number}: takes {seconds:.1f} s")
    print(f"{refused} of {tries} damaged recordings are refused, after {longest:.2f} s at most", file=sys.stderr)
    if refused == 0:
        failures.append(f"none of {tries} damages is reported")
    return failures


def damaged_tables(tries: int) -> list[str]:
    """Write the pages of studies whose table is damaged: each ends well or in one line."""
    from taichisoft_studies.results_table import PARQUET, write_table

    failures = []
    row = {"seed": 1, "status": "completed", "message": "", "metrics.force": 1.5, "folder": "runs/x"}
    with TemporaryDirectory() as folder:
        table = Path(folder) / PARQUET
        write_table([{"run": f"r{number}", "pressure": 0.1 * number, **row} for number in range(40)], Path(folder))
        whole = table.read_bytes()
        for number in range(tries):
            dice = random.Random(f"table {number}")
            table.write_bytes(dice.choice(DAMAGES)(whole, dice))
            if failure := how_it_went(["study", "report", folder]):
                failures.append(f"{number}: {failure}")
    return failures


ROWS = {
    "recordings whose process is killed at random moments, while the file is begun and closed among them": (
        200,
        killed_recordings,
    ),
    "recordings cut off, with a flipped bit, a page of zeros, or foreign bytes": (60, damaged_recordings),
    "reports of studies whose table is damaged": (1000, damaged_tables),
}
