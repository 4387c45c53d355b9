"""Figures of a run that are kept up with every step, so that a run of any length takes no more room."""

import math
from collections import Counter, deque
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from taichisoft.mechanics import State
    from taichisoft.step import StepReport

RESOLUTION = 1e-3
"""Medians of times are exact to this share: of how often each was there, to so much, any number takes no room."""


class StepFigures:
    """What the solver had to do in all steps.

    Attributes:
        steps: their number.
        last: report of the last one; None before the first.
    """

    def __init__(self, contact_distance: float, newton_tolerance: float):
        """Begin before the first step.

        Args:
            contact_distance: surfaces overlap where they intrude by more [mm].
            newton_tolerance: largest residual of a step whose linearisations were enough [mm].
        """
        self.steps = self.overlapping = self.unconverged = 0
        self.inverted_elements = self.linearisations = self.unconverged_newton = 0
        self.max_penetration = 0.0
        self.worst_newton_residual: float | None = None
        self._step_times: Counter[int] = Counter()
        self.last: StepReport | None = None
        self._iterations: Counter[int] = Counter()
        self._distance, self._newton_tolerance = contact_distance, newton_tolerance

    def add(self, report: "StepReport") -> None:
        """Include a step."""
        self.steps += 1
        self.last = report
        self.max_penetration = max(self.max_penetration, report.max_penetration)
        self.overlapping += report.max_penetration > self._distance
        self.unconverged += not report.converged
        self.inverted_elements = max(self.inverted_elements, report.inverted_elements)
        self.linearisations = max(self.linearisations, report.linearisations)
        if report.newton_residual is not None:
            worst, residual = self.worst_newton_residual, report.newton_residual
            if worst is None or residual > worst:
                self.worst_newton_residual = residual
            self.unconverged_newton += not residual <= self._newton_tolerance
        self._step_times[round(math.log(report.step_time) / RESOLUTION)] += 1
        self._iterations[report.iterations] += 1

    def metrics(self, time_step: float) -> dict[str, Any]:
        """The figures for metrics.json; those of linearisations where steps have several."""
        if self.last is None:
            return {"steps": 0}
        step_time = math.exp(RESOLUTION * float(np.median(list(self._step_times.elements()))))
        newton = {
            "linearisations_max": self.linearisations,
            "worst_newton_residual_mm": self.worst_newton_residual,
            "unconverged_newton_steps": self.unconverged_newton,
        }
        return {
            "steps": self.steps,
            "simulated_time_s": self.last.time,
            "max_penetration_mm": self.max_penetration,
            "overlapping_steps": self.overlapping,
            "iterations_median": float(np.median(list(self._iterations.elements()))),
            "iterations_max": max(self._iterations),
            "unconverged_steps": self.unconverged,
            **({} if self.worst_newton_residual is None else newton),
            "inverted_elements_max": self.inverted_elements,
            "inverted_elements_at_end": self.last.inverted_elements,
            "step_time_median_ms": 1e3 * step_time,
            "real_time_factor": time_step / step_time,
        }


class LiftFigures:
    """Where an object and the base were before the base moved and in the last steps, and what pressed the object.

    Attributes:
        forces: normal force of each finger in each of the last steps [mN], each of shape (finger_count,).
    """

    def __init__(self, up: np.ndarray, hold_steps: int, push: int | None, base: np.ndarray, position: np.ndarray):
        """Begin before the first step.

        Args:
            up: the direction against gravity, of length 1, shape (3,).
            hold_steps: how many of the last steps are kept.
            push: number of steps made before something pushes the object; None where nothing does.
            base: translation of the base [mm], shape (3,).
            position: place of the object [mm], shape (3,).
        """
        self._up, self._push, self._steps = up, push, 0
        self._highest = float(position @ up)
        self._beside_base = position - base if push == 0 else None
        self._first_base = base
        self._before, self._at_rest = (base, position), True
        self._rest = base, position
        self._now = base, position
        self._slip = self._peak_force = 0.0
        self._positions = deque([position], maxlen=hold_steps + 1)
        self.forces: deque[np.ndarray] = deque(maxlen=hold_steps)
        self._unconverged: deque[bool] = deque(maxlen=hold_steps)

    def add(
        self, base: np.ndarray, position: np.ndarray, slide: np.ndarray, forces: np.ndarray, converged: bool
    ) -> None:
        """Include a step, in which the object slid by `slide` on what holds it [mm], shape (3,)."""
        force = float(forces.sum())
        self._now = base, position
        self._steps += 1
        self._highest = max(self._highest, float(position @ self._up))
        if self._steps == self._push:
            self._beside_base = position - base
        if self._at_rest and np.array_equal(base, self._first_base):
            self._rest = self._now
        elif self._at_rest:
            self._before, self._at_rest = self._rest, False
            self._slip = 0.0
        self._slip -= float(slide @ self._up)
        self._peak_force = max(self._peak_force, force) if self.forces else force
        self._positions.append(position)
        self.forces.append(forces)
        self._unconverged.append(not converged)

    def metrics(self, place: Sequence[float] | None, fingers: Sequence[str]) -> dict[str, Any]:
        """The figures for metrics.json, of forces by finger; of the goal's place [mm] if there is one.

        Lift and slip are counted from the moment before the base moved, or from the start where it did not.
        """
        (base, now), (base_before, before), held = self._now, self._before, np.array(self._positions)
        figures = {
            "object_lift_mm": float((now - before) @ self._up),
            "object_peak_lift_mm": self._highest - float(before @ self._up),
            "base_lift_mm": float((base - base_before) @ self._up),
            "object_slip_mm": self._slip,
            "object_creep_mm": float(np.linalg.norm(held - held[0], axis=1).max()),
            "final_object_position_mm": held[-1].tolist(),
        }
        if place is not None:
            figures["object_distance_mm"] = float(np.linalg.norm(held[-1] - place))
        if self._beside_base is not None:
            figures["object_pushed_away_mm"] = float(np.linalg.norm(now - base - self._beside_base))
        return figures | {
            "unconverged_hold_steps": sum(self._unconverged),
            "peak_normal_force_mN": self._peak_force,
            "mean_normal_force_mN": float(np.sum(self.forces) / len(self.forces)),
            "mean_normal_forces_mN": dict(zip(fingers, np.mean(self.forces, axis=0).tolist(), strict=True)),
        }


# The moment before the base moves, from which lift and slip are counted.


def last_at_rest(base_translation: np.ndarray) -> int | None:
    """Index of the last translation, of shape (count, 3), before the base leaves the first one; None where it stays."""
    moved = np.flatnonzero((base_translation != base_translation[0]).any(axis=1))
    return int(moved[0]) - 1 if len(moved) else None


class Slipping:
    """Follows the rigid bodies of a run, step by step.

    The motion of a held body against its fingers is the tangential velocity between their surfaces, averaged over the
    contacts of soft bodies that press it, each weighted by its normal force. Fingers that bend or lag behind the base
    take the body along, which is not slip. A body that no finger presses moves against the base.
    """

    def __init__(self, soft_count: int, state: "State"):
        """Begin with a state; bodies below `soft_count` are soft, the rigid ones follow."""
        self._soft_count = soft_count
        self._last = state

    def restart(self, state: "State") -> None:
        """Go on from another state."""
        self._last = state

    def add(self, state: "State") -> np.ndarray:
        """Way of each rigid body against what holds it in the step that led to this state [mm], (rigid_count, 3)."""
        last, self._last = self._last, state
        base = state.base_translation - last.base_translation
        ways: np.ndarray = state.rigid_position - last.rigid_position - base
        if not len(state.contact_body_pair):
            return ways
        duration = state.time - last.time
        pressing = np.einsum("cd,cd->c", state.contact_impulse, state.contact_normal)
        soft = state.contact_body_pair < self._soft_count
        for body in range(len(ways)):
            # A contact's slip is that of its second body on its first.
            mine = state.contact_body_pair == self._soft_count + body
            held = pressing * ((mine[:, 1] & soft[:, 0]) | (mine[:, 0] & soft[:, 1]))
            if held.any():
                sign = np.where(mine[:, 1], 1.0, -1.0)
                ways[body] = duration * (held * sign) @ state.contact_slip / held.sum()
        return ways
