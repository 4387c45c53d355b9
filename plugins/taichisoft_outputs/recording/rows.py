"""The rows of a recording: what is written about each frame of a run."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import TYPE_CHECKING

import numpy as np

from taichisoft.actuators import ACTUATOR_KINDS
from taichisoft.caller_warnings import warn_caller
from taichisoft_outputs.recording.layout import CONTROLS, QUANTITIES, SIGNAL_COUNT, group_of

if TYPE_CHECKING:
    from taichisoft.actuators import Actuators
    from taichisoft.control import ContactSummary, Observation, Pair
    from taichisoft.model import Model
    from taichisoft.state import State
    from taichisoft.step import StepReport


@dataclass
class SolverFigures:
    """How the solver fared in all steps since the last frame.

    Attributes:
        steps: number of these steps.
        iterations, residual, max_penetration: the largest of these steps, see `StepReport`.
        converged: whether all of them converged.
        seconds: time of all of them together [s].
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


def controls_of(state: "State", actuators: "Actuators") -> dict[str, np.ndarray]:
    """What a controller acted through in the step to a state, by the paths of `layout.CONTROLS`."""
    return {path: QUANTITIES[path].of(state, actuators) for path in CONTROLS}


@dataclass(frozen=True)
class Frame:
    """A state and how it came about; states never change, so nothing is copied.

    Attributes:
        state: the state at the end of the step.
        report: the report of the step; None for the state before the first one.
        solver: figures of the steps since the last frame.
        slide: way of each rigid body against what holds it since the last frame [mm], shape (rigid_count, 3).
        controller: what the controller remembers after the step, as JSON; empty where it does not save.
        controls: `controls_of` the steps since the last frame, without its own.
    """

    state: "State"
    report: "StepReport | None"
    solver: SolverFigures
    slide: np.ndarray
    controller: str = ""
    controls: Sequence[Mapping[str, np.ndarray]] = ()


class RowMaker:
    """Makes the rows of frames.

    Attributes:
        pairs: bodies of the columns of `normal_force`, `peak_pressure` and the like: all that could touch.
        signals: names of the columns of `signals`, of those that the controller has had by now.
    """

    def __init__(self, model: "Model"):
        self._model = model
        self.pairs = list(combinations_with_replacement(model.body_names, 2))
        self.signals: list[str] = []
        self._left_out: set[str] = set()
        # A pair may come with its bodies the other way round.
        self._pair_column = {(second, first): column for column, (first, second) in enumerate(self.pairs)}
        self._pair_column |= {pair: column for column, pair in enumerate(self.pairs)}

    def rows(self, frame: Frame, has_state: bool) -> dict[str, np.ndarray]:
        """The rows of a frame by the paths of `layout.QUANTITIES`: one of `steps`, any number of the other groups.

        Args:
            frame: the frame.
            has_state: whether a run can go on from it without the steps before.
        """
        contacts, solver, state, actuators = self._contacts(frame), frame.solver, frame.state, self._model.actuators
        coordinates = actuators.own_coordinates(state)
        areas, peaks = self._patches(frame)
        rows = {path: self._of_state(path, frame, has_state) for path in QUANTITIES if QUANTITIES[path].state_field}
        memory = np.frombuffer(frame.controller.encode(), np.uint8)
        figures = {
            "controllers/saved": memory,
            "steps/controller_count": len(memory),
            "steps/state_count": int(has_state),
            "steps/control_count": len(frame.controls),
            "steps/contact_count": len(state.contact_point),
            **{
                f"steps/{kind.coordinate.name}": actuators.of(kind, coordinates)
                for kind in ACTUATOR_KINDS
                if kind.coordinate.observed
            },
            "steps/normal_force": self._by_pair(contacts.normal_forces),
            "steps/friction_force": self._by_pair(contacts.friction_forces),
            "steps/slip_speed": self._by_pair(contacts.slip_speeds),
            "steps/contact_area": self._by_pair(areas),
            "steps/peak_pressure": self._by_pair(peaks),
            "steps/slide": frame.slide,
            "steps/signals": self._signals(frame.report),
            "steps/max_penetration": float(solver.max_penetration),
            "steps/iterations": int(solver.iterations),
            "steps/residual": float(solver.residual),
            "steps/converged": bool(solver.converged),
            "steps/step_time": solver.seconds / max(solver.steps, 1),
        }
        return rows | {path: np.asarray(value) for path, value in figures.items()}

    def _of_state(self, path: str, frame: Frame, has_state: bool) -> np.ndarray:
        values, group = np.asarray(QUANTITIES[path].of(frame.state, self._model.actuators)), group_of(path)
        if group == "controls":
            controls = np.empty((len(frame.controls), *values.shape), values.dtype)
            for row, step in zip(controls, frame.controls, strict=True):
                row[...] = step[path]
            return controls
        if group == "states":
            return values[None][: int(has_state)]
        return values.astype(np.float32) if QUANTITIES[path].single else values

    def _contacts(self, frame: Frame) -> "Observation | ContactSummary":
        if frame.report is not None:
            return frame.report.observation.truth
        from taichisoft.control import summarise_contacts

        # A run that goes on from a recorded state begins with contacts and without a report.
        return summarise_contacts(self._model, frame.state)

    def _patches(self, frame: Frame) -> "tuple[Mapping[Pair, float], Mapping[Pair, float]]":
        """Contact areas and highest pressures by pair."""
        if frame.report is not None:
            seen = frame.report.observation.truth
            return seen.contact_areas, seen.peak_pressures
        from taichisoft.control import ContactPatches

        patches = ContactPatches(self._model).patches(frame.state)
        return {pair: one.area for pair, one in patches.items()}, {pair: one.peak for pair, one in patches.items()}

    def _signals(self, report: "StepReport | None") -> np.ndarray:
        """The controller's signals in their columns; NaN where it has none."""
        row = np.full(SIGNAL_COUNT, np.nan)
        for name, value in (report.signals if report is not None else {}).items():
            if name not in self.signals and len(self.signals) < SIGNAL_COUNT:
                self.signals.append(name)
            if name in self.signals:
                row[self.signals.index(name)] = value
            elif name not in self._left_out:
                self._left_out.add(name)
                warn_caller(
                    f"the recording has room for {SIGNAL_COUNT} signals of the controller; '{name}' is left out"
                )
        return row

    def _by_pair(self, values: "Mapping[Pair, float]") -> np.ndarray:
        """The values in their columns; a pair without a value has 0."""
        row = np.zeros(len(self.pairs))
        for pair, value in values.items():
            row[self._pair_column[pair]] = value
        return row
