"""Warnings of reduced bodies whose error is not that of their validation: beyond their training, or above tolerance."""

import json
from collections.abc import Iterator

from taichisoft.actuators.kinds import ACTUATOR_KINDS
from taichisoft.bodies.training_range import TrainingRange
from taichisoft.model import Model
from taichisoft.state import State
from taichisoft.step.report import StepReport

EVERY = 20
"""Steps between two checks: each takes half a step, for a product with all modes and for the forces on some nodes."""
MARGIN = 0.05
"""Displacement beyond the trained amplitudes, over the largest trained one, and effort beyond the trained ones, over
their range, up to which nothing is said."""
UNBALANCED = 1.5
"""Imbalance over the largest one of the validation, up to which nothing is said."""


class TrainingWatch:
    """Compares amplitudes with those of the training, and imbalances with those of the validation, at intervals."""

    def __init__(self, model: Model):
        """Prepare; without reduced bodies there is nothing to do."""
        self._model = model
        self._range = TrainingRange(model.soft_bodies, model.frames)
        self._is_reduced = any(body.modes is not None for body in model.soft_bodies)
        self._said: set[tuple[str, str]] = set()

    def complaints_at_start(self) -> Iterator[str]:
        """A line for each reduced body whose validation found more than the tolerance."""
        for body in self._model.soft_bodies:
            modes = body.modes
            if modes is None or modes.error is None or modes.tolerance is None or modes.error <= modes.tolerance:
                continue
            yield (
                f"soft_bodies.{body.name}.reduced: its error of {100 * modes.error:.2g} % is above the tolerance of "
                f"{100 * modes.tolerance:.2g} % that was asked for; try more modes, or a wider training"
            )

    def complaints(self, state: State, report: StepReport) -> Iterator[str]:
        """Lines for each body that is beyond its training, or beyond its validation, for the first time."""
        if state.step % EVERY or not self._is_reduced:
            return
        for name, share in self._range.beyond(state).items():
            if share > MARGIN and self._is_new(name, "training"):
                yield (
                    f"'{name}' moves as it was not trained to at {state.time:.2f} s: {100 * share:.0f} % beyond the "
                    "amplitudes of the training: the validation's error no longer holds; metrics.json has the farthest"
                )
        for name, drive in self._driven_beyond(state):
            if self._is_new(name, "training"):
                yield (
                    f"'{name}' is driven as it was not trained to at {state.time:.2f} s: {drive}: modes do not know "
                    "what that does, and the validation's error no longer holds; `taichisoft reduce --range` trains it"
                )
        for name, (x, y, z) in self._range.pressed_elsewhere(state).items():
            if self._is_new(name, "places"):
                yield (
                    f"'{name}' is pressed at ({x:.1f}, {y:.1f}, {z:.1f}) mm at {state.time:.2f} s, where nothing "
                    "did in its training: modes have no dents there, and the validation says nothing of their error; "
                    "`--reduced-check` runs the full model beside it"
                )
        for name, (times, error) in self._range.beyond_validation(report.imbalance).items():
            if times > UNBALANCED and self._is_new(name, "validation"):
                yield (
                    f"'{name}' is {times:.1f} times as far from the full equations of motion as in its validation at "
                    f"{state.time:.2f} s: its error no longer holds, and is up to some {error:.1g} mm; "
                    "`--reduced-check` runs the full model beside it"
                )

    def _driven_beyond(self, state: State) -> Iterator[tuple[str, str]]:
        """Bodies with an actuator that is driven farther than in the training, and by how much."""
        actuators = self._model.actuators
        for body in self._model.soft_bodies:
            trained = json.loads(body.modes.drives) if body.modes is not None else {}
            for kind in ACTUATOR_KINDS if trained else ():
                found = ((kind.effort, state.actuator_effort), (kind.coordinate, actuators.own_coordinates(state)))
                for drive, values in found:
                    for name, value in zip(actuators.names_of(kind), actuators.of(kind, values).tolist(), strict=True):
                        owner, _, own = name.partition(".")
                        key, low, high = trained.get(own, ("", 0.0, 0.0))
                        away = max(low - value, value - high)
                        if owner == body.name and key == drive.asked and away > MARGIN * (high - low):
                            yield (
                                owner,
                                f"the {drive.words} of '{name}' is {value:.3g} {drive.unit}, trained from {low:.3g} "
                                f"to {high:.3g}",
                            )

    def _is_new(self, name: str, of: str) -> bool:
        new = (name, of) not in self._said
        self._said.add((name, of))
        return new
