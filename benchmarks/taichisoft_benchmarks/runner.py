"""Runs cases in rounds, each repetition in a process of its own, beside a calibration.

A round runs every case once: a shared machine is slow for minutes at a time, which then affects a case and the other
programs that it is compared with alike.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from statistics import median
from typing import Any

from taichisoft_benchmarks import machine
from taichisoft_benchmarks.case_process import measure_in_process
from taichisoft_benchmarks.case_results import CaseResult, RepeatedMetric, Results, derive
from taichisoft_benchmarks.case_scenes import Meshes
from taichisoft_benchmarks.cases import NamedCase
from taichisoft_benchmarks.measures.measured import Measured


@dataclass
class Repetitions:
    """The repetitions of a case so far.

    Attributes:
        measured: of each repetition that could be measured.
        calibration: beside each of them [ms].
        skipped, problem: why the case ended, as in `Answer`; then it is not repeated.
    """

    measured: list[Measured] = field(default_factory=list)
    calibration: list[float] = field(default_factory=list)
    skipped: str = ""
    problem: str = ""

    @property
    def ended(self) -> bool:
        """Whether a repetition could not be measured."""
        return bool(self.skipped or self.problem)


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
    load = machine.load()
    found = {named.name: Repetitions() for named in cases}
    started = time.strftime("%Y-%m-%dT%H:%M:%S%z")
    results: dict[str, CaseResult] = {}

    def conclude(named: NamedCase) -> None:
        results[named.name] = _result(named, found[named.name])
        on_result(named.name, results[named.name])

    interrupted = False
    try:
        for round_number in range(1, repeat + 1):
            for number, named in enumerate(cases, start=1):
                repetitions = found[named.name]
                if repetitions.ended:
                    continue
                on_progress(f"round {round_number} of {repeat}, case {number} of {len(cases)}: {named.name}")
                _repeat(named, meshes, quick, repetitions)
                if repetitions.ended or round_number == repeat:
                    conclude(named)
    except KeyboardInterrupt:
        interrupted = True
        for named in cases:
            if named.name not in results and found[named.name].measured:
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


def _repeat(named: NamedCase, meshes: Meshes, quick: bool, repetitions: Repetitions) -> None:
    """Measure a case once more."""
    calibration = machine.calibrate()
    answer = measure_in_process(named.case.shortened() if quick else named.case, meshes)
    if answer.measured is None:
        repetitions.skipped, repetitions.problem = answer.skipped, answer.problem
    else:
        repetitions.measured.append(answer.measured)
        repetitions.calibration.append(calibration)


def _result(named: NamedCase, repetitions: Repetitions) -> CaseResult:
    """The result of a case from its repetitions; none count if one failed."""
    about: dict[str, Any] = {
        "group": named.group,
        "parameter": named.parameter,
        "title": named.case.title,
        "kind": named.case.kind,
        "threads": named.case.threads,
    }
    if repetitions.ended:
        return CaseResult(**about, skipped=repetitions.skipped, problem=repetitions.problem)
    measured, last = repetitions.measured, repetitions.measured[-1]
    return CaseResult(
        **about,
        figures={
            metric: RepeatedMetric.of([one.figures[metric] for one in measured]) for metric in measured[0].figures
        },
        facts=last.facts,
        phases={phase: median(one.phases[phase] for one in measured) for phase in last.phases},
        calibration_ms=[round(value, 4) for value in repetitions.calibration],
        does_not=last.does_not,
    )
