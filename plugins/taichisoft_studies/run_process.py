"""The process that makes runs one after the other: it takes jobs from standard input, a line each, and answers them.

It ends with the process that started it: where standard input closes, even in the middle of a run, nobody waits for it.
What a run prints, in Python or in C, goes to the run's log.
"""

import io
import json
import os
import queue
import signal
import sys
import threading
import traceback
from typing import Any

from taichisoft.errors import TaichisoftError
from taichisoft_studies.run_job import RunJob

READY = "ready"
RUN, MESH = "run", "mesh"


def main(with_engine: bool, plugins: list[str]) -> None:
    """Load what runs need, say that it is ready, and make them."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # whoever started us decides
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8", buffering=1)
    os.dup2(2, 1)
    assert isinstance(sys.stdout, io.TextIOWrapper)
    sys.stdout.reconfigure(line_buffering=True)  # a killed run keeps all its lines
    jobs: queue.Queue[str] = queue.Queue()
    threading.Thread(target=_take_jobs, args=(jobs,), daemon=True).start()
    answers.write(_line(_loaded(with_engine, plugins)))
    while True:
        job = json.loads(jobs.get())
        answers.write(_line(_answer(job)))


def _loaded(with_engine: bool, plugins: list[str]) -> dict[str, Any]:
    try:
        if with_engine:
            import taichisoft.building.simulation  # noqa: F401  # starts Taichi
        from taichisoft.plugin_system.plugins import load_plugin, plugin_registry

        plugin_registry()
        for plugin in plugins:
            load_plugin(plugin)
    except Exception as error:
        return {"error": " ".join(str(error).split())}
    return {READY: True}


def _take_jobs(jobs: "queue.Queue[str]") -> None:
    for line in sys.stdin:
        jobs.put(line)
    os._exit(1)


def _answer(request: dict[str, Any]) -> dict[str, Any]:
    from taichisoft_studies.make_mesh import MeshRun, make_variant
    from taichisoft_studies.make_run import make_run
    from taichisoft_studies.run_log import printed_to

    try:
        if request["kind"] == MESH:
            return make_variant(MeshRun.from_json(request["job"]))
        return make_run(RunJob.from_json(request["job"]), printed_to)
    except TaichisoftError as error:
        return {"error": " ".join(str(error).split())}
    except Exception as error:
        traceback.print_exc()
        return {"error": f"{type(error).__name__}: {' '.join(str(error).split())}"}


def _line(answer: dict[str, Any]) -> str:
    return json.dumps(answer) + "\n"


if __name__ == "__main__":
    main(sys.argv[1] == "1", sys.argv[2:])
