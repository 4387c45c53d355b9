"""What happened in a step."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from taichisoft.control.observation import Observation, Pair


@dataclass(frozen=True)
class StepReport:
    """What happened in a step; what a controller sees after it is in `observation`.

    Attributes:
        step: index of the step, from 0.
        time: simulated time at the end of the step [s].
        contact_points: middles of the contacts at the start of the step, the open ones too [mm], shape
            (contact_count, 3).
        contact_forces: force on the second body of each contact [mN], shape (contact_count, 3).
        contact_bodies: numbers of the two bodies of each contact in `body_names`, shape (contact_count, 2).
        body_names: names of all bodies in the scene's order: soft bodies, rigid bodies, obstacles.
        max_penetration: deepest intrusion into the contact distance at the start of the step [mm]; surfaces overlap
            when it exceeds that distance.
        iterations: number of sweeps of the Gauss-Seidel.
        residual: largest change of a velocity in the last sweep [mm/s].
        converged: whether the residual is below the tolerance, and `newton_residual` below its own.
        signals: numbers of the controller's own, by name.
        step_time: wall-clock time that the step took [s].
        observe: function that works the observation out.
        deepest: names of the two bodies with that intrusion; None where there is none.
        inverted_elements: number of elements that are turned inside out at the end of the step.
        linearisations: number of linearisations of the soft bodies' equations.
        newton_residual: how far another linearisation would move a node at most [mm]; None where a step has one only
            (`time.newton`), and this is not known.
    """

    step: int
    time: float
    contact_points: np.ndarray
    contact_forces: np.ndarray
    contact_bodies: np.ndarray
    body_names: tuple[str, ...]
    max_penetration: float
    iterations: int
    residual: float
    converged: bool
    signals: Mapping[str, float]
    step_time: float
    observe: Callable[[], Observation] = field(repr=False, compare=False)
    deepest: tuple[str, str] | None = None
    inverted_elements: int = 0
    linearisations: int = 1
    newton_residual: float | None = None

    @property
    def contact_count(self) -> int:
        """Number of contacts, the open ones too."""
        return len(self.contact_points)

    @cached_property
    def contact_pairs(self) -> tuple[Pair, ...]:
        """Names of the two bodies of each contact; its force is on the second one."""
        return tuple((self.body_names[first], self.body_names[second]) for first, second in self.contact_bodies)

    @cached_property
    def observation(self) -> Observation:
        """What a controller sees after the step, worked out when it is first asked for."""
        return self.observe()
