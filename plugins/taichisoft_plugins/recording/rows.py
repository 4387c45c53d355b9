"""The rows of a recording: one frame of the run, as it goes into the datasets."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import TYPE_CHECKING, Any

import numpy as np

from taichisoft_plugins.recording.layout import CONTACT_QUANTITIES, STEP_QUANTITIES, recorded

if TYPE_CHECKING:
    from taichisoft.model import Model
    from taichisoft.state import State
    from taichisoft.step.report import StepReport


@dataclass
class SolverFigures:
    """What happened in the steps since the last frame: the worst, and the time that they took.

    Attributes:
        steps: how many there were.
        iterations, residual, max_penetration: the largest, see `StepReport`.
        converged: whether all were.
        seconds: time of all steps together.
    """

    steps: int = 0
    iterations: int = 0
    residual: float = 0.0
    max_penetration: float = 0.0
    converged: bool = True
    seconds: float = 0.0

    def add(self, report: "StepReport") -> None:
        """Take a step into account."""
        self.steps += 1
        self.iterations = max(self.iterations, report.iterations)
        self.residual = max(self.residual, report.residual)
        self.max_penetration = max(self.max_penetration, report.max_penetration)
        self.converged = self.converged and report.converged
        self.seconds += report.step_time


@dataclass(frozen=True)
class Frame:
    """A state and how it came about; states never change, so nothing is copied.

    Attributes:
        state: at the end of the step.
        report: of the step; None for the state before the first one.
        solver: of the steps since the last frame.
    """

    state: "State"
    report: "StepReport | None"
    solver: SolverFigures


class RowMaker:
    """Makes rows of frames.

    Attributes:
        cavities: names of the columns of `pressure` and `volume`.
        pairs: names of the columns of `normal_force`, `friction_force` and `slip_speed`: all that could ever touch.
    """

    def __init__(self, model: "Model", fields: Sequence[str]):
        """Prepare for a model; `fields` are those that are wanted."""
        self._model = model
        self._names = recorded(STEP_QUANTITIES, fields)
        self._contact_names = recorded(CONTACT_QUANTITIES, fields)
        names = [body.name for body in model.soft_bodies]
        names += [body.name for body in model.rigid_bodies]
        names += [obstacle.name for obstacle in model.obstacles]
        couples = list(combinations_with_replacement(names, 2))
        self.cavities = [cavity.name for body in model.soft_bodies for cavity in body.cavities]
        self.pairs = ["|".join(couple) for couple in couples]
        self._cavity_column = {name: column for column, name in enumerate(self.cavities)}
        # A pair may come with its bodies the other way round.
        self._pair_column = {"|".join(reversed(couple)): column for column, couple in enumerate(couples)}
        self._pair_column |= {name: column for column, name in enumerate(self.pairs)}

    def rows(self, frames: Sequence[Frame], first_contact: int) -> dict[str, np.ndarray]:
        """Of each dataset of `steps`, shape (frame_count, ...); `first_contact` is the first frame's offset."""
        counts = np.array([len(frame.state.contact_body_pair) for frame in frames])
        offsets = {"contact_offset": first_contact + np.cumsum(counts) - counts, "contact_count": counts}
        numbers = [self._numbers(frame) for frame in frames]
        result = {}
        for name, quantity in self._names.items():
            if quantity.of_state:
                result[name] = np.array([getattr(frame.state, quantity.of_state) for frame in frames])
            elif name in offsets:
                result[name] = offsets[name]
            else:
                result[name] = np.array([row[name] for row in numbers])
        return result

    def contacts(self, frames: Sequence[Frame]) -> dict[str, np.ndarray]:
        """The contacts of all frames, by dataset of `contacts`, shape (contact_count, ...)."""
        return {
            name: np.concatenate([getattr(frame.state, quantity.of_state) for frame in frames])
            for name, quantity in self._contact_names.items()
        }

    def _numbers(self, frame: Frame) -> dict[str, Any]:
        """What State does not have."""
        normal, friction, slip = self._forces(frame)
        solver = frame.solver
        return {
            "pressure": self._pressures(frame),
            "normal_force": self._by_pair(normal),
            "friction_force": self._by_pair(friction),
            "slip_speed": self._by_pair(slip),
            "max_penetration": float(solver.max_penetration),
            "iterations": int(solver.iterations),
            "residual": float(solver.residual),
            "converged": bool(solver.converged),
            "step_time": solver.seconds / max(solver.steps, 1),
        }

    def _pressures(self, frame: Frame) -> np.ndarray:
        if frame.report is not None:
            return _columns(frame.report.pressures, self._cavity_column)
        if frame.state.step == 0:  # no pressure is known before the first step
            return np.full(len(self.cavities), np.nan)
        return frame.state.cavity_impulse / self._model.scene.time.step

    def _forces(self, frame: Frame) -> tuple[Mapping[str, float], ...]:
        report = frame.report
        if report is not None:
            return report.normal_forces, report.friction_forces, report.slip_speeds
        if not len(frame.state.contact_body_pair):
            return {}, {}, {}
        from taichisoft.control.contact_summary import (
            summarise_contacts,  # a run that goes on from a state with contacts
        )

        summary = summarise_contacts(self._model, frame.state)
        return summary.normal_forces, summary.friction_forces, summary.slip_speeds

    def _by_pair(self, values: Mapping[str, float]) -> np.ndarray:
        return _columns(values, self._pair_column, len(self.pairs))


def _columns(values: Mapping[str, float], column: Mapping[str, int], count: int | None = None) -> np.ndarray:
    row = np.zeros(len(column) if count is None else count)
    for name, value in values.items():
        row[column[name]] = value
    return row
