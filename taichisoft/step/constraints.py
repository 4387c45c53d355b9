"""The constraint problem of a step: contacts and actuators, solved together."""

from typing import NamedTuple

import numpy as np

from taichisoft.bodies.actuators import ActuatorGeometry
from taichisoft.cholesky.kernels.sparse_columns import GROUP
from taichisoft.contact.kernels.contact_reduction import TAKING_PART
from taichisoft.contact.kernels.contacts import Contacts
from taichisoft.interruption import stop_if_asked
from taichisoft.model import Model
from taichisoft.solver.actuator_rows import ActuatorRows
from taichisoft.solver.constraint_rows import GROWTH, ConstraintRows
from taichisoft.solver.contact_solver import load_stages
from taichisoft.solver.impacts import Impacts
from taichisoft.solver.kernels import moment_rows, row_velocities
from taichisoft.solver.kernels.row_velocities import MOMENTS, PairLaws
from taichisoft.solver.kernels.told_contacts import ToldContacts, tell
from taichisoft.state import State
from taichisoft.step.active_set import ActiveSet
from taichisoft.step.compliance import assemble_compliance
from taichisoft.step.contact_prediction import Found
from taichisoft.step.rigid_motion import RigidMotion
from taichisoft.step.soft_motion import SoftMotion

FIRST_CAPACITY = 16
NO_IMPULSE = np.zeros(0)


class Motion(NamedTuple):
    """Velocities of the soft nodes after a step, and impulses that lead to them; a mean of two is one as well.

    Attributes:
        node_velocity: [mm/s], shape (node_count, 3).
        node_impulse: of contacts alone on the soft nodes [mN s], shape (node_count, 3).
        contact_impulse: on the second body of each contact [mN s], in arrays with room for more, shape (capacity, 3).
        effort: of all coordinates of actuators, pressures [kPa] and tensions [mN], shape (coordinate_count,).
        rigid_impulse: on the rigid bodies [mN s] and [mN s mm], shape (rigid_count, 6).
    """

    node_velocity: np.ndarray
    node_impulse: np.ndarray
    contact_impulse: np.ndarray
    effort: np.ndarray
    rigid_impulse: np.ndarray

    def towards(self, other: "Motion", share: float) -> "Motion":
        """This share of the way from this motion to another."""
        return Motion(*(a + share * (b - a) for a, b in zip(self, other, strict=True)))


class Constraints:
    """Finds impulses such that velocities after the step obey contact, friction and actuators.

    With v the velocity of each row after the step, v = free + W impulse. A contact has three rows: normal (velocity
    plus gap / h, at least 0), and two tangents. An actuator that is no known load has one: the rate of its coordinate
    less the rate that reaches its target at the end of the step. Where rigid bodies resist spinning and rolling, a
    contact has three more, of moments.

    Attributes:
        node_velocity: of the soft nodes after the step [mm/s], shape (node_count, 3).
        row_impulse: of the actuators with rows [mN s, of a volume kPa s], shape (row_count,).
        told: the contacts that took part, and the closest one of bodies near each other without any.
        cavity_pressure: imposed or found [kPa], shape (cavity_count,).
        cable_tension: at the pulled end, imposed or found [mN], shape (cable_count,).
        cable_tension_loss: at the inner points of cables with friction [mN], shape (rubbing_point_count,).
        node_shift: of the soft nodes out of overlaps, over the time step [mm/s], shape (node_count, 3); None where
            nothing overlaps. That of the rigid bodies is with their motion.
        penetration: by how much less than the contact distance surfaces were apart at the start of the step [mm].
        deepest: numbers of the two bodies that were; empty where none were.
        iterations: sweeps of the Gauss-Seidel.
        residual: largest change of a block's own velocity in the last sweep [mm/s, of a volume mm^3/s].
    """

    def __init__(
        self,
        model: Model,
        soft: SoftMotion | None,
        rigid: RigidMotion,
        geometry: ActuatorGeometry,
        actuators: ActuatorRows,
    ):
        """Make the work space.

        Args:
            model: the bodies.
            soft: the soft bodies of a step, None without any.
            rigid: the rigid bodies of a step; they get the impulses that are found.
            geometry: of the actuators at the start of a step.
            actuators: what they ask of the step.
        """
        self._model, self._soft, self._rigid = model, soft, rigid
        self._geometry, self._actuators = geometry, actuators
        self._time_step = model.scene.time.step
        self._active_set = ActiveSet(model, rigid.state)
        self._gives_back = bool(model.restitution.any())
        self._impacts = Impacts(model.scene.contact.tolerance, model.scene.contact.max_iterations)
        self._node_velocity_before = np.zeros((model.node_count, 3))
        if model.surfaces.may_touch.any():
            load_stages()
        self._removes_depth = model.scene.contact.depth == "position"
        self._problem = ConstraintRows(model, FIRST_CAPACITY)
        self._laws = PairLaws(model.friction.copy(), model.spinning_friction, model.rolling_friction)
        self.told = ToldContacts.with_room(0, len(model.body_names))
        self._velocity = np.zeros((model.node_count, 3))  # stays in place for the kernels
        self._node_impulse = np.zeros((model.node_count, 3))
        self.node_velocity = np.zeros((model.node_count, 3))

    def take_friction(self, model: Model) -> None:
        """Let pairs of bodies have the friction coefficients of a variant of the model."""
        self._laws.friction[:] = model.friction

    def solve(self, state: State, found: Found) -> None:
        """Find the impulses, and the velocities of all bodies with them.

        Contacts that are expected to stay open are left out at first, see `active_set`.

        Args:
            state: at the start of the step.
            found: the contacts of the step.
        """
        count = int(found.contacts.count[0])
        self._has_any = bool(count or len(self._actuators.coordinates))
        self.iterations, self.residual, self.penetration = 0, 0.0, 0.0
        self.deepest: tuple[int, ...] = ()
        self.node_shift: np.ndarray | None = None
        self.told.count[0] = 0
        self._row_count, self.row_impulse = 0, NO_IMPULSE
        if not self._has_any:
            self._rigid.apply_impulses()
            self.node_velocity = self._complete()
            return
        self._velocity[:] = state.velocity
        if self._gives_back:
            self._node_velocity_before[:] = state.velocity
            self._rigid_before = np.hstack([state.rigid_velocity, state.rigid_angular_velocity])
        self._active_set.begin(found, state, self._velocity)
        self.penetration, self.deepest = self._active_set.depth, self._active_set.deepest
        self._find_motion(found)

    def solve_again(self, found: Found) -> None:
        """The same contacts and actuators with soft bodies that were linearised anew, from the impulses last found."""
        if self._has_any:
            self._find_motion(found)
        else:
            self.node_velocity = self._complete()

    @property
    def node_impulse(self) -> np.ndarray:
        """That of contacts and actuators with rows on the soft nodes [mN s], shape (node_count, 3)."""
        acts = self._has_any and self._row_count
        return self._node_impulse if acts else np.zeros_like(self._node_impulse)

    @property
    def motion(self) -> Motion:
        """The motion last found, before the actuators' geometry changes."""
        coordinates, own = self._model.actuators.coordinates, np.zeros(self._model.actuators.count)
        own[self._actuators.coordinates] = self.row_impulse
        of_entries = np.repeat(own, np.diff(coordinates.entry_start))[:, None] * self._geometry.gradient.soft
        node_impulse = self.node_impulse.copy()
        np.subtract.at(node_impulse, coordinates.entry_node, of_entries)
        effort = self._actuators.load.copy()
        effort[self._actuators.coordinates] = self.row_impulse / self._time_step
        on_contacts, on_rigid = self._active_set.impulse.copy(), self._rigid.state.impulse.copy()
        return Motion(self.node_velocity, node_impulse, on_contacts, effort, on_rigid)

    def take(self, motion: Motion) -> None:
        """Let this be the motion found."""
        self.node_velocity = motion.node_velocity
        self._velocity[:] = motion.node_velocity
        self._active_set.impulse[:] = motion.contact_impulse
        self.row_impulse = motion.effort[self._actuators.coordinates] * self._time_step
        self._rigid.state.impulse[:] = motion.rigid_impulse
        self._rigid.apply_impulses()

    def end(self, found: Found) -> None:
        """What the impulses found mean; and what overlaps is moved apart."""
        self.cavity_pressure, self.cable_tension, self.cable_tension_loss = self._actuators.efforts(self.row_impulse)
        if not self._has_any:
            return
        self._tell(found.contacts)
        if self._removes_depth and self._active_set.add_deep():
            self._remove_depth(found.contacts)

    def _find_motion(self, found: Found) -> None:
        while True:
            stop_if_asked()
            self._build_rows(found.contacts)
            self._assemble_compliance()
            strike = self._strike() if self._gives_back and self._contact_count else None
            self._find_impulses(strike)
            self._apply_impulses()
            self._velocity[:] = self.node_velocity
            if not self._active_set.add_violated(self._velocity):
                break

    def _remove_depth(self, contacts: Contacts) -> None:
        """Move what overlaps apart, by velocities of this step alone, which nothing keeps (split impulses).

        The same compliance, without friction and actuators: u_n >= -gap / h, where the gap is that at the end of the
        step (Cline and Pai 2003, Post-stabilization for rigid body simulation with contact and constraints).
        """
        rigid, settings = self._rigid, self._model.scene.contact
        moving = rigid.state.linear.copy(), rigid.state.angular.copy()
        rigid.state.free[:] = 0.0
        if self._soft is not None:
            self._soft.leave_out_forces()
        while True:
            stop_if_asked()
            self._build_rows(contacts, with_actuators=False)
            rows, count = self._problem.rows, self._contact_count
            self._assemble_compliance()
            rows.friction[:count], rows.moment_length[:] = 0.0, 0.0
            rows.free[: 3 * count] = 0.0
            rows.free[: 3 * count : 3] = self._active_set.gap[rows.contact[:count]] / self._time_step
            solver = self._problem.solver
            solver.impulse[: self._row_count] = 0.0
            solver.solve(settings.tolerance, settings.max_iterations)
            self.iterations += solver.iterations
            self.residual = max(self.residual, solver.residual)
            self._apply_row_impulses()
            rigid.apply_impulses()
            self._velocity[:] = self._complete()
            if not self._active_set.add_left_deep(self._velocity):
                break
        self.node_shift = self._velocity.copy()
        rigid.begin_shift(*moving)

    def _build_rows(self, contacts: Contacts, with_actuators: bool = True) -> None:
        """What the rows of the chosen contacts and of the actuators act on."""
        self._contact_count = count = int(self._active_set.choice.count[TAKING_PART])
        if count > self._problem.contact_capacity:
            self._problem.release()
            self._problem = ConstraintRows(self._model, int(GROWTH * count))
        rows, actuators = self._problem.rows, self._actuators
        actuator_count = len(actuators.coordinates) if with_actuators else 0
        rows.size[:] = count, actuator_count, 0
        if actuator_count:
            rows.coordinate[:actuator_count] = actuators.coordinates
            rows.target_rate[:actuator_count] = actuators.target_rate
            self._problem.bounds[:actuator_count] = actuators.bounds
        if count:
            row_velocities.build_rows(
                len(self._model.soft_bodies),
                contacts,
                self._active_set.choice,
                self._active_set.separation,
                self._model.surfaces.carriers,
                self._laws,
                self._rigid.state,
                self._active_set.impulse,
                rows,
                self._problem.solver.impulse,
            )
        self._moment_count = int(rows.size[MOMENTS])
        self._row_count = 3 * count + actuator_count + 3 * self._moment_count

    def _assemble_compliance(self) -> None:
        coordinates, gradient = self._model.actuators.coordinates, self._geometry.gradient
        stretch = self._actuators.stretch
        assemble_compliance(self._problem, coordinates, gradient, stretch, self._soft, self._rigid.state)

    def _strike(self) -> np.ndarray | None:
        """Impulses of impacts with restitution, which the contacts start from; None without any."""
        count = self._contact_count
        bodies = self._active_set.contacts.bodies[self._problem.rows.contact[:count]]
        restitution = self._model.restitution[tuple(bodies.T)]
        if not restitution.any():
            return None
        rows, rigid, end = self._problem.rows, self._rigid.state, 3 * count
        free, free_motion = rows.free[:end].copy(), rigid.free.copy()
        rigid.free[:] = self._rigid_before
        row_velocities.free_contact_velocity(rows, self._node_velocity_before, rigid)
        before = rows.free[:end].copy()
        before[::3] -= rows.gap_rate[:count]
        rigid.free[:], rows.free[:end] = free_motion, free
        compliance = self._problem.compliance[: self._row_count**2].reshape(self._row_count, self._row_count)
        pair = bodies[:, 0] * len(self._model.body_names) + bodies[:, 1]
        slowest = self._active_set.resting_speed
        touching = self._model.surfaces.gap_tolerance[tuple(bodies.T)] / self._time_step
        strike = self._impacts.find(
            compliance[:end, :end], before, free, touching, pair, restitution, rows.friction[:count], slowest
        )
        rows.free[: self._row_count] += compliance[:, :end] @ strike
        return strike

    def _find_impulses(self, strike: np.ndarray | None) -> None:
        """Gauss-Seidel, from the impulses of the last step, or those found before more contacts took part."""
        solver, rows, contact_count = self._problem.solver, self._problem.rows, self._contact_count
        if not self._row_count:
            self.residual = 0.0
            return
        first_moment = self._row_count - 3 * self._moment_count
        if first_moment > 3 * contact_count:
            solver.impulse[3 * contact_count : first_moment] = self._actuators.first_impulse
        if self._moment_count:
            solver.impulse[first_moment : self._row_count] = 0.0
        settings = self._model.scene.contact
        solver.solve(settings.tolerance, settings.max_iterations)
        # Soft bodies give under each of their contacts, and so determine it.
        on_rigid = int(rows.on_rigid_count[0]) if contact_count else 0
        solver.choose_smallest(rows.on_rigid[:on_rigid], settings.tolerance)
        if strike is not None:
            solver.impulse[: len(strike)] += strike
        self.row_impulse = solver.impulse[3 * contact_count : first_moment].copy()
        self.iterations += solver.iterations
        self.residual = solver.residual

    def _apply_impulses(self) -> None:
        """Velocities after the impulses: of the rigid bodies, and of the soft nodes."""
        if self._row_count:
            self._apply_row_impulses()
        self._rigid.apply_impulses()
        self.node_velocity = self._complete()

    def _complete(self) -> np.ndarray:
        """Velocities of the soft nodes after the impulses found; of few rows L^-1 J^T is known already."""
        if self._soft is None:
            return self._velocity.copy()
        columns, solver, impulse = self._problem.columns, self._soft.system.solver, self._problem.solver.impulse
        if self._row_count and GROUP * int(columns.size[0]) > solver.symbolic.factor_entries:
            change = solver.complete_with(self._node_impulse)
        else:
            change = solver.complete(columns, impulse, self._row_count)
        return change + self._soft.known_velocity

    def _apply_row_impulses(self) -> None:
        problem = self._problem
        row_velocities.apply_impulses(
            problem.rows,
            self._model.actuators.coordinates,
            self._geometry.gradient,
            problem.solver.impulse,
            self._active_set.impulse,
            self._node_impulse,
            self._rigid.state,
        )
        if self._moment_count:
            moment_rows.apply_moments(problem.rows, problem.solver.impulse, self._rigid.state)

    def _tell(self, contacts: Contacts) -> None:
        """Keep what is worth telling of the contacts."""
        if not contacts.count[0]:
            return
        if len(contacts.distance) > len(self.told.slip):
            self.told = ToldContacts.with_room(len(contacts.distance), len(self._model.body_names))
        tell(
            self._model.scene.contact.alarm_distance,
            contacts,
            self._active_set.choice,
            self._active_set.impulse,
            self._problem.solver.answer,
            self.told,
        )
