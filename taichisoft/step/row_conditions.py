"""What rows of a solved constraint problem do while nothing changes: open, sticking, sliding, held, free, turning."""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sparse

from taichisoft.base.rotations import matrices_from_quaternions, turn_matrices
from taichisoft.contact.constraint_rows import ConstraintRows
from taichisoft.contact.kernels.constraint_problem import GRIP, HIGHEST, LOWER_END, LOWEST, PREFERRED, UPPER_END
from taichisoft.contact.model import Model
from taichisoft.mechanics.kernels.actuator_coordinates import Coordinates, Gradient
from taichisoft.mechanics.kernels.rigid_integration import RigidState
from taichisoft.step.solution import StepProblem, StepSolution

AT_BOUND = 1e-7
"""Distance from a bound, over the bound, at which an impulse is at it [-]: what the solver leaves is round-off."""


@dataclass(frozen=True)
class RowConditions:
    """Linear conditions P dl + Q dv = S of the changes of impulses l and velocities v of all rows.

    Attributes:
        of_impulse, of_velocity: P and Q, shape (row_count, row_count).
        of_bounds: the right-hand sides S of the actuators' rows by the changes of their bounds, (actuator_count, 6).
    """

    of_impulse: np.ndarray
    of_velocity: np.ndarray
    of_bounds: np.ndarray

    def solve(self, free: np.ndarray, compliance: np.ndarray, bounds: np.ndarray) -> np.ndarray:
        """The changes of the impulses, where v = free + W l.

        Args:
            free: change of the velocities without impulses, shape (row_count,).
            compliance: W, shape (row_count, row_count).
            bounds: change of the bounds of the actuators' rows, shape (actuator_count, 6).
        """
        known = -self.of_velocity @ free
        known[len(free) - len(bounds) :] += (self.of_bounds * bounds).sum(axis=1)
        matrix, size = self._scaled(compliance)
        # Impulses between rigid bodies may be undetermined; their motion is not.
        answer: np.ndarray = np.linalg.lstsq(matrix, known / size, rcond=1e-13)[0]
        return answer

    def multipliers(self, of_impulse: np.ndarray, compliance: np.ndarray) -> np.ndarray:
        """The transposed solution: derivatives of a number by the right-hand sides, of those by the impulses."""
        matrix, size = self._scaled(compliance)
        # Rows of known impulses, such as 0 of open contacts, are not coupled, and there are many.
        acts = self.of_velocity.any(axis=1) | (self.of_impulse != np.eye(len(size))).any(axis=1)
        answer, own = of_impulse.copy(), matrix[acts]
        answer[acts] = np.linalg.lstsq(own[:, acts].T, of_impulse[acts], rcond=1e-13)[0]
        answer[~acts] -= own[:, ~acts].T @ answer[acts]
        return answer / size

    def _scaled(self, compliance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        matrix = self.of_impulse + self.of_velocity @ compliance
        size = np.abs(matrix).max(axis=1, initial=1e-300)
        return matrix / size[:, None], size


def find_conditions(
    friction: np.ndarray, bounds: np.ndarray, impulse: np.ndarray, velocity: np.ndarray
) -> RowConditions:
    """The conditions of a solution.

    Args:
        friction: coefficient of each contact, shape (contact_count,).
        bounds: of the actuators' rows, see `contact/kernels/constraint_problem.py`, shape (actuator_count, 6).
        impulse, velocity: of all rows, the contacts' first, shape (row_count,).
    """
    count = len(impulse)
    found = RowConditions(np.zeros((count, count)), np.zeros((count, count)), np.zeros_like(bounds))
    for contact, coefficient in enumerate(friction.tolist()):
        _add_contact(found, slice(3 * contact, 3 * contact + 3), coefficient, impulse, velocity)
    first = 3 * len(friction)
    for actuator in range(len(bounds)):
        _add_actuator(found, first, actuator, bounds, impulse, velocity)
    return found


def _add_contact(found: RowConditions, rows: slice, friction: float, impulse: np.ndarray, velocity: np.ndarray) -> None:
    """A contact: its normal velocity stays 0, and its friction -mu l_n s opposes the sliding along s."""
    p, q = found.of_impulse[rows, rows], found.of_velocity[rows, rows]
    pressing, along = impulse[rows][0], impulse[rows][1:]
    if not pressing > 0.0:  # open
        p[:] = np.eye(3)
        return
    q[0, 0] = 1.0
    most, size = friction * pressing, float(np.linalg.norm(along))
    if most == 0.0:
        p[1:, 1:] = np.eye(2)
    elif size < (1.0 - AT_BOUND) * most:  # sticks
        q[1:, 1:] = np.eye(2)
    else:
        direction = -along / size
        across = np.array([-direction[1], direction[0]])
        p[1, 0], p[1, 1:] = friction, direction
        # Along -mu l_n v / |v| friction turns with the sliding; without a way, nothing moves across it.
        speed = abs(float(velocity[rows][1:] @ direction))
        p[2, 1:], q[2, 1:] = speed * across, most * across


def _add_actuator(
    found: RowConditions, first: int, actuator: int, bounds: np.ndarray, impulse: np.ndarray, velocity: np.ndarray
) -> None:
    """An actuator: its impulse stays at the bound where it is, else its coordinate at the end where it is."""
    row, own = first + actuator, bounds[actuator]
    here, speed = float(impulse[row]), float(velocity[row])
    if own[GRIP] >= 0.0:
        tensions = np.zeros(len(impulse))  # whose product with the impulses is the tension before the point
        above = actuator - 1
        while bounds[above, GRIP] >= 0.0:
            tensions[first + above] = -1.0
            above -= 1
        tensions[first + above] = 1.0
        tension, grip = float(tensions @ impulse), float(own[GRIP])
        shares = -grip, grip / (1.0 + grip)  # of the tension's amount
        slopes = -1.0, 1.0 / (1.0 + grip) ** 2
        side = int(here > 0.0)
        if _reaches(-abs(here), -abs(tension * shares[side])):
            found.of_impulse[row] = -shares[side] * np.sign(tension) * tensions
            found.of_impulse[row, row] += 1.0
            found.of_bounds[actuator, GRIP] = slopes[side] * abs(tension)
        else:
            found.of_velocity[row, row] = 1.0
        return
    imposed = own[LOWER_END] == own[UPPER_END]
    for bound, holds in (
        (LOWEST, _reaches(here, own[LOWEST])),
        (HIGHEST, _reaches(-here, -own[HIGHEST])),
        (PREFERRED, not imposed and np.isclose(here, own[PREFERRED], AT_BOUND, 0.0)),
    ):
        if holds:
            found.of_impulse[row, row] = found.of_bounds[actuator, bound] = 1.0
            return
    nearest = abs(speed - own[LOWER_END]) <= abs(speed - own[UPPER_END])
    found.of_velocity[row, row] = found.of_bounds[actuator, LOWER_END if nearest else UPPER_END] = 1.0


def _reaches(value: float, lowest: float) -> bool:
    return value <= lowest + AT_BOUND * min(abs(lowest), abs(value))


def find_jacobians(
    problem: ConstraintRows, coordinates: Coordinates, gradient: Gradient, node_count: int, rigid_count: int
) -> tuple[sparse.csr_array, np.ndarray]:
    """Derivatives of all rows' velocities by those of the nodes and of the rigid bodies.

    Returns:
        Matrices of shape (row_count, 3 node_count), sparse, and (row_count, 6 rigid_count).
    """
    rows, contacts = problem.rows, problem.contact_count
    of_rigid = np.zeros((problem.row_count, rigid_count, 6))
    contact, slot = np.nonzero(rows.node[:contacts] >= 0)
    node, weight = rows.node[contact, slot], rows.weight[contact, slot]
    entries = (weight[:, None, None] * rows.basis[contact]).ravel()
    places = (3 * contact[:, None, None] + np.arange(3)[:, None] + np.zeros(3, dtype=int)).ravel()
    columns = (3 * node[:, None, None] + np.zeros((3, 1), dtype=int) + np.arange(3)).ravel()
    for index, side in zip(*np.nonzero(rows.rigid[:contacts] >= 0), strict=True):
        own = slice(3 * index, 3 * index + 3)
        of_rigid[own, rows.rigid[index, side]] += rows.rigid_jacobian[own, side]
    actuators, some, several = problem.actuators, [entries], [(places, columns)]
    for row, coordinate in enumerate(rows.coordinate[: actuators.stop - actuators.start].tolist(), actuators.start):
        own = slice(*coordinates.entry_start[coordinate : coordinate + 2].tolist())
        some.append(gradient.soft[own].ravel())
        columns = (3 * coordinates.entry_node[own][:, None] + np.arange(3)).ravel()
        several.append((np.full(len(columns), row), columns))
        own = slice(*coordinates.rigid_start[coordinate : coordinate + 2].tolist())
        np.add.at(of_rigid[row], coordinates.rigid_body[own], gradient.rigid[own])
    place = tuple(np.concatenate(axis) for axis in zip(*several, strict=True))
    shape = problem.row_count, 3 * node_count
    of_soft = sparse.csr_array(sparse.coo_array((np.concatenate(some), place), shape))
    return of_soft, of_rigid.reshape(problem.row_count, 6 * rigid_count)


# Rows of contacts on bodies that turn in a step, which the solver has renewed until they lead where the bodies go.
#
# Such a row has the mean m(w) of its arm r along the step, `contact/kernels/separation.py`, and so the displacement
# h (v + w x m(w)) of a point is that on its arc. With the turn R = exp(h w) and its mean J that changes by
# h (J dw) x R r, and the torque m(w) x l of an impulse l by dm/dw dw x l, beside what the row tells.

RENEWED = 1e-6
"""Least difference of an arm from that of the measurement [mm]."""
TURN = 1e-5
"""Half width of differences by turns [rad]."""


@dataclass(frozen=True)
class TurningRows:
    """What the turning of bodies in a step adds to the rows of its contacts.

    Attributes:
        renewed: whether the row of a contact is one of those, on either side, shape (contact_count, 2).
        arm: arms at the start of the step [mm], shape (contact_count, 2, 3).
        mean: mean turn of the arms, shape (contact_count, 2, 3, 3).
        of_rigid: derivatives of the rows' velocities by those of the rigid bodies, beside the rows' own, shape
            (3 contact_count, rigid_count, 6).
        torque: derivatives of the bodies' angular impulses by their angular velocities, (rigid_count, 3, 3).
    """

    renewed: np.ndarray
    arm: np.ndarray
    mean: np.ndarray
    of_rigid: np.ndarray
    torque: np.ndarray


def find_turning_rows(
    model: Model,
    problem: StepProblem,
    solution: StepSolution,
    contacts: np.ndarray,
    basis: np.ndarray,
    rigid: RigidState,
) -> TurningRows:
    """Find the rows of contacts, by their numbers, that were renewed; the rigid bodies are as at the start."""
    h, found, separation = model.scene.time.step, problem.contacts.found, problem.contacts.separation
    count, bodies = len(rigid.position), found.bodies[contacts] - len(model.soft_bodies)
    is_rigid = (bodies >= 0) & (bodies < count)
    of_rigid, torque = np.zeros((3 * len(contacts), count, 6)), np.zeros((count, 3, 3))
    shape = (*bodies.shape, 3)
    arms, means = np.zeros(shape), np.broadcast_to(np.eye(3), (*shape, 3)).copy()
    renewed = np.zeros_like(is_rigid)
    turns = matrices_from_quaternions(problem.start.rigid_rotation)
    some, passed = np.where(is_rigid, bodies, 0), h * problem.contacts.fraction[contacts, None, None]
    if not count or not len(contacts):
        return TurningRows(renewed, arms, means, of_rigid, torque)
    straight = found.points[contacts] - rigid.position[some] - passed * rigid.linear[some]
    half = (turn_matrices(-0.5 * passed * rigid.angular[some]) @ straight[..., None])[..., 0]
    off = np.minimum(*(np.abs(separation.arm[contacts] - one).max(axis=2) for one in (straight, half)))
    renewed = is_rigid & (off > RENEWED)
    for row, side in np.argwhere(renewed).tolist():
        contact, body, sign = contacts[row], bodies[row, side], 2.0 * side - 1.0
        way = h * solution.rigid_velocity[body, 3:]
        local = found.weights[contact, side] @ model.surfaces.carriers.local[found.vertices[contact, side]]
        arms[row, side] = start = turns[body] @ local
        means[row, side] = mean = turn_matrices(way, mean=True)
        end, own = turn_matrices(way) @ start, slice(3 * row, 3 * row + 3)
        of_rigid[own, body, 3:] = sign * (
            np.cross(end, basis[row]) @ mean - np.cross(separation.arm[contact, side], basis[row])
        )
        pushed, sides = solution.contact_impulse[contact], TURN * np.eye(3)
        change = (
            (turn_matrices(way + sides, mean=True) - turn_matrices(way - sides, mean=True)) @ start * h / (2.0 * TURN)
        )
        torque[body] += sign * np.cross(change, pushed).T
    return TurningRows(renewed, arms, means, of_rigid, torque)
