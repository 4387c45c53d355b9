"""One repetition of a case, measured in a process of its own.

A process of its own because the number of threads is chosen before Taichi starts, and because compiled kernels, memory
and a crash stay its own. It is `python -m taichisoft_benchmarks.case_process JOB RESULT`, with two files of JSON:
`measure_in_process` writes the one and reads the other.
"""

import json
import os
import sys
import warnings
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from taichisoft.child_process import run_python
from taichisoft.errors import TaichisoftError
from taichisoft_benchmarks import cases
from taichisoft_benchmarks.cases import Case, MeshingCase, StartCase
from taichisoft_benchmarks.errors import PeerMissing
from taichisoft_benchmarks.measures.measured import Measured
from taichisoft_benchmarks.scenes import Meshes, scene_of

BLAS_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass(frozen=True)
class Answer:
    """The outcome of a repetition: exactly one of the three.

    Attributes:
        measured: the figures.
        skipped: why there is nothing to measure.
        problem: how it failed, one line.
    """

    measured: Measured | None = None
    skipped: str = ""
    problem: str = ""


def measure_in_process(case: Case, meshes: Meshes) -> Answer:
    """Measure one repetition."""
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
    return Answer(**answer)


def environment_of(case: Case, folder: Path) -> dict[str, str]:
    """Variables that the process gets beside ours; `folder` is new and the process's own."""
    changes = {}
    if case.threads:
        changes = dict.fromkeys(("TAICHISOFT_THREADS", *BLAS_THREADS), str(case.threads))
    if isinstance(case, StartCase) and case.cold:
        changes["TI_OFFLINE_CACHE_FILE_PATH"] = str(folder / "kernels")
    return changes


def main() -> None:
    """Measure the job; RESULT has `measured`, `skipped` or `problem`."""
    job = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
    warnings.simplefilter("ignore")  # the cases are meant as they are, and stderr is for what goes wrong
    answer: dict[str, Any]
    try:
        model = cases.PeerCase if "peer" in job["case"] else cases.KINDS[job["case"]["kind"]]
        tutorial = Path(job["tutorial"]) if job["tutorial"] else None
        answer = {"measured": asdict(_measure(model.model_validate(job["case"]), Meshes(tutorial, Path(job["made"]))))}
    except PeerMissing as missing:
        answer = {"skipped": str(missing)}
    except TaichisoftError as error:
        answer = {"problem": " ".join(str(error).split())}
    Path(sys.argv[2]).write_text(json.dumps(answer), encoding="utf-8")


def _measure(case: Case, meshes: Meshes) -> Measured:
    """Measure a case in the way of its kind.

    Raises:
        TaichisoftError: the case cannot be made, or failed.
        PeerMissing: another program is not installed.
    """
    from taichisoft_benchmarks.measures import factorisation, outputs, peer_steps, preparation, steps, throughput

    if isinstance(case, MeshingCase):
        return preparation.measure_meshing(case)
    if isinstance(case, StartCase):
        return preparation.measure_start(case, meshes)
    measures: dict[type[Case], Callable[..., Measured]] = {
        cases.StepsCase: steps.measure_steps,
        cases.ContactsCase: steps.measure_steps,
        cases.FingersCase: steps.measure_steps,
        cases.PluginsCase: steps.measure_plugins,
        cases.PeerCase: peer_steps.measure_peer,
        cases.FactorisationCase: factorisation.measure_factorisation,
        cases.RecordingCase: outputs.measure_recording,
        cases.RenderingCase: outputs.measure_rendering,
        cases.WebCase: outputs.measure_web,
        cases.ThroughputCase: throughput.measure_throughput,
    }
    return measures[type(case)](case, scene_of(case, meshes))


if __name__ == "__main__":
    main()
