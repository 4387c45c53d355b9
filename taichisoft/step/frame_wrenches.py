"""Wrenches on frames: what a sensor of forces and torques between a frame and all that it carries would show.

A soft body exerts on its frame what its weight, the contacts and cables that act on it, and other loads leave of the
change of its momentum. Elements and pressures do not appear in this balance: they act within the body. Where anchors
hold a body at several frames the equations of the held nodes give the share of each, and the first frame has what is
left of the balance.
"""

import numpy as np

from taichisoft.contact.model import Model
from taichisoft.mechanics.actuator_kind import Line
from taichisoft.mechanics.cavities import CAVITIES
from taichisoft.mechanics.model_actuators import ActuatorGeometry
from taichisoft.mechanics.rigid_body_arrays import FramePlaces
from taichisoft.mechanics.state import State
from taichisoft.step.kernels import loads as kernels
from taichisoft.step.nonlinear_step import EndOfStep
from taichisoft.step.points_of_step import PointsOfStep
from taichisoft.step.rigid_motion import CarriedBodies
from taichisoft.step.soft_motion import SoftMotion
from taichisoft.step.solution import StepSolution


class AnchorForces:
    """What anchored nodes exert on frames, each by its own equation without the spring.

    The spring's stretch times its stiffness, 1e12 mN/mm, would show round-off in motion, 0.01 mN, and in derivatives
    nothing else.
    """

    def __init__(self, model: Model, soft: SoftMotion, equations: EndOfStep | None, node: np.ndarray):
        """Prepare for `node`, which are no nodes of reduced bodies; `equations` are those of several linearisations."""
        elasticity = model.elasticity
        assert elasticity is not None
        self._soft, self._equations, self._node, self._time = soft, equations, node, model.scene.time
        self._inertia, self._mass = elasticity.inertia[node, None], elasticity.node_mass[node, None]
        self._holds = elasticity.anchor_stiffness[node] > 0.0
        place = np.full(model.node_count, -1)
        place[node] = np.arange(len(node))
        first, second = elasticity.symbolic.block_pairs.T
        is_off = first != second
        lower, upper = (np.flatnonzero(is_off & (place[one] >= 0)) for one in (first, second))
        self._lower, self._upper = lower, upper
        self._row = place[np.concatenate([first[lower], second[upper]])]
        self._pair = np.concatenate([first[lower], second[upper]]), np.concatenate([second[lower], first[upper]])

    def find(self, start: State, node_velocity: np.ndarray, solution: StepSolution) -> np.ndarray:
        """Forces on the frames [mN], shape (count, 3), with the velocities of the nodes after the step.

        It is called before the actuators are measured at the end of the step.
        """
        node, time_step = self._node, self._time.step
        if self._equations is not None:  # of the bodies where the solution takes them
            impulse = self._equations.residual(solution.effort, with_anchors=False)[node]
        else:
            impulse = self._soft.impulses(start, solution.effort, with_anchors=False)[node]
            change = solution.node_velocity - (start.velocity if self._time.dynamics == "inertial" else 0.0)
            impulse -= self._inertia * change[node] + self._product(change)
        force: np.ndarray = (impulse + solution.contact_node_impulse[node]) / time_step
        if self._time.theta < 1.0:  # velocities of what springs hold are replaced, see `SoftMotion.end_velocity`
            force -= self._mass / time_step * (node_velocity[node] - solution.node_velocity[node])
        return np.where(self._holds, force, 0.0)

    def _product(self, change: np.ndarray) -> np.ndarray:
        """Product of the rows of the stiffness and a change of velocities [mN s], shape (count, 3).

        No stiffness resists a translation, so that the blocks of a row add up to 0: those on the diagonal, which the
        anchors' springs round off, are not needed.
        """
        blocks, (own, other) = self._soft.system.solver.blocks, self._pair
        blocks = np.concatenate([blocks[self._lower], blocks[self._upper].transpose(0, 2, 1)])
        products = np.einsum("nij,nj->ni", blocks, change[other] - change[own])
        total = np.zeros((len(self._node), 3))
        np.add.at(total, self._row, products)
        return total


class FrameWrenches:
    """Sums up what anchored soft bodies, bodies that frames carry, and cables that they pull exert on frames."""

    def __init__(self, model: Model, points: PointsOfStep, soft: SoftMotion | None, equations: EndOfStep | None):
        self._model, self._points, actuators = model, points, model.actuators
        self._bodies: list[tuple[int, slice]] = []
        self._shares: list[tuple[int, int, slice]] = []  # first frame of a body, another, and the nodes held at that
        shared: list[np.ndarray] = []
        for body in model.soft_bodies:
            anchors = slice(*np.searchsorted(model.anchored_nodes, [body.nodes.start, body.nodes.stop]))
            node, frame = model.anchored_nodes[anchors], model.anchor_frame[anchors]
            first, *others = dict.fromkeys(frame.tolist()) or [-1]
            self._bodies += [(first, body.nodes)] if len(node) else []
            for other in others:
                count = sum(map(len, shared))
                shared.append(node[frame == other])
                self._shares.append((first, other, slice(count, count + len(shared[-1]))))
        self._shared = np.concatenate([*shared, np.zeros(0)]).astype(np.int32)
        self._anchors = AnchorForces(model, soft, equations, self._shared) if shared and soft is not None else None
        self._held = self._lay_out() if self._bodies else None
        self._inertia = float(model.scene.time.dynamics == "inertial")
        coordinates = actuators.first_coordinate[[actuators.place(CAVITIES).stop, -1]]
        self._entries = slice(*actuators.coordinates.entry_start[coordinates].tolist())
        counts = np.diff(actuators.coordinates.entry_start)
        self._coordinate = np.repeat(np.arange(len(counts)), counts)[self._entries]
        pulled = [line for line in model.cables.lines if line.frame >= 0]
        self._places: FramePlaces | None = None  # of `_pivots`
        self._pulled = [(line, actuators.first_coordinate[actuators.names.index(line.name)]) for line in pulled]

    def cable_forces(self, geometry: ActuatorGeometry, effort: np.ndarray, position: np.ndarray) -> np.ndarray | float:
        """Force [mN] of cables on each soft body, and torque about the origin [mN mm], shape (body_count, 2, 3); 0
        without cables.
        """
        some = self._entries
        if some.start == some.stop:
            return 0.0
        node = self._model.actuators.coordinates.entry_node[some]
        force = effort[self._coordinate, None] * geometry.gradient.soft[some]
        of_bodies = [(node >= nodes.start) & (node < nodes.stop) for _, nodes in self._bodies]
        found = [_resultant(position[node[one]], force[one]) for one in of_bodies]
        forces: np.ndarray = np.array(found).reshape(-1, 2, 3)
        return forces

    def anchor_forces(self, start: State, node_velocity: np.ndarray, solution: StepSolution) -> np.ndarray:
        """Forces of the nodes of `_shares` on their frames [mN], see `AnchorForces.find`."""
        if self._anchors is None:
            return np.zeros((0, 3))
        return self._anchors.find(start, node_velocity, solution)

    def find(
        self,
        start: State,
        pose_before: np.ndarray,
        position: np.ndarray,
        node_velocity: np.ndarray,
        solution: StepSolution,
        cable_forces: np.ndarray | float,
        anchor_forces: np.ndarray,
        carried: CarriedBodies,
    ) -> np.ndarray:
        """Forces [mN], and torques about the pivots [mN mm], in world axes, in a step, shape (frame_count, 2, 3).

        Torques are taken where all is at theta h: with 0.5 the change of the angular momentum is the sum of x times
        the change of m v at the middle x of the displacement, exactly. In the state at the start the frames are where
        they are at the end, as are the carried bodies; positions and velocities of the nodes are those at the end.
        """
        model = self._model
        frames, time_step, theta = model.frames, model.scene.time.step, model.scene.time.theta
        places, centres = model.places(start), carried.position
        if places is not self._places:
            self._places, self._pivots = places, frames.pivots(places)
        pivots = self._pivots
        before = frames.places(pose_before) if theta < 1.0 else places
        if theta < 1.0:
            position = start.position + theta * (position - start.position)
            pivots = pivots + (1.0 - theta) * (frames.pivots(before) - pivots)
            centres = centres - (1.0 - theta) * time_step * carried.velocity[:, :3]
        wrench = np.zeros((len(frames.names), 2, 3))
        of_bodies = self._of_bodies(start, position, node_velocity, solution) + cable_forces
        for (frame, _), of_body in zip(self._bodies, of_bodies, strict=True):
            wrench[frame] += of_body
        for first, other, own in self._shares:
            share = _resultant(position[self._shared[own]], anchor_forces[own])
            wrench[other] += share
            wrench[first] -= share
        for line, coordinate in self._pulled:
            wrench[line.frame] += self._pull(line, start, float(solution.effort[coordinate]))
        if len(carried.index):
            impulses = solution.rigid_impulse[carried.index] / time_step
            for frame, impulse, centre in zip(carried.frame.tolist(), impulses, centres, strict=True):
                wrench[frame] += [impulse[:3], impulse[3:] + np.cross(centre, impulse[:3])]
        for number, force, torque, point in model.external_forces.on_frames(start):
            first, last = (each.moved(point[None], number)[0] for each in (before, places))
            wrench[number] += [force, torque + np.cross(last + (1.0 - theta) * (first - last), force)]
        for number in reversed(range(1, len(frames.names))):
            if frames.parent[number] >= 0:
                wrench[frames.parent[number]] += wrench[number]
        wrench[:, 1] -= _cross(pivots, wrench[:, 0])
        return wrench

    def _lay_out(self) -> kernels.HeldBodies:
        model, elasticity = self._model, self._model.elasticity
        assert elasticity is not None
        dynamics, count = model.scene.time.dynamics, model.node_count
        drags = {
            "inertial": elasticity.node_rayleigh_mass,
            "overdamped": np.ones(count),
            "static": np.zeros(count),
        }
        return kernels.HeldBodies(
            nodes=np.array([(nodes.start, nodes.stop) for _, nodes in self._bodies], dtype=np.int32).ravel(),
            mass=elasticity.node_mass.copy(),
            drag=drags[dynamics].copy(),
            constant=np.vstack([body.node_force for body in model.soft_bodies]),
            gravity=np.empty((1, 3)),
            impulse=np.zeros((count, 3)),
            before=self._points.node_velocity,
            after=np.zeros((count, 3)),
            place=self._points.node_after,
            wrench=np.empty((len(self._bodies), 6)),
        )

    def _of_bodies(
        self, start: State, position: np.ndarray, node_velocity: np.ndarray, solution: StepSolution
    ) -> np.ndarray:
        """Wrenches of the soft bodies about the origin, but for cables, shape (body_count, 2, 3)."""
        held, time = self._held, self._model.scene.time
        if held is None:
            return np.zeros((0, 2, 3))
        self._points.begin(start)
        self._points.end(position)
        held.gravity[0], held.impulse[:], held.after[:] = start.gravity, solution.contact_node_impulse, node_velocity
        for one in self._model.external_forces.on_nodes(start):
            held.impulse[one.node] += time.step * one.at(position if time.most_linearisations > 1 else start.position)
        kernels.sum_wrenches(time.step, self._inertia, held)
        return held.wrench.reshape(-1, 2, 3)

    def _pull(self, line: Line, start: State, tension: float) -> np.ndarray:
        """What a cable exerts on a frame at its pull point, where it runs at the start of the step."""
        first, second = line.points(start, self._model.frames)[:2]
        force = tension * (second - first) / np.linalg.norm(second - first)
        return np.array([force, np.cross(first, force)])


AFTER, BEFORE = np.array([1, 2, 0]), np.array([2, 0, 1])


def _cross(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Vector products of rows, shape (count, 3) each, as by `np.cross`, which takes ten times as long for a few."""
    product: np.ndarray = one[:, AFTER] * other[:, BEFORE] - one[:, BEFORE] * other[:, AFTER]
    return product


def _resultant(place: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Sums of forces and of their torques about the origin, shape (2, 3), by places and forces, shape (count, 3)."""
    products = np.einsum("ni,nj->ij", place, force)  # not by BLAS, whose sums depend on the number of threads
    torque = (products - products.T)[AFTER, BEFORE]
    return np.array([force.sum(axis=0), torque])
