"""Starts a process that measures one repetition, with the threads and the folders that the case asks for."""

import json
import os
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from taichisoft.child_process import run_python
from taichisoft_benchmarks.descriptors import Case, StartCase
from taichisoft_benchmarks.measures.measured import Measured
from taichisoft_benchmarks.scenes import Meshes

BLAS_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass(frozen=True)
class Answer:
    """What a repetition gave: exactly one of the three.

    Attributes:
        measured: the figures.
        skipped: why there is nothing to measure.
        problem: how it failed, one line.
    """

    measured: Measured | None = None
    skipped: str = ""
    problem: str = ""


def measure_in_child(case: Case, meshes: Meshes) -> Answer:
    """One repetition."""
    with TemporaryDirectory(prefix="taichisoft-bench-") as name:
        folder = Path(name)
        job = {
            "case": case.model_dump(mode="json"),
            "tutorial": str(meshes.tutorial) if meshes.tutorial else "",
            "made": str(meshes.made),
        }
        (folder / "job.json").write_text(json.dumps(job), encoding="utf-8")
        problem = run_python(
            ["-m", "taichisoft_benchmarks.case_process", folder / "job.json", folder / "result.json"],
            case.time_limit,
            {**os.environ, **environment_of(case, folder)},
            folder,  # some programs leave logs where they run
        ).problem
        if problem:
            return Answer(problem=problem)
        answer = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    if "measured" in answer:
        return Answer(Measured(**answer["measured"]))
    return Answer(skipped=answer.get("skipped", ""), problem=answer.get("problem", ""))


def environment_of(case: Case, folder: Path) -> dict[str, str]:
    """Variables that the process gets beside ours; `folder` is new and only the process's own."""
    changes = {}
    if case.threads:
        changes = dict.fromkeys(("TAICHISOFT_THREADS", *BLAS_THREADS), str(case.threads))
    if isinstance(case, StartCase) and case.cold:
        changes["TI_OFFLINE_CACHE_FILE_PATH"] = str(folder / "kernels")
    return changes
