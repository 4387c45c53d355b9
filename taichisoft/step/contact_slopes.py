"""Derivatives by the places of surfaces of what the rows of contacts do in a step.

A row has the normal of its contact, the points on its sides with their weights and arms, and its gap rate. All of them
are functions of the features' vertices where the search has measured them. The points are the closest ones of what the
vertices span: their difference d is across the features' directions E, E^T d = 0, and so, with the weights a,

    d(d) = d(X) + E da,   E^T E da = -E^T d(X) - dE^T d,

where d(X) is the move of d with the weights as they are.
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


@dataclass(frozen=True)
class PlaceSlopes:
    """Derivatives of a number by where bodies are and move at the start of a step.

    Attributes:
        position, velocity: by those of the nodes, shape (node_count, 3).
        rigid: by the places of the centres of mass, turns, linear and angular velocities of the rigid bodies, shape
            (rigid_count, 4, 3).
        inexact: whether normal and weights of each contact were taken as they are, or the row is that of a body that
            turns in the step, shape (contact_count,).
    """

    position: np.ndarray
    velocity: np.ndarray
    rigid: np.ndarray
    inexact: np.ndarray


class _Fields:
    """Linear and angular velocities, which nodes and rigid bodies carry, at the sides of contacts."""

    def __init__(self, places: "_Places", nodes: np.ndarray, rigid: np.ndarray):
        """Those of nodes, (node_count, 3), and rigid bodies, (rigid_count, 6)."""
        carried = np.einsum("cskn,cskni->cski", places.node_weight, _of(places.node, nodes))
        padded = _of(places.rigid, rigid)
        self.turning = padded[..., 3:]
        self.of_vertex = carried  # of the soft vertices; others go with their body
        straight = np.einsum("csk,cski->csi", places.weight, carried) + padded[..., :3]
        sides = straight + np.cross(self.turning, places.arm)
        self.difference = sides[:, 1] - sides[:, 0]


class _Places:
    """Features of the contacts with rows, where they were measured, and what carries them."""

    def __init__(self, model: Model, derivative: StepDerivative, rigid: RigidState):
        table, chosen, start = derivative.problem.contacts, derivative.contacts, derivative.start
        found, separation, carriers = table.found, table.separation, model.surfaces.carriers
        self.passed = model.scene.time.step * table.fraction[chosen]
        self.weight, self.normal = found.weights[chosen], found.normal[chosen]
        self.distance = found.distance[chosen]
        self.vertex, bodies = found.vertices[chosen], found.bodies[chosen] - len(model.soft_bodies)
        count = len(start.rigid_position)
        self.rigid = np.where((bodies >= 0) & (bodies < count), bodies, count)  # the last is none
        is_vertex = (self.vertex >= 0) & (self.weight != 0.0)
        is_soft = is_vertex & (carriers.owner[self.vertex] == SOFT)
        self.node = carriers.nodes[self.vertex]
        self.node_weight = np.where(is_soft[..., None], carriers.weights[self.vertex], 0.0)
        self.is_plane = ~is_vertex.any(axis=2)
        turn = turn_matrices(self.passed[:, None, None] * _of(self.rigid, rigid.angular))
        centre = _of(self.rigid, rigid.position) + self.passed[:, None, None] * _of(self.rigid, rigid.linear)
        own = np.vstack([matrices_from_quaternions(start.rigid_rotation), np.eye(3)[None]])[self.rigid]
        local = np.einsum("csij,cskj->cski", turn @ own, carriers.local[self.vertex])
        ahead = _of(self.node, start.position) + self.passed[:, None, None, None, None] * _of(self.node, start.velocity)
        of_nodes = np.einsum("cskn,cskni->cski", self.node_weight, ahead)
        self.place = np.where(is_soft[..., None], of_nodes, local + centre[:, :, None])
        self.place[~is_vertex] = 0.0
        self.turn, self.centre, self.is_vertex, self.is_soft = turn, centre, is_vertex, is_soft
        self.point = np.einsum("csk,cski->csi", self.weight, self.place)
        self.point[self.is_plane] = found.points[chosen][self.is_plane]
        self.is_rigid = self.rigid < count
        self.arm = np.where(self.is_rigid[..., None], separation.arm[chosen], 0.0)
        straight = np.where(self.is_rigid[..., None], self.point - centre, 0.0)
        # Arms at corners that touch are taken half the way earlier.
        half = turn_matrices(-0.5 * self.passed[:, None, None] * _of(self.rigid, rigid.angular))
        self.earlier = np.abs(_turned(half, straight) - self.arm).max(axis=2) < ALIKE
        self.earlier &= np.abs(straight - self.arm).max(axis=2) > ALIKE
        self.half = np.where(self.earlier[..., None, None], half, np.eye(3))
        self.arms_fit = np.abs(_turned(self.half, straight) - self.arm).max(axis=(1, 2)) < ALIKE

    def directions(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Directions E of the features, with the sign of their side, (contact_count, 4, 3); first vertex of each side,
        and whether there is such a direction.
        """
        first = self.is_vertex.argmax(axis=2)
        base = np.take_along_axis(self.place, first[..., None, None], axis=2)
        other = self.is_vertex & (np.arange(3) != first[..., None])
        along = np.where(other[..., None], self.place - base, 0.0) * np.array([-1.0, 1.0])[:, None, None]
        return along, first, other


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
    normal, passed, distance = at.normal, at.passed, at.distance
    sign = np.array([-1.0, 1.0])[:, None]
    impulse, row = (one[: 3 * count].reshape(-1, 3) for one in (derivative.impulse, multipliers.row))
    pushed, weighed = (np.einsum("cij,ci->cj", derivative.basis, one) for one in (impulse, row))
    response = np.einsum("bij,bj->bi", derivative.inverse_mass, multipliers.rigid)
    moved = _Fields(at, multipliers.node, response), _Fields(at, solution.node_velocity, solution.rigid_velocity)
    before = _Fields(at, start.velocity, np.hstack([rigid.linear, rigid.angular]))
    of_gap, of_speed, is_known = _gap_rate(derivative, at, before, model)
    of_gap, of_speed = row[:, 0] * of_gap / h, -row[:, 0] * of_speed * passed / h
    parts = (pushed, moved[0]), (weighed, moved[1]), (of_speed[:, None] * normal, before)
    # By the normal, and by places and arms of the sides: of sums of forces on velocities.
    turning = sum(np.cross(force, field.difference) for force, field in parts[:2])
    by_normal = np.cross(turning, normal) + of_speed[:, None] * before.difference
    by_arm = sum(sign * np.cross(force[:, None], field.turning) for force, field in parts)
    by_vertex = sum(np.einsum("ci,cski->csk", force, field.of_vertex) for force, field in parts)
    by_arm = np.einsum("csji,csj->csi", at.half, np.where(at.is_rigid[..., None], by_arm, 0.0))
    by_vertex = sign[:, :, None][None, :, 0] * by_vertex + np.einsum("csi,cski->csk", by_arm, at.place)
    along, first, other = at.directions()
    apart = at.point[:, 1] - at.point[:, 0]
    on_plane = at.is_plane.any(axis=1)
    across = np.abs(np.einsum("cski,ci->csk", along, apart)).max(axis=(1, 2))
    size = np.maximum(np.linalg.norm(along, axis=3).max(axis=(1, 2)), 1.0)
    fits = (np.abs(apart - distance[:, None] * normal).max(axis=1) < ALIKE) & (across < ALIKE * size)
    fits &= np.abs(distance) > ALIKE
    on_plane &= ~(at.is_plane & at.is_rigid).any(axis=1)
    fits &= on_plane | ~at.is_plane.any(axis=1)
    of_apart = of_gap[:, None] * normal
    bends = fits & ~on_plane
    across_normal = by_normal - (by_normal * normal).sum(axis=1)[:, None] * normal
    of_apart[bends] += across_normal[bends] / distance[bends, None]
    of_weights = by_vertex - np.take_along_axis(by_vertex, first[..., None], axis=2)
    of_weights = np.where(other & bends[:, None, None], of_weights, 0.0).reshape(count, 6)
    columns = np.where(bends[:, None, None, None], along, 0.0).reshape(count, 6, 3)
    square = columns @ columns.transpose(0, 2, 1)
    square += np.where((other & bends[:, None, None]).reshape(count, 6), 0.0, 1.0)[:, :, None] * np.eye(6)
    # The sign of a side is in its directions, and that of its own change in its weights.
    known = of_weights + np.einsum("cki,ci->ck", columns, of_apart)
    answer = np.linalg.solve(square, known[..., None])[..., 0]
    of_apart = of_apart - np.einsum("cki,ck->ci", columns, answer)
    by_place = sign[None, :, :, None] * at.weight[..., None] * of_apart[:, None, None]
    by_place += at.weight[..., None] * np.where(fits[:, None, None], by_arm, 0.0)[:, :, None]
    bent = sign[None, :, :, None] * answer.reshape(count, 2, 3, 1) * apart[:, None, None]
    by_place -= bent
    np.put_along_axis(
        by_place,
        first[..., None, None],
        np.take_along_axis(by_place, first[..., None, None], 2) + bent.sum(2)[:, :, None],
        2,
    )
    if (at.is_plane & at.is_rigid).any():  # a round side moves with its body
        by_point = sign * of_apart[:, None]
        by_place[..., 0, :] += np.where((at.is_plane & at.is_rigid)[..., None], by_point, 0.0)
    by_arm[~fits] = 0.0
    return _on_bodies(
        model, at, derivative, by_place, by_arm, of_speed, (before, rigid.angular), ~(fits & is_known & at.arms_fit)
    )


def _gap_rate(
    derivative: StepDerivative, at: _Places, before: _Fields, model: Model
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Shares of the gap and of the speed before the step in each gap rate, and whether it is made of these."""
    separation, chosen = derivative.problem.contacts.separation, derivative.contacts
    h, contact = model.scene.time.step, model.scene.contact
    gap = at.distance - contact.contact_distance
    way = at.passed * np.einsum("ci,ci->c", at.normal, before.difference)
    kept, of_gap, of_speed = np.zeros(len(gap)), np.ones(len(gap)), np.ones(len(gap))
    if contact.depth == "position":
        touching = separation.touching[chosen]
        at_start = np.where(at.passed > 0.0, np.maximum(gap - way, -touching), gap)
        kept = np.minimum(np.maximum(gap, at_start), 0.0)
        is_kept = kept < 0.0
        of_gap[is_kept & ((gap >= at_start) | (at_start > -touching))] = 0.0
        of_speed[is_kept & (gap < at_start) & (at_start > -touching)] = 0.0
    missed = np.abs((gap - kept - way) / h - separation.gap_rate[chosen])
    return of_gap, of_speed, missed < ALIKE


def _on_bodies(
    model: Model,
    at: _Places,
    derivative: StepDerivative,
    by_place: np.ndarray,
    by_arm: np.ndarray,
    of_speed: np.ndarray,
    motion: tuple[_Fields, np.ndarray],
    inexact: np.ndarray,
) -> PlaceSlopes:
    """Those by vertices, by arms and by the speeds before the step, as those by the bodies that carry them."""
    start, count = derivative.start, len(derivative.start.rigid_position)
    sign, normal, passed = np.array([-1.0, 1.0])[:, None], at.normal, at.passed[:, None, None]
    position, velocity = np.zeros((2, len(start.position) + 1, 3))
    of_nodes = at.node_weight[..., None] * by_place[..., None, :]
    np.add.at(position, at.node, of_nodes)
    speeds = sign * (of_speed[:, None] * normal)[:, None]
    on_nodes = at.passed[:, None, None, None, None] * of_nodes
    on_nodes += at.node_weight[..., None] * (at.weight[..., None] * speeds[:, :, None])[..., None, :]
    np.add.at(velocity, at.node, on_nodes)
    of_rigid = np.where((at.is_rigid[..., None] & ~at.is_soft)[..., None], by_place, 0.0)
    place = of_rigid.sum(axis=2)
    spun = np.cross(at.place - at.centre[:, :, None], of_rigid).sum(axis=2)
    round_side = at.is_plane & at.is_rigid
    spun[round_side] = np.cross(at.point - at.centre, place)[round_side]
    place = place - by_arm  # an arm is from the centre
    back = at.turn.transpose(0, 1, 3, 2)
    angular = _of(at.rigid, motion[1])
    mean, mean_earlier = (
        turn_matrices(share * passed * angular, mean=True).transpose(0, 1, 3, 2) for share in (1.0, -0.5)
    )
    earlier = -0.5 * _turned(mean_earlier, np.cross(at.arm, _turned(at.half, by_arm)))
    earlier = np.where(at.earlier[..., None], earlier, 0.0)
    by = np.stack(
        [
            place,
            _turned(back, spun),
            passed * place + speeds,
            passed * (_turned(mean, spun) + earlier) + np.cross(at.arm, speeds),
        ],
        axis=2,
    )
    rigid = np.zeros((count + 1, 4, 3))
    np.add.at(rigid, at.rigid, by)
    return PlaceSlopes(position[:-1], velocity[:-1], rigid[:count], inexact)


def _of(index: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Values by their numbers, 0 of one past the last."""
    return np.vstack([values, np.zeros((1, *values.shape[1:]))])[index]


def _turned(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    turned: np.ndarray = (matrices @ vectors[..., None])[..., 0]
    return turned
