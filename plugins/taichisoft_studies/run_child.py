"""The process beside a worker that makes its runs: it can be killed when one takes too long, and may crash.

Taichi and its kernels are loaded once for many runs, since that takes longer than a short run.
"""

from collections.abc import Sequence

from taichisoft.errors import TaichisoftError
from taichisoft.worker import Worker, WorkerLost, WorkerSlow

START_LIMIT = 600.0
"""Time that the process has to load Taichi and the plug-ins [s]; on a busy network disk it may take minutes."""

_child: tuple[Worker, tuple[str, ...], bool] | None = None


def child_with(plugins: Sequence[str], with_engine: bool) -> Worker:
    """The process of this worker, which makes runs with these plug-ins: the one that is there, or a new one.

    Args:
        plugins: paths of the plug-ins that it has loaded.
        with_engine: whether it has loaded Taichi, outside of any run's time limit.

    Raises:
        WorkerLost: it cannot start; the text says why.
    """
    global _child
    wanted = (tuple(plugins), with_engine)
    if _child is None or not _child[0].alive or _child[1:] != wanted:
        if _child is not None:
            _child[0].end()
            _child = None
        _child = (_started(*wanted), *wanted)
    return _child[0]


def _started(plugins: tuple[str, ...], with_engine: bool) -> Worker:
    one_thread = {"TAICHISOFT_THREADS": "1", "OMP_NUM_THREADS": "1"}
    worker = Worker("taichisoft_studies.run_process:make_runs", one_thread, captured=False)
    try:
        worker.ask((plugins, with_engine), START_LIMIT)
    except WorkerSlow as slow:
        raise WorkerLost(f"it did not start within {START_LIMIT:g} s") from slow
    except TaichisoftError as error:
        worker.end()
        raise WorkerLost(str(error)) from error
    return worker
