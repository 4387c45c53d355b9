"""What the tests of studies share: runs in this process, and the command in one of its own."""

import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from conftest import PATIENCE
from interrupted_sweep import PLUGIN

from taichisoft import load_plugin
from taichisoft.base import PYTHON
from taichisoft.pytest_fixtures import TINY_GRIPPER
from taichisoft_studies.run_job import RunJob, make_run
from taichisoft_studies.study_file import Cluster, Sweep, check_study
from taichisoft_studies.workers import study_workers


class Here:
    """Workers that are this process; the jobs are done last first, to show that the order does not matter."""

    count, about = 2, "here"

    def __init__(self) -> None:
        self.waiting: list[tuple[str, RunJob]] = []
        self.made: list[str] = []

    def submit(self, key: str, job: RunJob) -> None:
        self.waiting.append((key, job))

    def next_done(self) -> tuple[str, dict[str, Any]]:
        key, job = self.waiting.pop()
        self.made.append(key)
        return key, make_run(job)


def made_apart(jobs: Sequence[Any], workers: int = 1) -> list[dict[str, Any]]:
    """The records of jobs that processes of this machine have made, in the order of the jobs."""
    records = {}
    with study_workers(Cluster(workers=workers), len(jobs)) as made:
        for job in jobs:
            made.submit(job.name, job)
        records.update(made.next_done() for _ in jobs)
    return [records[job.name] for job in jobs]


def plugin(folder: Path) -> Path:
    """A plug-in with a controller that keeps a pressure."""
    path = folder / "squeeze.py"
    path.write_text(PLUGIN)
    return path


def sweep_of(folder: Path, **tables: Any) -> Sweep:
    """A sweep of the tiny gripper, one step long; its plug-ins are loaded."""
    base = {
        "scene": str(TINY_GRIPPER),
        "controller": "squeeze",
        "duration": 0.01,
        "plugins": [str(plugin(folder))],
        "vary": {"controller.settings.pressure": [1.0, 2.0]},
    }
    study = check_study(Sweep, {**base, **tables}, "study")
    for path in study.plugins:
        load_plugin(path)
    return study


def command(*arguments: Any) -> subprocess.CompletedProcess[str]:
    """Run `taichisoft` in a process of its own."""
    words = [*PYTHON, "-m", "taichisoft", *map(str, arguments)]
    return subprocess.run(words, capture_output=True, text=True, timeout=PATIENCE)
