"""One repetition of a case, measured in a process of its own.

The number of threads is chosen before Taichi starts, and compiled kernels, memory and a crash stay within the process.
"""

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from taichisoft.base import WorkerLost, call_apart
from taichisoft.errors import TaichisoftError
from taichisoft_benchmarks import cases
from taichisoft_benchmarks.case_scenes import Meshes, scene_of
from taichisoft_benchmarks.cases import Case, MeshingCase, StartCase
from taichisoft_benchmarks.errors import PeerMissing
from taichisoft_benchmarks.measures.measured import Measured

BLAS_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass(frozen=True)
class Answer:
    """The outcome of a repetition: exactly one of the three.

    Attributes:
        measured: the figures.
        skipped: why the case cannot be measured.
        problem: how the case failed, one line.
    """

    measured: Measured | None = None
    skipped: str = ""
    problem: str = ""


def measure_in_process(case: Case, meshes: Meshes) -> Answer:
    """Measure one repetition."""
    with TemporaryDirectory(prefix="taichisoft-bench-") as name:
        folder = Path(name)
        try:
            answer: Answer = call_apart(
                "taichisoft_benchmarks.case_process:measure_here",
                case,
                meshes,
                time_limit=case.time_limit,
                environment=environment_of(case, folder),
                folder=folder,  # some programs leave logs where they run
            )
        except (WorkerLost, TaichisoftError) as error:
            return Answer(problem=" ".join(str(error).split()))
    return answer


def measure_here(case: Case, meshes: Meshes) -> Answer:
    """What the process does.

    Raises:
        TaichisoftError: the case cannot be made, or failed.
    """
    warnings.simplefilter("ignore")  # the cases are meant as they are, and stderr is for what goes wrong
    try:
        return Answer(_measure(case, meshes))
    except PeerMissing as missing:
        return Answer(skipped=str(missing))


def environment_of(case: Case, folder: Path) -> dict[str, str]:
    """Variables that the process gets beside ours; `folder` is new and the process's own."""
    changes = {}
    if case.threads:
        changes = dict.fromkeys(("TAICHISOFT_THREADS", *BLAS_THREADS), str(case.threads))
    if isinstance(case, StartCase) and case.cold:
        changes["XDG_CACHE_HOME"] = str(folder / "cache")
    return changes


def _measure(case: Case, meshes: Meshes) -> Measured:
    """Measure a case in the way of its kind.

    Raises:
        TaichisoftError: the case cannot be made, or failed.
        PeerMissing: another program is not installed.
    """
    from taichisoft_benchmarks.measures import (
        factorisation_times,
        output_costs,
        peer_steps,
        preparation,
        steps,
        throughput,
    )

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
        cases.FactorisationCase: factorisation_times.measure_factorisation,
        cases.RecordingCase: output_costs.measure_recording,
        cases.RenderingCase: output_costs.measure_rendering,
        cases.WebCase: output_costs.measure_web,
        cases.ThroughputCase: throughput.measure_throughput,
    }
    return measures[type(case)](case, scene_of(case, meshes))
