"""Workers of a study: processes of this machine, and those of a Dask scheduler."""

import csv
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from conftest import PATIENCE
from studies import command, plugin

from taichisoft.pytest_fixtures import TINY_GRIPPER
from taichisoft_studies.errors import StudyError
from taichisoft_studies.study_file import Cluster
from taichisoft_studies.workers import caution, study_workers

SWEEP = ["--controller", "squeeze", "--duration", "0.02", "--vary", "controller.settings.pressure=1,2,3,high"]


@pytest.fixture
def scheduler(monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """The address of a scheduler with two workers, started by the document's lines for SLURM, whose jobs run here."""
    distributed = pytest.importorskip("distributed", reason="the extra studies is not installed")
    monkeypatch.setenv("TAICHISOFT_THREADS", "1")

    class JobsHere(distributed.LocalCluster):  # type: ignore[misc]
        def __init__(self, **arguments: Any) -> None:
            assert set(arguments) == {"queue", "cores", "processes", "memory", "walltime"}
            super().__init__(n_workers=0, threads_per_worker=1, dashboard_address=None)

        def scale(self, jobs: int) -> None:
            super().scale(min(jobs, 2))

    monkeypatch.setitem(sys.modules, "dask_jobqueue", SimpleNamespace(SLURMCluster=JobsHere))
    document = Path(__file__).parents[2] / "docs" / "studies.md"
    (program,) = re.findall(r"```python\n(from dask_jobqueue .*?)```", document.read_text(encoding="utf-8"), re.DOTALL)
    shown: list[str] = []
    names: dict[str, Any] = {"input": shown.append}
    exec(program, names)
    with names["cluster"] as cluster:
        cluster.wait_for_workers(2, timeout=PATIENCE)
        yield shown[0].split()[-1]


def test_sweep_runs_on_a_dask_scheduler(tmp_path: Path, scheduler: str) -> None:
    """Two workers of a scheduler give the table that processes of this machine give, byte by byte."""
    words = ["study", "sweep", TINY_GRIPPER, *SWEEP, "--plugin", plugin(tmp_path)]
    apart = command(*words, "-o", tmp_path / "dask", "--scheduler", scheduler)
    here = command(*words, "-o", tmp_path / "here", "--jobs", 2)
    assert (apart.returncode, here.returncode) == (1, 1), apart.stderr + here.stderr
    assert f"2 workers of {scheduler}" in apart.stdout
    assert "warning: --scheduler tcp://" in apart.stdout
    assert "2 processes" in here.stdout
    tables = [(tmp_path / name / "results.csv").read_text() for name in ("dask", "here")]
    assert tables[0] == tables[1]
    statuses = [row["status"] for row in csv.DictReader(tables[0].splitlines())]
    assert statuses == ["completed"] * 3 + ["scene refused"]


@pytest.mark.parametrize(
    ("address", "is_open"),
    [(None, False), ("tls://far:8786", False), ("tcp://far:8786", True), ("far:8786", True)],
)
def test_scheduler_without_tls_is_warned_of(address: str | None, is_open: bool) -> None:
    assert caution(Cluster(scheduler=address)).startswith(f"--scheduler {address}: without TLS") is is_open


@pytest.mark.parametrize(
    ("address", "problem"),
    [
        ("tcp://127.0.0.1:1", r"^--scheduler tcp://127\.0\.0\.1:1: cannot be reached: "),
        ("nonsense://a", r"^--scheduler nonsense://a: cannot be reached: "),
        ("tls://127.0.0.1:1", r"^--scheduler tls://127\.0\.0\.1:1: needs credentials"),
    ],
)
def test_unreachable_scheduler_is_one_line(address: str, problem: str, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed", reason="the extra studies is not installed")
    monkeypatch.setattr("taichisoft_studies.workers.TIME_TO_CONNECT", 0.5)
    with pytest.raises(StudyError, match=problem) as refused, study_workers(Cluster(scheduler=address), 1):
        pass
    assert "\n" not in str(refused.value)
