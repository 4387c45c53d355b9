"""The rows of a recording: what is written about each frame of a run."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import TYPE_CHECKING, Any

import numpy as np

from taichisoft_plugins.recording.layout import QUANTITIES

if TYPE_CHECKING:
    from taichisoft.model import Model
    from taichisoft.state import State
    from taichisoft.step.report import StepReport


@dataclass
class SolverFigures:
    """How the solver fared in all steps since the last frame.

    Attributes:
        steps: Number of these steps.
        iterations, residual, max_penetration: The largest of these steps, see `StepReport`.
        converged: Whether all of them converged.
        seconds: Time of all of them together [s].
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
        state: The state at the end of the step.
        report: The report of the step; None for the state before the first one.
        solver: Figures of the steps since the last frame.
    """

    state: "State"
    report: "StepReport | None"
    solver: SolverFigures


class RowMaker:
    """Makes the rows of frames.

    Attributes:
        cavities: Names of the columns of `pressure` and `volume`.
        pairs: Names of the columns of `normal_force`, `friction_force` and `slip_speed`: all bodies that could touch.
    """

    def __init__(self, model: "Model"):
        self._model = model
        couples = list(combinations_with_replacement(model.body_names, 2))
        self.cavities = list(model.cavities.names)
        self.pairs = ["|".join(couple) for couple in couples]
        self._cavity_column = {name: column for column, name in enumerate(self.cavities)}
        # A pair may come with its bodies the other way round.
        self._pair_column = {"|".join(reversed(couple)): column for column, couple in enumerate(couples)}
        self._pair_column |= {name: column for column, name in enumerate(self.pairs)}

    def rows(self, frames: Sequence[Frame], first_contact: int) -> dict[str, np.ndarray]:
        """The rows of every dataset of `layout.QUANTITIES`, by its path.

        Args:
            frames: The frames; datasets of `steps` get a row for each, shape (frame_count, ...).
            first_contact: Number of contacts that were written before those of these frames.
        """
        numbers = [self._numbers(frame) for frame in frames]
        count = np.array([len(frame.state.contact_key) for frame in frames])
        rows = {"steps/contact_offset": first_contact + np.cumsum(count) - count, "steps/contact_count": count}
        rows |= {path: np.array([row[path] for row in numbers]) for path in numbers[0]}
        for path, quantity in QUANTITIES.items():
            if quantity.state_field:
                values = [getattr(frame.state, quantity.state_field) for frame in frames]
                rows[path] = np.concatenate(values) if path.startswith("contacts") else np.array(values)
        return rows

    def _numbers(self, frame: Frame) -> dict[str, Any]:
        """The quantities that are no part of a state, by the paths of their datasets; not where its contacts stand."""
        normal, friction, slip = self._forces(frame)
        solver = frame.solver
        return {
            "steps/pressure": self._pressures(frame),
            "steps/normal_force": _columns(normal, self._pair_column, len(self.pairs)),
            "steps/friction_force": _columns(friction, self._pair_column, len(self.pairs)),
            "steps/slip_speed": _columns(slip, self._pair_column, len(self.pairs)),
            "steps/max_penetration": float(solver.max_penetration),
            "steps/iterations": int(solver.iterations),
            "steps/residual": float(solver.residual),
            "steps/converged": bool(solver.converged),
            "steps/step_time": solver.seconds / max(solver.steps, 1),
        }

    def _pressures(self, frame: Frame) -> np.ndarray:
        if frame.report is not None:
            return _columns(frame.report.pressures, self._cavity_column, len(self.cavities))
        if frame.state.step == 0:  # no pressure is known before the first step
            return np.full(len(self.cavities), np.nan)
        return frame.state.cavity_impulse / self._model.scene.time.step

    def _forces(self, frame: Frame) -> tuple[Mapping[str, float], ...]:
        report = frame.report
        if report is not None:
            return report.normal_forces, report.friction_forces, report.slip_speeds
        if not len(frame.state.contact_key):
            return {}, {}, {}
        from taichisoft.control.contact_summary import summarise_contacts

        # A run that goes on from a recorded state begins with contacts and without a report.
        summary = summarise_contacts(self._model, frame.state)
        return summary.normal_forces, summary.friction_forces, summary.slip_speeds


def _columns(values: Mapping[str, float], column: Mapping[str, int], count: int) -> np.ndarray:
    """The values in their columns; a name without a value has 0."""
    row = np.zeros(count)
    for name, value in values.items():
        row[column[name]] = value
    return row
