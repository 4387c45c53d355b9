"""The problem and the solution of a step, as values."""

from dataclasses import dataclass, replace

import numpy as np

from taichisoft.actuators.model_actuators import ActuatorGeometry
from taichisoft.contact.contact_table import ContactTable
from taichisoft.solver.actuator_requests import ActuatorRequests
from taichisoft.state import State


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
