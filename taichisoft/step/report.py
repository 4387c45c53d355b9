"""The report of a step."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from taichisoft.control.observation import Observation, Pair


@dataclass(frozen=True)
class StepReport:
    """Results of a step; `observation` has what a controller sees after it.

    Attributes:
        step: index of the step, from 0.
        time: simulated time at the end of the step [s].
        contact_points: midpoints of the contacts where bodies would be after the step without contact, including open
            ones [mm], shape (contact_count, 3). Forces act on a body that turns where these are halfway of its turn.
        contact_forces: force on the second body of each contact [mN], shape (contact_count, 3).
        contact_bodies: numbers of the two bodies of each contact in `body_names`, shape (contact_count, 2).
        body_names: names of all bodies in the scene's order: soft bodies, rigid bodies, obstacles.
        max_penetration: deepest intrusion into the contact distance at the start of the step [mm]; surfaces overlap
            when it exceeds that distance.
        iterations: number of sweeps of the Gauss-Seidel.
        residual: largest change of a velocity in the last sweep [mm/s].
        converged: whether the residual is below the tolerance, and `newton_residual` below its own.
        signals: signals of the controller, by name.
        step_time: wall-clock time that the step took [s].
        observe: function that computes the observation.
        deepest: names of the two bodies with that intrusion, or None.
        inverted_elements: number of inverted elements at the end of the step.
        linearisations: number of linearisations of the soft bodies' equations.
        newton_residual: largest move of a node by another linearisation [mm]; None for steps with one linearisation
            (`time.newton`).
        find_imbalance: function that computes `imbalance`.
        find_stretch: function that computes `stretch_over_law`.
        stiffness, left, unchecked: of a static step, as of `Equilibrium`; else None, and none.
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
    find_imbalance: Callable[[], Mapping[str, float]] = field(default=dict, repr=False, compare=False)
    find_stretch: Callable[[], Mapping[str, float]] = field(default=dict, repr=False, compare=False)
    stiffness: float | None = None
    left: float | None = None
    unchecked: tuple[str, ...] = ()

    @property
    def contact_count(self) -> int:
        """Number of contacts, including open ones."""
        return len(self.contact_points)

    @cached_property
    def contact_pairs(self) -> tuple[Pair, ...]:
        """Names of the two bodies of each contact; its force is on the second one."""
        return tuple((self.body_names[first], self.body_names[second]) for first, second in self.contact_bodies)

    @cached_property
    def observation(self) -> Observation:
        """What a controller sees after the step, through the scene's sensors; its `truth` is without them."""
        return self.observe()

    @cached_property
    def imbalance(self) -> Mapping[str, float]:
        """By reduced body, how far its full equations of motion are from being solved, see `step/imbalance.py` [mm].

        The largest way by which one of a sample of its nodes would give if all others were held; computed on first
        access.
        """
        return self.find_imbalance()

    @cached_property
    def stretch_over_law(self) -> Mapping[str, float]:
        """By soft body, largest stretch of an element over that up to which its law holds [-]; above 1 it is beyond.

        0 for a law without a known range. Computed on first access, which takes about as long as a step without
        contact.
        """
        return self.find_stretch()
