"""The process that measures one repetition of one case: `python -m taichisoft_benchmarks.case_process JOB RESULT`.

JOB and RESULT are JSON files. A process of its own because the number of threads is chosen before Taichi starts,
and because compiled kernels, memory and a crash stay its own. `child` starts it; nothing else should.
"""

import json
import sys
import warnings
from dataclasses import asdict
from pathlib import Path
from typing import Any

from taichisoft.errors import TaichisoftError
from taichisoft_benchmarks.descriptors import (
    KINDS,
    Case,
    FactorisationCase,
    MeshingCase,
    PeerCase,
    PluginsCase,
    RecordingCase,
    RenderingCase,
    Simulated,
    StartCase,
    WebCase,
)
from taichisoft_benchmarks.errors import BenchmarkError, PeerMissing
from taichisoft_benchmarks.measures.measured import Measured
from taichisoft_benchmarks.scenes import Meshes, scene_of


def main() -> None:
    """Measure the job; RESULT has `measured`, `skipped` or `problem`."""
    job = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
    warnings.simplefilter("ignore")  # the cases are meant as they are, and stderr is for what goes wrong
    answer: dict[str, Any]
    try:
        model = PeerCase if "peer" in job["case"] else KINDS[job["case"]["kind"]]
        tutorial = Path(job["tutorial"]) if job["tutorial"] else None
        answer = {"measured": asdict(measure(model.model_validate(job["case"]), Meshes(tutorial, Path(job["made"]))))}
    except PeerMissing as missing:
        answer = {"skipped": str(missing)}
    except TaichisoftError as error:
        answer = {"problem": " ".join(str(error).split())}
    Path(sys.argv[2]).write_text(json.dumps(answer), encoding="utf-8")


def measure(case: Case, meshes: Meshes) -> Measured:
    """One repetition, by kind.

    Raises:
        TaichisoftError: the case cannot be made, or failed.
        PeerMissing: another program is not installed.
    """
    if isinstance(case, StartCase):
        from taichisoft_benchmarks.measures.start import measure_start

        return measure_start(case, meshes)
    if isinstance(case, MeshingCase):
        from taichisoft_benchmarks.measures.meshing import measure_meshing

        return measure_meshing(case)
    scene = scene_of(case, meshes)
    if isinstance(case, PeerCase):
        from taichisoft_benchmarks.peers.steps import measure_peer

        return measure_peer(case, scene)
    if isinstance(case, FactorisationCase):
        from taichisoft_benchmarks.measures.factorisation import measure_factorisation

        return measure_factorisation(case, scene)
    if isinstance(case, RenderingCase):
        from taichisoft_benchmarks.measures.rendering import measure_rendering

        return measure_rendering(case, scene)
    if isinstance(case, RecordingCase):
        from taichisoft_benchmarks.measures.recording import measure_recording

        return measure_recording(case, scene)
    if isinstance(case, WebCase):
        from taichisoft_benchmarks.measures.web import measure_web

        return measure_web(case, scene)
    if isinstance(case, PluginsCase):
        from taichisoft_benchmarks.measures.plugins import measure_plugins

        return measure_plugins(case, scene)
    if isinstance(case, Simulated):
        from taichisoft_benchmarks.measures.steps import measure_steps

        return measure_steps(case, scene)
    raise BenchmarkError(f"cases of kind '{case.kind}' cannot be measured")


if __name__ == "__main__":
    main()
