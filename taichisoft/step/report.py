"""What happened in a step."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class StepReport:
    """What happened in a step.

    Attributes:
        step: index of the step, from 0.
        time: at its end [s].
        pressures: [kPa] by cavity name.
        volumes: [mm^3] by cavity name, at its end.
        normal_forces: sum of the normal contact forces [mN] by pair of bodies ("finger1|cube").
        friction_forces: sum of the magnitudes of the friction forces [mN] by pair of bodies.
        slip_speeds: fastest sliding of a contact that presses [mm/s] by pair of bodies.
        contact_count: contacts, the open ones too.
        contact_points: midpoints at its start, where contacts were found [mm], shape (contact_count, 3).
        contact_forces: on the second body [mN], shape (contact_count, 3).
        max_penetration: how far a point was in the contact distance at its start [mm]; surfaces overlap beyond that.
        iterations: sweeps of the Gauss-Seidel.
        residual: largest change of a velocity in the last sweep [mm/s].
        converged: whether the residual is below the tolerance.
        clipped: what the scene's limits held back: names of cavities, "base_translation" and "base_rotation".
        signals: the controller's own numbers, by name.
        step_time: wall clock [s].
    """

    step: int
    time: float
    pressures: dict[str, float]
    volumes: dict[str, float]
    normal_forces: dict[str, float]
    friction_forces: dict[str, float]
    slip_speeds: dict[str, float]
    contact_count: int
    contact_points: np.ndarray
    contact_forces: np.ndarray
    max_penetration: float
    iterations: int
    residual: float
    converged: bool
    clipped: tuple[str, ...]
    signals: dict[str, float]
    step_time: float
