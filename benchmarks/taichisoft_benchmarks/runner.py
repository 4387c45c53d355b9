"""Runs cases one after the other, each repetition in a process of its own, beside a calibration."""

import time
from collections.abc import Callable, Sequence
from typing import Any

from taichisoft_benchmarks import machine
from taichisoft_benchmarks.case_process import Answer, measure_in_process
from taichisoft_benchmarks.cases import NamedCase
from taichisoft_benchmarks.results import CaseResult, Figure, Results, derive
from taichisoft_benchmarks.scenes import Meshes


def run_cases(
    cases: Sequence[NamedCase],
    meshes: Meshes,
    repeat: int,
    quick: bool,
    on_progress: Callable[[str], None],
    on_result: Callable[[str, CaseResult], None],
) -> Results:
    """Measure all cases; one that fails is part of the results, and the rest go on. Ctrl and c ends the list early.

    Args:
        cases: cases in the order of the run.
        meshes: folders of meshes.
        repeat: number of repetitions of each case.
        quick: whether to make few steps.
        on_progress: called with a line before each repetition.
        on_result: called with the name and the result of each case.
    """
    load = machine.load()
    found: dict[str, CaseResult] = {}
    started = time.strftime("%Y-%m-%dT%H:%M:%S%z")
    interrupted = False
    for number, named in enumerate(cases, start=1):
        where = f"case {number} of {len(cases)}"
        try:
            found[named.name] = measure_case(named, meshes, repeat, quick, on_progress, where)
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
    named: NamedCase, meshes: Meshes, repeat: int, quick: bool, on_progress: Callable[[str], None], where: str
) -> CaseResult:
    """Measure all repetitions of a case; the first that cannot be measured ends it. `where` begins every progress."""
    case = named.case.shortened() if quick else named.case
    answers: list[Answer] = []
    calibration: list[float] = []
    for repetition in range(1, repeat + 1):
        on_progress(f"{where}: {named.name}, run {repetition} of {repeat}")
        calibration.append(machine.calibrate())
        answers.append(measure_in_process(case, meshes))
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
    repetitions = [answer.measured.figures for answer in answers if answer.measured is not None]
    return CaseResult(
        **about,
        figures={metric: Figure.of([figures[metric] for figures in repetitions]) for metric in repetitions[0]},
        facts=last.measured.facts,
        phases=last.measured.phases,
        calibration_ms=[round(value, 4) for value in calibration],
        does_not=last.measured.does_not,
    )
