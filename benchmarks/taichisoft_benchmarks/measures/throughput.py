"""Steps per second of independent runs, with a process of one thread on every core."""

import multiprocessing
import time
from collections.abc import Callable
from queue import Queue
from threading import Barrier
from typing import Any

from taichisoft import Scene
from taichisoft.runtime import available_cores
from taichisoft_benchmarks.cases import ThroughputCase
from taichisoft_benchmarks.errors import BenchmarkError, PeerMissing
from taichisoft_benchmarks.measures.measured import Measured, controlled_step
from taichisoft_benchmarks.measures.peer_steps import controlled_peer_step, set_up_peer

PATIENCE = 300.0
"""Longest time that one process waits for the others to be ready [s]: the first may have kernels to compile."""


def measure_throughput(case: ThroughputCase, scene: Scene) -> Measured:
    """Make as many runs at once as there are cores, ours and then MuJoCo's; the clock runs from when all are ready.

    A run begins at the scene's start, and its first step is made before: the cost of a start is in the cases of
    kind "start". MuJoCo does a part of the job, see `MujocoPeer.does_not`.

    Raises:
        BenchmarkError: a process failed.
    """
    cores = available_cores()
    figures = {"ours_per_s": _steps_per_second(prepare_ours, scene, case.steps, cores)}
    facts: dict[str, Any] = {"processes": cores, "steps": case.steps}
    try:
        figures["mujoco_per_s"] = _steps_per_second(prepare_mujoco, scene, case.steps, cores)
        figures["over_mujoco"] = figures["ours_per_s"] / figures["mujoco_per_s"]
    except PeerMissing as missing:
        facts["mujoco_skipped"] = str(missing)
    return Measured(figures, facts)


def prepare_ours(scene: Scene) -> Callable[[], Any]:
    """A function that makes one step in taichisoft."""
    from taichisoft.running import Simulation

    return controlled_step(Simulation(scene), scene)


def prepare_mujoco(scene: Scene) -> Callable[[], Any]:
    """A function that makes one step in MuJoCo.

    Raises:
        PeerMissing: it is not installed.
    """
    return controlled_peer_step(scene, *set_up_peer(scene, "mujoco"))


Prepare = Callable[[Scene], Callable[[], Any]]


def _steps_per_second(prepare: Prepare, scene: Scene, steps: int, processes: int) -> float:
    """Steps of all processes over the time of the slowest.

    Raises:
        PeerMissing: the program is not installed.
        BenchmarkError: a process failed.
    """
    context = multiprocessing.get_context("spawn")
    barrier, answers = context.Barrier(processes), context.Queue()
    children = [context.Process(target=_run, args=(prepare, scene, steps, barrier, answers)) for _ in range(processes)]
    for child in children:
        child.start()
    answered = [answers.get() for _ in children]
    for child in children:
        child.join()
    failures = [answer for answer in answered if isinstance(answer, Exception)]
    if failures:
        # The processes that waited for a failed one fail with it: its error comes first.
        raise next((one for one in failures if isinstance(one, PeerMissing)), failures[0])
    return processes * steps / max(answered)


def _run(prepare: Prepare, scene: Scene, steps: int, barrier: Barrier, answers: "Queue[float | Exception]") -> None:
    """Answer with the seconds of the steps, or with the error."""
    try:
        step = prepare(scene)
        step()
        barrier.wait(PATIENCE)
        started = time.perf_counter()
        for _ in range(steps):
            step()
        answers.put(time.perf_counter() - started)
    except PeerMissing as missing:
        barrier.abort()
        answers.put(missing)
    except Exception as error:
        barrier.abort()
        answers.put(BenchmarkError(f"a process of several at once failed: {type(error).__name__}: {error}"))
