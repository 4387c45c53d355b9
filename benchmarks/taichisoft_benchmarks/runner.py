"""Runs cases one after the other, each repetition in a process of its own, beside a calibration."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from taichisoft_benchmarks import machine
from taichisoft_benchmarks.calibration import calibrate
from taichisoft_benchmarks.case_file import NamedCase
from taichisoft_benchmarks.child import Answer, measure_in_child
from taichisoft_benchmarks.derived import derive
from taichisoft_benchmarks.measures.measured import Measured
from taichisoft_benchmarks.results import CaseResult, Figure, Results
from taichisoft_benchmarks.scenes import Meshes


@dataclass(frozen=True)
class Progress:
    """What is being done now.

    Attributes:
        number: of the case, from 1.
        count: of cases.
        name: of the case.
        repetition: from 1.
        repeat: how many of them.
    """

    number: int
    count: int
    name: str
    repetition: int
    repeat: int


def run_cases(
    cases: Sequence[NamedCase],
    meshes: Meshes,
    repeat: int,
    quick: bool,
    on_progress: Callable[[Progress], None],
    on_result: Callable[[str, CaseResult], None],
) -> Results:
    """Measure all cases; one that fails is part of the results, and the rest go on. Ctrl and c ends the list early."""
    load = machine.load()
    found: dict[str, CaseResult] = {}
    started = time.strftime("%Y-%m-%dT%H:%M:%S%z")
    interrupted = False
    for number, named in enumerate(cases, start=1):

        def show(repetition: int, number: int = number, name: str = named.name) -> None:
            on_progress(Progress(number, len(cases), name, repetition, repeat))

        try:
            found[named.name] = measure_case(named, meshes, repeat, quick, show)
        except KeyboardInterrupt:
            interrupted = True
            break
        on_result(named.name, found[named.name])
    return Results(
        started=started,
        meshes="shipped" if meshes.tutorial is None else "tutorial",
        quick=quick,
        interrupted=interrupted,
        machine=machine.describe_machine(),
        versions=machine.versions(),
        load={"start": load, "end": machine.load()},
        cases=found,
        derived=derive(found),
    )


def measure_case(
    named: NamedCase, meshes: Meshes, repeat: int, quick: bool, on_repetition: Callable[[int], None]
) -> CaseResult:
    """All repetitions of a case; the first that cannot be measured ends it."""
    case = named.case.shortened() if quick else named.case
    answers: list[Answer] = []
    calibration: list[float] = []
    for repetition in range(1, repeat + 1):
        on_repetition(repetition)
        calibration.append(calibrate())
        answers.append(measure_in_child(case, meshes))
        if answers[-1].measured is None:
            break
    about: dict[str, Any] = {
        "group": named.group,
        "parameter": named.parameter,
        "title": case.title,
        "kind": case.kind,
        "threads": case.threads,
    }
    last = answers[-1]
    if last.measured is None:
        return CaseResult(**about, skipped=last.skipped, problem=last.problem)
    measured = [answer.measured for answer in answers if answer.measured is not None]
    return CaseResult(
        **about,
        figures=_figures(measured),
        facts=last.measured.facts,
        phases={window: phases for window, phases in last.measured.phases.items() if phases},
        calibration_ms=[round(value, 4) for value in calibration],
        does_not=last.measured.does_not,
    )


def _figures(repetitions: Sequence[Measured]) -> dict[str, Figure]:
    metrics = repetitions[0].figures
    return {metric: Figure.of([measured.figures[metric] for measured in repetitions]) for metric in metrics}
