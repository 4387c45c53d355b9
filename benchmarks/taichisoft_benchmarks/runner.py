"""Runs cases in rounds, each repetition in its own process, beside a calibration.

A round runs every case once: a shared machine is slow for minutes at a time, which then affects a case and the other
programs that it is compared with alike.
"""

import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

from taichisoft.base import WorkerLost, call_apart
from taichisoft.errors import TaichisoftError
from taichisoft_benchmarks import cases, machine
from taichisoft_benchmarks.case_scenes import Meshes, scene_of
from taichisoft_benchmarks.cases import Case, MeshingCase, NamedCase, StartCase
from taichisoft_benchmarks.errors import PeerMissing
from taichisoft_benchmarks.measures import Measured
from taichisoft_benchmarks.results import CaseResult, RepeatedMetric, Results, derive


@dataclass(frozen=True)
class Answer:
    """The outcome of a repetition: figures, or why there are none.

    Attributes:
        measured: the figures.
        skipped: why the case cannot be measured.
        problem: how the case failed, one line.
        calibration_ms: time of the calibration beside it [ms].
    """

    measured: Measured | None = None
    skipped: str = ""
    problem: str = ""
    calibration_ms: float = 0.0


def run_cases(
    cases: Sequence[NamedCase],
    meshes: Meshes,
    repeat: int,
    quick: bool,
    on_progress: Callable[[str], None],
    on_result: Callable[[str, CaseResult], None],
) -> Results:
    """Measure all cases; a case that fails is part of the results, and the others go on. Ctrl+C ends the rounds early.

    Args:
        cases: cases in the order of a round.
        meshes: folders of meshes.
        repeat: number of rounds.
        quick: whether to make few steps.
        on_progress: called with a line before each repetition.
        on_result: called with the name and the result of each case after its last repetition.
    """
    load, started = machine.load(), time.strftime("%Y-%m-%dT%H:%M:%S%z")
    answers: dict[str, list[Answer]] = {named.name: [] for named in cases}
    results: dict[str, CaseResult] = {}

    def conclude(named: NamedCase) -> None:
        results[named.name] = _result(named, answers[named.name])
        on_result(named.name, results[named.name])

    interrupted = False
    try:
        for round_number in range(1, repeat + 1):
            for number, named in enumerate(cases, start=1):
                if named.name in results:  # it failed, or cannot be measured
                    continue
                on_progress(f"round {round_number} of {repeat}, case {number} of {len(cases)}: {named.name}")
                calibration = machine.calibrate()
                answer = measure_in_process(named.case.shortened() if quick else named.case, meshes)
                answers[named.name].append(replace(answer, calibration_ms=round(calibration, 4)))
                if answer.measured is None or round_number == repeat:
                    conclude(named)
    except KeyboardInterrupt:
        interrupted = True
        for named in cases:
            if named.name not in results and answers[named.name]:
                conclude(named)
    ordered = {named.name: results[named.name] for named in cases if named.name in results}
    return Results(
        started=started,
        meshes="shipped" if meshes.tutorial is None else "tutorial",
        quick=quick,
        interrupted=interrupted,
        machine=machine.describe_machine(),
        versions=machine.versions(),
        load={"start": load, "end": machine.load()},
        cases=ordered,
        derived=derive(ordered),
    )


def _result(named: NamedCase, answers: Sequence[Answer]) -> CaseResult:
    """The result of a case from its repetitions; none count if the last one failed."""
    case, last = named.case, answers[-1]
    about: dict[str, Any] = {"group": named.group, "parameter": named.parameter, "title": case.title}
    about |= {"kind": case.kind, "threads": case.threads}
    if last.measured is None:
        return CaseResult(**about, skipped=last.skipped, problem=last.problem)
    measured = [answer.measured for answer in answers if answer.measured is not None]
    return CaseResult(
        **about,
        figures={
            metric: RepeatedMetric.of([each.figures[metric] for each in measured]) for metric in measured[0].figures
        },
        facts=last.measured.facts,
        phases={phase: median(each.phases[phase] for each in measured) for phase in last.measured.phases},
        calibration_ms=[answer.calibration_ms for answer in answers],
        does_not=last.measured.does_not,
    )


def measure_in_process(case: Case, meshes: Meshes) -> Answer:
    """Measure one repetition."""
    with TemporaryDirectory(prefix="taichisoft-bench-") as name:
        folder = Path(name)
        try:
            answer: Answer = call_apart(
                "taichisoft_benchmarks.runner:measure_here",
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
    """Measure one repetition in this process."""
    warnings.simplefilter("ignore")  # the cases are meant as they are, and stderr is for what goes wrong
    try:
        return Answer(_measure(case, meshes))
    except PeerMissing as missing:
        return Answer(skipped=str(missing))


def environment_of(case: Case, folder: Path) -> dict[str, str]:
    """Variables that the process gets beside ours; `folder` is new and the process's own."""
    changes = {}
    if case.threads:
        changes = dict.fromkeys(("TAICHISOFT_THREADS", *machine.ONE_THREAD), str(case.threads))
    if isinstance(case, StartCase) and case.cold:
        changes["XDG_CACHE_HOME"] = str(folder / "cache")
    return changes


def _measure(case: Case, meshes: Meshes) -> Measured:
    from taichisoft_benchmarks import measures

    if isinstance(case, MeshingCase):
        return measures.measure_meshing(case)
    if isinstance(case, StartCase):
        return measures.measure_start(case, meshes)
    kinds: dict[type[Case], Callable[..., Measured]] = {
        cases.StepsCase: measures.measure_steps,
        cases.ContactsCase: measures.measure_steps,
        cases.PeerCase: measures.measure_peer,
        cases.FactorisationCase: measures.measure_factorisation,
        cases.RecordingCase: measures.measure_recording,
    }
    return kinds[type(case)](case, scene_of(case, meshes))
