"""Runs the variants of a sweep, several at a time, each in a process of its own."""

import multiprocessing
import os
import shutil
import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from pathlib import Path

from taichisoft.errors import MeshError
from taichisoft.running.interruption import deferred_signals
from taichisoft_meshing.mesh_set import move_set
from taichisoft_meshing.sweep.plan import Variant
from taichisoft_meshing.sweep.process import Outcome, make_variant


def available_cpus() -> int:
    """Number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def run_sweep(
    variants: Sequence[Variant], folder: Path, jobs: int, force: bool, done: Callable[[Variant, Outcome], None]
) -> list[Outcome]:
    """Make every variant into a folder of its name; one that fails does not stop the others.

    Sets are written to a folder beside, and moved when they are whole. When this is interrupted the processes are
    ended at once, whatever they do, and what they had begun is removed; sets that were complete stay.

    Args:
        variants: what is made.
        folder: the folder that holds theirs.
        jobs: how many processes at a time.
        force: write meshes that miss a limit, too.
        done: called when one has come to its end.

    Returns:
        What became of each, in the order of `variants`.

    Raises:
        MeshError: the folder cannot be written to.
    """
    unfinished = folder / f".sweep.{os.getpid()}.partial"
    running: dict[Connection, tuple[int, SpawnProcess]] = {}
    outcomes: dict[int, Outcome] = {}
    try:
        unfinished.mkdir(parents=True)
        waiting = list(range(len(variants)))[::-1]
        while waiting or running:
            while waiting and len(running) < jobs:
                number = waiting.pop()
                with deferred_signals() as stop_if_asked:  # half a start would leave a process that nobody ends
                    answer, process = _start(variants[number], unfinished, force)
                    running[answer] = number, process
                    stop_if_asked()
            ready = wait([*running])
            for answer in [answer for answer in running if answer in ready]:
                number, process = running.pop(answer)
                outcomes[number] = _finish(variants[number], answer, process, unfinished, folder)
                done(variants[number], outcomes[number])
    except OSError as error:
        raise MeshError(f"--output {folder}: cannot be written: {error.strerror or error}") from error
    finally:
        for _, process in running.values():
            process.kill()
            process.join()
        shutil.rmtree(unfinished, ignore_errors=True)
    return [outcomes[number] for number in range(len(variants))]


def _start(variant: Variant, unfinished: Path, force: bool) -> tuple[Connection, SpawnProcess]:
    context = multiprocessing.get_context("spawn")  # a fork would inherit whatever gmsh or Taichi have begun here
    folder = unfinished / variant.name
    folder.mkdir()
    answer, theirs = context.Pipe(duplex=False)
    process = context.Process(
        target=make_variant, args=(variant.job, folder, variant.name, force, theirs), daemon=True, name=variant.name
    )
    with _signals_blocked():
        process.start()
    theirs.close()  # so that the end of the process is the end of the pipe
    return answer, process


@contextmanager
def _signals_blocked() -> Iterator[None]:
    """What is started meanwhile never sees Ctrl and c, not even while it loads."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _finish(variant: Variant, answer: Connection, process: SpawnProcess, unfinished: Path, folder: Path) -> Outcome:
    outcome = None
    with suppress(EOFError):
        outcome = answer.recv()
    answer.close()
    process.join()
    if outcome is None:
        outcome = Outcome(f"{variant.job.file}: its process ended without a mesh (exit code {process.exitcode})", {})
    if not outcome.problem:
        with deferred_signals() as stop_if_asked:
            move_set(unfinished / variant.name, folder / variant.name)
            stop_if_asked()
    shutil.rmtree(unfinished / variant.name, ignore_errors=True)
    return outcome
