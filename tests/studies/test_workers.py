"""Workers of a study: processes of this machine, and those of a Dask scheduler."""

import csv
from pathlib import Path

import pytest
from studies import command, plugin

from taichisoft.pytest_fixtures import TINY_GRIPPER
from taichisoft_studies.errors import StudyError
from taichisoft_studies.study_file import Cluster
from taichisoft_studies.workers import caution, study_workers

SWEEP = ["--controller", "squeeze", "--duration", "0.02", "--vary", "controller.settings.pressure=1,2,3,high"]


def test_sweep_runs_on_local_dask_scheduler(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two workers of a scheduler give the table that processes of this machine give, byte by byte."""
    distributed = pytest.importorskip("distributed", reason="the extra studies is not installed")
    monkeypatch.setenv("TAICHISOFT_THREADS", "1")
    words = ["study", "sweep", TINY_GRIPPER, *SWEEP, "--plugin", plugin(tmp_path)]
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        address = cluster.scheduler_address
        apart = command(*words, "-o", tmp_path / "dask", "--scheduler", address)
    here = command(*words, "-o", tmp_path / "here", "--jobs", 2)
    assert (apart.returncode, here.returncode) == (1, 1), apart.stderr + here.stderr
    assert f"2 workers of {address}" in apart.stdout
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
