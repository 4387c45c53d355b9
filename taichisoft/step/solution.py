"""The problem and the solution of a step, as values, and the report of it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property

import numpy as np

from taichisoft.base.text import brief
from taichisoft.contact.constraint_rows import ActuatorRequests
from taichisoft.contact.detection import ContactTable
from taichisoft.control.figures import Pair
from taichisoft.control.observation import Observation
from taichisoft.mechanics.model_actuators import ActuatorGeometry
from taichisoft.mechanics.state import State

# The report of a step.


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

    def __repr__(self) -> str:
        """Its fields, but for those that are empty, in at most ten lines."""
        return brief("StepReport", {one.name: getattr(self, one.name) for one in fields(self) if one.repr})

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
        """By reduced body, how far its full equations of motion are from being solved, see `step/divergence.py` [mm].

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


# The problem and the solution of a step, as values.


@dataclass(frozen=True)
class StepProblem:
    """Contacts and actuators of a step, which the motion obeys beside the equations of the bodies.

    Attributes:
        start: the state at the start of the step.
        contacts: all contacts of the step.
        geometry: geometry of the actuators at the place of the linearisation.
        requests: requests of the actuators, linearised there.
    """

    start: State
    contacts: ContactTable
    geometry: ActuatorGeometry
    requests: ActuatorRequests


@dataclass(frozen=True)
class StepSolution:
    """Velocities after a step, and the impulses of contacts and actuators.

    Attributes:
        node_velocity: of the soft nodes [mm/s], shape (node_count, 3).
        node_impulse: impulses of contacts and of actuator rows on the soft nodes [mN s], shape (node_count, 3).
        contact_node_impulse: impulses of contacts only on the soft nodes [mN s], shape (node_count, 3).
        rigid_velocity: linear [mm/s] and angular [rad/s], shape (rigid_count, 6).
        rigid_impulse: impulses on the rigid bodies [mN s] and [mN s mm], shape (rigid_count, 6).
        contact_impulse: impulse on the second body of each contact [mN s], with spare capacity, shape (capacity, 3).
        effort: efforts of all actuator coordinates, pressures [kPa] and tensions [mN], shape (coordinate_count,).
        iterations: number of sweeps of the contact solver.
        residual: largest change of a block's own velocity in the last sweep [mm/s, of a volume mm^3/s].
        linearisations: number of linearisations of the soft bodies.
        newton_residual: largest move of a node by another linearisation [mm]; None with a single linearisation.
    """

    node_velocity: np.ndarray
    node_impulse: np.ndarray
    contact_node_impulse: np.ndarray
    rigid_velocity: np.ndarray
    rigid_impulse: np.ndarray
    contact_impulse: np.ndarray
    effort: np.ndarray
    iterations: int = 0
    residual: float = 0.0
    linearisations: int = 1
    newton_residual: float | None = None

    def towards(self, other: "StepSolution", share: float) -> "StepSolution":
        """Interpolate towards another solution by `share`, with the other's iterations and residual."""
        pairs = {name: (getattr(self, name), getattr(other, name)) for name in OF_MOTION}
        return replace(other, **{name: here + share * (there - here) for name, (here, there) in pairs.items()})

    def plus(self, change: "StepSolution", share: float) -> "StepSolution":
        """This solution and a share of a change of it."""
        pairs = {name: (getattr(self, name), getattr(change, name)) for name in OF_MOTION}
        return replace(self, **{name: here + share * more for name, (here, more) in pairs.items()})


OF_MOTION = (
    "node_velocity",
    "node_impulse",
    "contact_node_impulse",
    "rigid_velocity",
    "rigid_impulse",
    "contact_impulse",
    "effort",
)
"""Fields of a solution that are arrays."""


def moving_velocity(theta: float, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """The velocity along which a step moves bodies, (1 - theta) v0 + theta v; v itself in implicit Euler."""
    return after if theta == 1.0 else (1.0 - theta) * before + theta * after


@dataclass(frozen=True)
class Shift:
    """Velocities that separate overlapping bodies in a step, and are discarded afterwards.

    Attributes:
        node_velocity: of the soft nodes [mm/s], shape (node_count, 3).
        rigid_velocity: linear [mm/s] and angular [rad/s], shape (rigid_count, 6).
        iterations, residual: of the contact solver.
    """

    node_velocity: np.ndarray
    rigid_velocity: np.ndarray
    iterations: int
    residual: float
