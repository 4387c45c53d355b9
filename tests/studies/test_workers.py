"""Workers beyond this machine: those of a scheduler in processes of their own, and the jobs that SLURM is given."""

import json
import re
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import PATIENCE
from studies import command

from taichisoft_studies.extras import StudyError
from taichisoft_studies.workers import slurm_cluster

ROOT = Path(__file__).parents[2]
BLOCK = ROOT / "tests" / "meshing" / "block_kind.py"


@pytest.fixture
def scheduler(tmp_path: Path) -> Iterator[str]:
    """The address of a scheduler that has one worker."""
    told = tmp_path / "scheduler.json"
    both = [
        ["dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(told)],
        ["dask_worker", "--nworkers", "1", "--nthreads", "1", "--no-dashboard", "--scheduler-file", str(told)],
    ]
    processes = []
    for words in both:
        processes.append(
            subprocess.Popen(
                [sys.executable, "-m", f"distributed.cli.{words[0]}", *words[1:]],
                cwd=tmp_path,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
        )
        while not told.exists():
            assert processes[0].poll() is None
            time.sleep(0.05)
    yield json.loads(told.read_text())["address"]
    for process in processes:
        process.terminate()
        process.wait(timeout=PATIENCE)


def test_a_sweep_is_made_by_the_workers_of_a_scheduler(tmp_path: Path, scheduler: str) -> None:
    file, output = tmp_path / "block.toml", tmp_path / "out"
    file.write_text('kind = "block"\nsolid = true\n')
    told = ["--vary", "stretch=1,2", "-o", output, "--plugin", BLOCK, "--scheduler", scheduler]
    done = command("mesh-sweep", file, *told)
    assert (done.returncode, done.stderr) == (0, "")
    assert sorted(path.name for path in output.iterdir()) == ["stretch-1", "stretch-2", "summary.csv"]


def test_the_jobs_of_slurm_are_those_that_the_document_asks_for() -> None:
    pytest.importorskip("dask_jobqueue")
    document = (ROOT / "docs" / "studies.md").read_text(encoding="utf-8")
    (shown,) = re.findall(r"```toml\n(\[cluster\]\nworkers = .*?)```", document, re.DOTALL)[-1:]
    cluster, processes = slurm_cluster(tomllib.loads(shown)["cluster"]["slurm"])
    with cluster:
        script = cluster.job_script()
    assert processes == 16
    for line in ("-p normal", "-A my-project", "-n 1", "--cpus-per-task=16", "--mem=30G", "-t 04:00:00"):
        assert f"#SBATCH {line}\n" in script
    *_, prologue, worker = script.strip().splitlines()
    assert prologue == "source ~/soft/bin/activate"
    assert "--nworkers 16" in worker
    assert "--nthreads 1" in worker


def test_an_argument_that_slurm_does_not_know_is_one_line() -> None:
    pytest.importorskip("dask_jobqueue")
    with pytest.raises(StudyError, match=r"^cluster\.slurm: .*kue"):
        slurm_cluster({"kue": "normal"})
