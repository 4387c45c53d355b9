"""What the process beside a worker does: it makes runs and meshes, one after the other.

What a run prints, in Python or in C, goes to the run's log.
"""

import io
import sys
import traceback
from collections.abc import Sequence
from typing import Any

from taichisoft.errors import TaichisoftError
from taichisoft.worker import Link
from taichisoft_studies.run_job import RunJob

RUN, MESH = "run", "mesh"


def make_runs(link: Link) -> None:
    """Load what runs need, say that it is loaded, and make them.

    The first message is paths of plug-ins, and whether runs are simulated; each further one is RUN or MESH and the job
    as JSON, answered by the run's record or the mesh's outcome, or by {"error": ...}.
    """
    assert isinstance(sys.stdout, io.TextIOWrapper)
    sys.stdout.reconfigure(line_buffering=True)  # a killed run keeps all its lines
    _load(*link.receive())
    link.send("ready")
    while True:
        link.send(_answer(*link.receive()))


def _load(plugins: Sequence[str], with_engine: bool) -> None:
    if with_engine:
        from taichisoft.building import Simulation  # noqa: F401  # starts Taichi
    from taichisoft.plugin_system import load_plugin, plugin_registry

    plugin_registry()
    for plugin in plugins:
        load_plugin(plugin)


def _answer(kind: str, job: str) -> dict[str, Any]:
    from taichisoft_studies.make_mesh import MeshRun, make_variant
    from taichisoft_studies.make_run import make_run
    from taichisoft_studies.run_log import printed_to

    try:
        if kind == MESH:
            return make_variant(MeshRun.from_json(job))
        return make_run(RunJob.from_json(job), printed_to)
    except TaichisoftError as error:
        return {"error": " ".join(str(error).split())}
    except Exception as error:
        traceback.print_exc()
        return {"error": f"{type(error).__name__}: {' '.join(str(error).split())}"}
