"""Run a task on a SLURM cluster whose `sbatch` starts jobs here, and examine its files and ports; takes a folder."""

import stat
import sys
from pathlib import Path

import psutil
from ports import listening, open_doors

from taichisoft_studies.study_file import Cluster
from taichisoft_studies.workers import dask_workers

if __name__ == "__main__":
    folder = Path(sys.argv[1]).resolve()
    with dask_workers(Cluster(workers=5, slurm={"cores": 1}), 1, folder) as made:
        assert made.count == 1
        files = [path for path in folder.rglob("*") if path.is_file()]
        assert {stat.S_IMODE(path.stat().st_mode) for path in files} == {0o600}
        assert {stat.S_IMODE(path.parent.stat().st_mode) for path in files} == {0o700}
        made.submit("ours", len, "abc")
        assert made.next_done() == ("ours", 3)
        job = psutil.Process(int(Path("job.id").read_text().split()[-1]))
        ports = listening(job.pid)
        assert "127.0.0.1" in {address for address, _ in ports}  # the worker's page
        assert [problem for _, port in ports for problem in open_doors("127.0.0.1", port)] == []
    assert list(folder.iterdir()) == []
    for process in (job, *job.children(recursive=True)):
        process.kill()
