"""The time step: implicit Euler, contact and cavities solved together."""

import time
from dataclasses import dataclass, replace

import numpy as np

from taichisoft.constraints import ConstraintProblem
from taichisoft.control_input import apply_control
from taichisoft.controller import Control, Observation
from taichisoft.detection import ContactPairs, pair_key, spread_out
from taichisoft.divergence import check_state
from taichisoft.errors import NotPositiveDefinite, SimulationDiverged
from taichisoft.model import Model
from taichisoft.placement import matrices_from_quaternions, rotate_quaternions, rotation_from_vector
from taichisoft.rigid_motion import inverse_mass_matrices, velocity_without_contact
from taichisoft.scene import Scene
from taichisoft.state import State


@dataclass(frozen=True)
class StepReport:
    """What happened in a step.

    Attributes:
        step: index of the step, from 0.
        time: at its end [s].
        pressures: [kPa] by cavity name.
        volumes: [mm^3] by cavity name, at the start of the step.
        normal_forces: sum of the normal contact forces [mN] by pair of bodies ("finger1|cube").
        friction_forces: sum of the magnitudes of the friction forces [mN] by pair of bodies.
        contact_count: contacts in the constraint problem.
        contact_points: midpoints [mm], shape (contact_count, 3).
        contact_forces: on the second body [mN], shape (contact_count, 3).
        max_penetration: how far a point went into the contact distance [mm]; surfaces overlap beyond that distance.
        iterations: sweeps of the Gauss-Seidel.
        residual: largest change of a velocity in the last sweep [mm/s].
        converged: whether the residual is below the tolerance.
        step_time: wall clock [s].
    """

    step: int
    time: float
    pressures: dict[str, float]
    volumes: dict[str, float]
    normal_forces: dict[str, float]
    friction_forces: dict[str, float]
    contact_count: int
    contact_points: np.ndarray
    contact_forces: np.ndarray
    max_penetration: float
    iterations: int
    residual: float
    converged: bool
    step_time: float


class Simulation:
    """A model and its state.

    Attributes:
        model: what does not change.
        state: replaced by every step; see `restore`.
        report: of the last step, None before the first.
    """

    def __init__(self, scene: Scene | Model):
        """Start from a scene, or from a model already made."""
        self.model = scene if isinstance(scene, Model) else Model(scene)
        self.state = State.at_start(self.model)
        self.report: StepReport | None = None

    def restore(self, state: State) -> None:
        """Go on from a state of this model, an earlier one or one read from a file.

        Raises:
            StateError: it belongs to another model.
        """
        state.check_fits(self.model)
        self.state = state

    def step(self, control: Control | None = None) -> StepReport:
        """Advance by one time step.

        Raises:
            ControlError: `control` asks for something impossible; nothing has changed.
            SimulationDiverged: the step failed; `state` is the last good one.
        """
        started = time.perf_counter()
        state = apply_control(self.model, self.state, control or Control())
        node_velocity = self._soft_velocity_without_contact(state)
        rigid_velocity = velocity_without_contact(self.model, state)
        volumes = self.model.cavities.update(state.position)
        candidates = self._find_contacts(state)
        spacing, soft_count = self.model.scene.contact.spacing, len(self.model.soft_bodies)
        contacts = spread_out(candidates, spacing, soft_count, state.contact_key, state.contact_point)
        problem = ConstraintProblem(self.model, state, contacts, volumes)
        problem.measure(node_velocity, rigid_velocity, inverse_mass_matrices(self.model, state))
        problem.solve()
        next_state = self._apply_impulses(state, problem, node_velocity, rigid_velocity)
        check_state(self.model, state, next_state)
        self.state = next_state
        self.report = self._make_report(problem, candidates, volumes, time.perf_counter() - started)
        return self.report

    def observe(self) -> Observation:
        """What a controller sees."""
        names, report = self.model.cavities.names, self.report
        rest = dict(zip(names, self.model.cavities.rest_volume.tolist(), strict=True))
        positions = self.state.rigid_position.copy()
        positions.flags.writeable = False
        return Observation(
            time=self.state.time,
            step=self.state.step,
            pressures=report.pressures if report else dict.fromkeys(names, 0.0),
            volumes=report.volumes if report else rest,
            object_positions={body.name: positions[i] for i, body in enumerate(self.model.rigid_bodies)},
            normal_forces=report.normal_forces if report else {},
        )

    def _soft_velocity_without_contact(self, state: State) -> np.ndarray:
        """Implicit Euler with the rotations of the start of the step: v + A^-1 h (f + M g - a M v - (h + b) K v)."""
        elasticity = self.model.elasticity
        if elasticity is None:
            return state.velocity
        momentum = elasticity.node_mass[:, None] * (
            self.model.gravity - elasticity.node_rayleigh_mass[:, None] * state.velocity
        )
        stretch = state.position - self._anchor_targets(state) + elasticity.node_lag[:, None] * state.velocity
        anchor = -elasticity.anchor_stiffness[:, None] * stretch
        force = elasticity.assemble(state.position, state.velocity) + anchor + momentum
        try:
            elasticity.solver.factorise()
        except NotPositiveDefinite as error:
            body = self.model.body_of_node(error.node)
            raise SimulationDiverged(body, state.step, str(error), "a smaller time step") from error
        return state.velocity + elasticity.solver.solve(self.model.scene.time.step * force)

    def _anchor_targets(self, state: State) -> np.ndarray:
        """Rest positions moved with the base."""
        pivot = self.model.base_pivot
        turned = (self.model.rest_position - pivot) @ rotation_from_vector(state.base_rotation).T
        return turned + pivot + state.base_translation

    def _find_contacts(self, state: State) -> ContactPairs:
        if self.model.detection.is_needed:
            rotation = matrices_from_quaternions(state.rigid_rotation)
            self.model.surfaces.update(state.position, state.rigid_position, rotation)
        alarm = self.model.scene.contact.alarm_distance
        return self.model.detection.find(reach=alarm, depth=alarm)

    def _apply_impulses(
        self, state: State, problem: ConstraintProblem, node_velocity: np.ndarray, rigid_velocity: np.ndarray
    ) -> State:
        time_step = self.model.scene.time.step
        if self.model.elasticity is not None and problem.row_count:
            node_velocity = node_velocity + self.model.elasticity.solver.solve(problem.node_impulse())
        inverse_mass = inverse_mass_matrices(self.model, state)
        rigid_velocity = rigid_velocity + np.einsum("bij,bj->bi", inverse_mass, problem.rigid_impulse())
        linear, angular = rigid_velocity[:, :3], rigid_velocity[:, 3:]
        return replace(
            state,
            time=(state.step + 1) * time_step,
            step=state.step + 1,
            position=state.position + time_step * node_velocity,
            velocity=node_velocity,
            rigid_position=state.rigid_position + time_step * linear,
            rigid_rotation=rotate_quaternions(state.rigid_rotation, time_step * angular),
            rigid_velocity=linear,
            rigid_angular_velocity=angular,
            cavity_impulse=problem.impulse[3 * problem.contacts.count :],
            contact_key=pair_key(problem.contacts.bodies),
            contact_point=problem.contacts.points.mean(axis=1),
            contact_impulse=problem.contact_impulse,
        )

    def _make_report(
        self, problem: ConstraintProblem, candidates: ContactPairs, volumes: np.ndarray, step_time: float
    ) -> StepReport:
        contact, names = self.model.scene.contact, self.model.cavities.names
        time_step = self.model.scene.time.step
        forces = problem.contact_impulse / time_step
        pressures = self.state.cavity_impulse / time_step
        normal, friction = _forces_by_pair(self.model, problem.contacts, forces)
        nearest = candidates.distance.min() if candidates.count else np.inf
        return StepReport(
            step=self.state.step - 1,
            time=self.state.time,
            pressures=dict(zip(names, pressures.tolist(), strict=True)),
            volumes=dict(zip(names, volumes.tolist(), strict=True)),
            normal_forces=normal,
            friction_forces=friction,
            contact_count=problem.contacts.count,
            contact_points=self.state.contact_point,
            contact_forces=forces,
            max_penetration=float(max(0.0, contact.contact_distance - nearest)),
            iterations=problem.iterations,
            residual=problem.residual,
            converged=problem.residual < contact.tolerance,
            step_time=step_time,
        )


def _forces_by_pair(
    model: Model, contacts: ContactPairs, forces: np.ndarray
) -> tuple[dict[str, float], dict[str, float]]:
    """Sums of the normal and of the friction forces [mN] of each pair of bodies in contact."""
    along = np.einsum("cd,cd->c", forces, contacts.normal)
    across = np.linalg.norm(forces - along[:, None] * contacts.normal, axis=1)
    normal: dict[str, float] = {}
    friction: dict[str, float] = {}
    for first, second in np.unique(contacts.bodies, axis=0):
        name = f"{model.body_names[first]}|{model.body_names[second]}"
        of_pair = (contacts.bodies == (first, second)).all(axis=1)
        normal[name] = float(along[of_pair].sum())
        friction[name] = float(across[of_pair].sum())
    return normal, friction
