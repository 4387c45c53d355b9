"""Derivatives by the places of surfaces of what the rows of contacts do in a step.

A row has the normal of its contact, the points on its sides with their weights and arms, and its gap rate. All of them
are functions of the features' vertices where the search has measured them. The points are the closest ones of what the
vertices span: their difference d is across the features' directions E, E^T d = 0, and so, with the weights a,

    d(d) = d(X) + E da,   E^T E da = -E^T d(X) - dE^T d,

where d(X) is the move of d with the weights as they are. In shapes, a contact has two sides with three vertices each.
"""

from dataclasses import dataclass

import numpy as np

from taichisoft.base.rotations import matrices_from_quaternions, turn_matrices
from taichisoft.contact.model import Model
from taichisoft.mechanics.kernels.rigid_integration import RigidState
from taichisoft.runtime.language import SOFT
from taichisoft.step.step_derivative import Multipliers, StepDerivative

ALIKE = 1e-6
"""Largest difference between a contact's row and what is derived in its place [mm] and [mm/s]."""
EARLY = 1e-6
"""Share of a step before which contacts are measured at its start [-]."""
SIGN = np.array([-1.0, 1.0])[:, None]
"""Of the sides, in what the second point has more than the first."""


@dataclass(frozen=True)
class PlaceSlopes:
    """Derivatives of a number by where bodies are and move at the start of a step.

    Attributes:
        position, velocity: by those of the nodes, shape (node_count, 3).
        rigid: by the places of the centres of mass, turns, linear and angular velocities of the rigid bodies, shape
            (rigid_count, 4, 3).
        inexact: whether normal and weights of each contact were taken as they are, or the time of the measurement, or
            the row is that of a body that turns in the step, shape (contact_count,).
        touching: whether each contact is pressed at a gap where `depth = "position"` begins to keep it,
            shape (contact_count,).
    """

    position: np.ndarray
    velocity: np.ndarray
    rigid: np.ndarray
    inexact: np.ndarray
    touching: np.ndarray


class _Places:
    """Features of the contacts with rows, where they were measured, and what carries them.

    Attributes:
        passed: time of the measurement after the start of the step [s], shape (count,).
        rigid: rigid body of each side, or their number for none, shape (count, 2).
        is_vertex, is_soft: whether there is a vertex, and on a soft body, shape (count, 2, 3).
        node, node_weight: nodes that carry each soft vertex, shape (count, 2, 3, nodes_per_vertex).
        place: of the vertices [mm], shape (count, 2, 3, 3); `start_place` at the start of the step, from the centres of
            rigid bodies, `start_centre`.
        turn, centre: of the rigid bodies, against the start, shapes (count, 2, 3, 3) and (count, 2, 3).
        arm: from the centres to the points, 0 elsewhere [mm]; `half` turns it back to where it was taken, at corners
            that touch at half the time (`earlier`), shape (count, 2, 3).
        fits: whether the points are the closest ones of the features, or those of a vertex and a plane (`on_plane`).
        arms_fit: whether the arms are those of the points.
    """

    def __init__(self, model: Model, derivative: StepDerivative, rigid: RigidState):
        table, chosen, start = derivative.problem.contacts, derivative.contacts, derivative.start
        found, carriers, count = table.found, model.surfaces.carriers, len(start.rigid_position)
        self.passed = model.scene.time.step * table.fraction[chosen]
        self.weight, self.normal, self.distance = (one[chosen] for one in (found.weights, found.normal, found.distance))
        given, bodies = found.vertices[chosen], found.bodies[chosen] - len(model.soft_bodies)
        self.is_rigid = (bodies >= 0) & (bodies < count)
        self.rigid = np.where(self.is_rigid, bodies, count)
        self.is_vertex = (given >= 0) & (self.weight != 0.0)
        vertex = np.where(self.is_vertex, given, len(carriers.owner))
        self.is_soft = self.is_vertex & (_of(vertex, carriers.owner[:, None])[..., 0] == SOFT)
        self.node = _of(vertex, carriers.nodes).astype(np.int64)
        self.node_weight = np.where(self.is_soft[..., None], _of(vertex, carriers.weights), 0.0)
        local = _of(vertex, carriers.local)
        later = self.passed[:, None, None]
        self.turning = later * _of(self.rigid, rigid.angular)
        self.turn = turn_matrices(self.turning)
        self.centre = _of(self.rigid, rigid.position) + later * _of(self.rigid, rigid.linear)
        axes = np.vstack([matrices_from_quaternions(start.rigid_rotation), np.eye(3)[None]])[self.rigid]
        on_rigid = np.einsum("csij,cskj->cski", self.turn @ axes, local) + self.centre[:, :, None]
        ahead = _of(self.node, start.position) + later[..., None, None] * _of(self.node, start.velocity)
        on_nodes = np.einsum("cskn,cskni->cski", self.node_weight, ahead)
        self.place = np.where(self.is_soft[..., None], on_nodes, on_rigid)
        self.place[~self.is_vertex] = 0.0
        is_flat = ~self.is_vertex.any(axis=2)
        self.is_round = is_flat & self.is_rigid
        self.on_plane = is_flat.any(axis=1) & ~self.is_round.any(axis=1)
        self.point = np.einsum("csk,cski->csi", self.weight, self.place)
        self.point[is_flat] = found.points[chosen][is_flat]
        self._find_directions()
        self.apart = self.point[:, 1] - self.point[:, 0]
        across = np.abs(np.einsum("cski,ci->csk", self.along, self.apart)).max(axis=(1, 2))
        size = np.maximum(np.linalg.norm(self.along, axis=3).max(axis=(1, 2)), 1.0)
        misses = np.abs(self.apart - self.distance[:, None] * self.normal).max(axis=1)
        self.fits = (misses < ALIKE) & (across < ALIKE * size) & (np.abs(self.distance) > ALIKE)
        self.fits &= self.on_plane | ~is_flat.any(axis=1)
        on_start = np.einsum("csij,cskj->cski", axes, local) * self.is_rigid[..., None, None]
        soft_start = np.einsum("cskn,cskni->cski", self.node_weight, _of(self.node, start.position))
        self.start_place = np.where(self.is_soft[..., None], soft_start, on_start) * self.is_vertex[..., None]
        self.start_centre = np.where(self.is_rigid[..., None], _of(self.rigid, rigid.position), 0.0)
        self._find_arms(np.where(self.is_rigid[..., None], table.separation.arm[chosen], 0.0))

    def _find_directions(self) -> None:
        """Directions E with the sign of their side, from the first vertex of each side to the others."""
        first = self.is_vertex.argmax(axis=2)
        self.other = self.is_vertex & (np.arange(3) != first[..., None])
        self.first = first[..., None]
        base = np.take_along_axis(self.place, self.first[..., None], axis=2)
        self.along = np.where(self.other[..., None], self.place - base, 0.0) * SIGN[:, None]

    def _find_arms(self, arm: np.ndarray) -> None:
        straight = np.where(self.is_rigid[..., None], self.point - self.centre, 0.0)
        back = turn_matrices(-0.5 * self.turning)
        self.earlier = np.abs(_turned(back, straight) - arm).max(axis=2) < ALIKE
        self.earlier &= np.abs(straight - arm).max(axis=2) > ALIKE
        self.half, self.arm = np.where(self.earlier[..., None, None], back, np.eye(3)), arm
        self.arms_fit = np.abs(_turned(self.half, straight) - arm).max(axis=(1, 2)) < ALIKE


class _Field:
    """Velocities of nodes, (node_count, 3), and rigid bodies, (rigid_count, 6), at the sides of contacts."""

    def __init__(self, at: _Places, nodes: np.ndarray, rigid: np.ndarray):
        self.of_vertex = np.einsum("cskn,cskni->cski", at.node_weight, _of(at.node, nodes))  # of soft ones alone
        linear, self.turning = np.split(_of(at.rigid, rigid), 2, axis=2)
        sides = np.einsum("csk,cski->csi", at.weight, self.of_vertex) + linear + np.cross(self.turning, at.arm)
        self.difference = sides[:, 1] - sides[:, 0]


def contact_slopes(
    model: Model, derivative: StepDerivative, multipliers: Multipliers, rigid: RigidState
) -> PlaceSlopes:
    """Derivatives of a number, by its multipliers, by where the surfaces in the rows of contacts are.

    Args:
        model, derivative: the bodies and their step.
        multipliers: of the number.
        rigid: the rigid bodies as at the start of the step.
    """
    h, start, solution = model.scene.time.step, derivative.start, derivative.solution
    at, count = _Places(model, derivative, rigid), derivative.contact_count
    impulse, row = (one[: 3 * count].reshape(-1, 3) for one in (derivative.impulse, multipliers.row))
    pushed, weighed = (np.einsum("cij,ci->cj", derivative.basis, one) for one in (impulse, row))
    response = np.einsum("bij,bj->bi", derivative.inverse_mass, multipliers.rigid)
    answer, motion = _Field(at, multipliers.node, response), _Field(at, solution.node_velocity, solution.rigid_velocity)
    before = _Field(at, start.velocity, np.hstack([rigid.linear, rigid.angular]))
    gap_share, speed_share, is_known, touching = _gap_rate(model, derivative, at, before)
    turning_rows = derivative.turning_rows
    renewed = turning_rows.renewed.any(axis=1)
    gap_share[renewed] = speed_share[renewed] = 0.0
    by_gap, by_speed = row[:, 0] * gap_share / h, -row[:, 0] * speed_share * at.passed / h
    by_start_gap = np.where(renewed, row[:, 0] / h, 0.0)  # a renewed row knows the gap of these points at the start
    # The number has the impulse on the response, and the row's multiplier on the motion and on the gap rate.
    products = (pushed, answer), (weighed, motion), (by_speed[:, None] * at.normal, before)
    turning = sum(np.cross(force, field.difference) for force, field in products[:2])
    by_normal = np.cross(turning, at.normal) + by_speed[:, None] * before.difference
    start_point = np.einsum("csk,cski->csi", at.weight, at.start_place) + at.start_centre
    by_normal += by_start_gap[:, None] * (start_point[:, 1] - start_point[:, 0])
    by_arm = SIGN * np.sum([np.cross(force[:, None], field.turning) for force, field in products], axis=0)
    by_start_arm = np.where(
        turning_rows.renewed[..., None], _turned(turning_rows.mean.transpose(0, 1, 3, 2), by_arm), 0.0
    )
    by_arm = np.where(
        (at.is_rigid & ~turning_rows.renewed & at.fits[:, None])[..., None],
        _turned(at.half.transpose(0, 1, 3, 2), by_arm),
        0.0,
    )
    by_weight = SIGN * np.sum([np.einsum("ci,cski->csk", force, field.of_vertex) for force, field in products], axis=0)
    by_weight += np.einsum("csi,cski->csk", by_arm, at.place)
    by_start_point = SIGN * (by_start_gap[:, None] * at.normal)[:, None]
    by_weight += np.einsum("csi,cski->csk", by_start_point + by_start_arm, at.start_place)
    by_apart = by_gap[:, None] * at.normal
    bends = at.fits & ~at.on_plane
    across = by_normal - (by_normal * at.normal).sum(axis=1)[:, None] * at.normal
    by_apart[bends] += across[bends] / at.distance[bends, None]
    by_place = _by_features(at, bends, by_apart, by_weight) + (at.weight[..., None] * by_arm[:, :, None])
    places = _on_bodies(derivative, at, by_place, by_arm, SIGN * (by_speed[:, None] * at.normal)[:, None])
    if renewed.any():
        _add_start(derivative, at, by_start_point, by_start_arm, places)
    position, velocity, of_bodies = (one[:-1] for one in places)
    # The time of a measurement within the step, where surfaces come close, is taken as it is.
    is_timed = (at.passed == h) | (at.passed < EARLY * h)
    inexact = ~(at.fits & is_known & at.arms_fit & is_timed)
    return PlaceSlopes(position, velocity, of_bodies, inexact, touching & (row[:, 0] != 0.0))


def _add_start(
    derivative: StepDerivative,
    at: _Places,
    by_point: np.ndarray,
    by_arm: np.ndarray,
    places: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> None:
    """Add those by the points and arms of renewed rows, where the start has them."""
    position, _, of_bodies = places
    by_vertex = at.weight[..., None] * by_point[:, :, None]
    np.add.at(position, at.node, at.node_weight[..., None] * by_vertex[..., None, :])
    by_centre = np.where(at.is_rigid[..., None], by_point, 0.0)
    arm = np.einsum("csk,cski->csi", at.weight, at.start_place)
    spun = np.cross(derivative.turning_rows.arm, by_arm) + np.cross(arm, by_centre)
    np.add.at(of_bodies[:, :2], at.rigid, np.stack([by_centre, spun], axis=2))


def _gap_rate(
    model: Model, derivative: StepDerivative, at: _Places, before: _Field
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Shares of the gap and of the way before the step in each gap rate, whether it is of these, and has a kink."""
    separation, chosen = derivative.problem.contacts.separation, derivative.contacts
    gap = at.distance - model.scene.contact.contact_distance
    way = at.passed * np.einsum("ci,ci->c", at.normal, before.difference)
    kept, gap_share, way_share = np.zeros(len(gap)), np.ones(len(gap)), np.ones(len(gap))
    touches = np.zeros(len(gap), bool)
    if model.scene.contact.depth == "position":
        touching = separation.touching[chosen]
        at_start = np.where(at.passed > 0.0, np.maximum(gap - way, -touching), gap)
        kept, touches = np.minimum(np.maximum(gap, at_start), 0.0), np.abs(np.maximum(gap, at_start)) < ALIKE
        is_free = at_start > -touching
        gap_share[(kept < 0.0) & ((gap >= at_start) | is_free)] = 0.0
        way_share[(kept < 0.0) & (gap < at_start) & is_free] = 0.0
    missed = np.abs((gap - kept - way) / model.scene.time.step - separation.gap_rate[chosen])
    return gap_share, way_share, missed < ALIKE, touches


def _by_features(at: _Places, bends: np.ndarray, by_apart: np.ndarray, by_weight: np.ndarray) -> np.ndarray:
    """Derivatives by the vertices, of those by the difference of the points and by the weights of the vertices.

    Weights change where `bends`, shape (count,); elsewhere points stay where they are on their features.
    """
    count, moves = len(bends), at.other & bends[:, None, None]
    along = np.where(moves[..., None], at.along, 0.0).reshape(count, 6, 3)
    by_change = np.where(moves, by_weight - np.take_along_axis(by_weight, at.first, axis=2), 0.0).reshape(count, 6)
    square = along @ along.transpose(0, 2, 1) + np.where(moves.reshape(count, 6), 0.0, 1.0)[:, :, None] * np.eye(6)
    known = by_change + np.einsum("cki,ci->ck", along, by_apart)
    change = np.linalg.solve(square, known[..., None])[..., 0]
    by_apart = by_apart - np.einsum("cki,ck->ci", along, change)
    by_place = SIGN[:, None] * at.weight[..., None] * by_apart[:, None, None]
    bent = SIGN[:, None] * change.reshape(count, 2, 3, 1) * at.apart[:, None, None]
    np.put_along_axis(bent, at.first[..., None], -bent.sum(axis=2, keepdims=True), axis=2)
    by_place -= bent
    by_place[..., 0, :] += np.where(at.is_round[..., None], SIGN * by_apart[:, None], 0.0)
    return by_place


def _on_bodies(
    derivative: StepDerivative, at: _Places, by_place: np.ndarray, by_arm: np.ndarray, by_speed: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Those by vertices, by arms and by the speeds of the sides before the step, by the bodies that carry them.

    Arrays are those of `PlaceSlopes` with one more entry at the end, of none.
    """
    position, velocity = np.zeros((2, len(derivative.start.position) + 1, 3))
    by_node = at.node_weight[..., None] * by_place[..., None, :]
    np.add.at(position, at.node, by_node)
    fast = at.node_weight[..., None] * (at.weight[..., None] * by_speed[:, :, None])[..., None, :]
    np.add.at(velocity, at.node, at.passed[:, None, None, None, None] * by_node + fast)
    by_body = np.where((at.is_rigid[..., None] & ~at.is_soft)[..., None], by_place, 0.0)
    by_centre = by_body.sum(axis=2)
    spun = np.cross(at.place - at.centre[:, :, None], by_body).sum(axis=2)
    spun[at.is_round] = np.cross(at.point - at.centre, by_centre)[at.is_round]
    by_centre = by_centre - by_arm  # an arm is from the centre
    later, back = at.passed[:, None, None], (0, 1, 3, 2)
    by_turning = _turned(turn_matrices(at.turning, mean=True).transpose(back), spun)
    moment = np.cross(at.arm, _turned(at.half, by_arm))
    earlier = _turned(turn_matrices(-0.5 * at.turning, mean=True).transpose(back), moment)
    by_turning -= 0.5 * np.where(at.earlier[..., None], earlier, 0.0)
    by_angular = later * by_turning + np.cross(at.arm, by_speed)
    parts = by_centre, _turned(at.turn.transpose(back), spun), later * by_centre + by_speed, by_angular
    rigid = np.zeros((len(derivative.start.rigid_position) + 1, 4, 3))
    np.add.at(rigid, at.rigid, np.stack(parts, axis=2))
    return position, velocity, rigid


def _of(index: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Values by their numbers, 0 of one past the last."""
    return np.vstack([values, np.zeros((1, *values.shape[1:]))])[index]


def _turned(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    turned: np.ndarray = (matrices @ vectors[..., None])[..., 0]
    return turned
