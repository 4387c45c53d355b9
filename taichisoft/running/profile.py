"""Profile of the phases of a step. Without profiling nothing is measured, at no cost."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from taichisoft.runtime.launch import timed_launches
from taichisoft.step.time_stepper import TimeStepper

REST = "rest"
TOTAL = "step"


@dataclass
class Profile:
    """Times of the phases of all profiled steps.

    Attributes:
        seconds: times of all steps [s], by phase; `TOTAL` is the whole step.
        in_python: parts of these times outside kernels [s].
    """

    seconds: dict[str, list[float]] = field(default_factory=dict)
    in_python: dict[str, list[float]] = field(default_factory=dict)

    def medians(self) -> dict[str, tuple[float, float]]:
        """Median time of each phase and the part of it in Python [ms], in the order of the step."""
        return {
            phase: (1e3 * float(np.median(times)), 1e3 * float(np.median(self.in_python[phase])))
            for phase, times in self.seconds.items()
        }


@contextmanager
def profiled(simulation: TimeStepper) -> Iterator[Profile]:
    """Measure the steps within the context."""
    phases = _phases(simulation)
    profile, clock = Profile(), _Clock(list(phases))
    watched = [(owner, method, phase) for phase, calls in phases.items() for owner, method in calls]
    for owner, method, phase in watched:
        setattr(owner, method, clock.watch(getattr(owner, method), phase))
    simulation.step = clock.watch_step(simulation.step, profile)  # type: ignore[method-assign]
    try:
        with timed_launches(clock.add_launch):
            yield profile
    finally:
        for owner, method, _ in watched:
            delattr(owner, method)  # restores the class's method
        del simulation.step


def _phases(simulation: TimeStepper) -> dict[str, list[tuple[Any, str]]]:
    """Methods of each phase; nested calls of methods of other phases count there."""
    constraints, soft = simulation._constraint_solver, simulation._soft
    soft_phases: dict[str, list[tuple[Any, str]]] = {}
    if soft is not None:
        soft_phases = {
            "actuators": [(simulation, "_request")],
            "rotations and assembly": [(soft.system, "assemble")],
            "factorisation": [(soft.system.solver, "factorise")],
        }
    return {
        **soft_phases,
        "loads": [(simulation, "_begin_motion")],
        "contact detection": [(simulation._prediction, "find")],
        "compliance": [(constraints, "_build_rows"), (constraints, "_assemble_compliance")],
        "Gauss-Seidel": [(constraints, "_find_impulses")],
        "active set": [(constraints, "solve")],
        "back substitution": [(constraints, "_complete")],
        "impulses and integration": [(constraints, "_velocities_after"), (simulation, "_integrate")],
        "check": [(simulation._divergence_check, "check")],
    }


class _Clock:
    """Exclusive times of nested calls."""

    def __init__(self, phases: list[str]) -> None:
        self._phases = phases
        self._spent: dict[str, list[float]] = {}  # by phase: seconds, and seconds in kernels
        self._running: list[list[float]] = []  # per active call: seconds and kernel seconds of nested calls

    def add_launch(self, seconds: float) -> None:
        """Add the time of a kernel launch [s]."""
        if self._running:
            self._running[-1][1] += seconds

    def watch(self, method: Callable[..., Any], phase: str) -> Callable[..., Any]:
        """Wrap a method so that its time is added to a phase."""

        def timed(*arguments: Any, **named: Any) -> Any:
            nested = [0.0, 0.0]
            self._running.append(nested)
            started = time.perf_counter()
            try:
                return method(*arguments, **named)
            finally:
                elapsed = time.perf_counter() - started
                self._running.pop()
                spent = self._spent.setdefault(phase, [0.0, 0.0])
                spent[0] += elapsed - nested[0]
                spent[1] += nested[1]
                if self._running:
                    self._running[-1][0] += elapsed

        return timed

    def watch_step(self, step: Callable[..., Any], profile: Profile) -> Callable[..., Any]:
        """Wrap a step so that its phases are added to the profile; failed steps are omitted."""
        timed = self.watch(step, REST)

        def profiled_step(*arguments: Any, **named: Any) -> Any:
            self._spent = {phase: [0.0, 0.0] for phase in self._phases}  # including phases that this step skips
            report = timed(*arguments, **named)
            rest = self._spent.pop(REST)
            self._spent |= {REST: rest, TOTAL: np.sum([*self._spent.values(), rest], axis=0).tolist()}
            for phase, (seconds, in_kernels) in self._spent.items():
                profile.seconds.setdefault(phase, []).append(seconds)
                profile.in_python.setdefault(phase, []).append(seconds - in_kernels)
            return report

        return profiled_step
