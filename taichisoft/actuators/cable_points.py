"""Cables at rest: their points, found in the bodies that carry them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from taichisoft.actuators.finite_limits import UNLIMITED, limits
from taichisoft.bodies.embedding import embed
from taichisoft.bodies.rigid_body_arrays import Obstacle, RigidBody
from taichisoft.bodies.rotations import matrices_from_quaternions, rotation_from_degrees
from taichisoft.bodies.soft_body_arrays import EMBEDDING_MARGIN, SoftBody
from taichisoft.errors import SceneError
from taichisoft.meshes.point_files import read_points
from taichisoft.meshes.surface import stacked
from taichisoft.meshes.ten_nodes import linear_parts
from taichisoft.runtime.language import SOFT, STATIC
from taichisoft.scenes import actuators as settings

# A cable that rubs must stretch a little: where it sticks at some points and slides at others, its tensions would else
# depend on motions of no size. This is a polyethylene line of 0.5 mm [mN].
STRETCHING_WHERE_IT_RUBS = 1e7
# Two neighbouring points nearer than this [mm] give a segment no direction.
SHORTEST_SEGMENT = 1e-6


@dataclass(frozen=True)
class Cable:
    """A cable at rest.

    Attributes:
        name: "body.cable".
        settings: its table in the scene.
        owner: SOFT, STATIC or the number of the rigid body that carries each point, shape (point_count,).
        nodes, weights: soft nodes of the model that carry a point, and their weights, shape (point_count, slots); a
            point has four of them, an area as many for each of its points.
        place: points that no soft body carries: in the rigid body's frame, or in space [mm], shape (point_count, 3).
        rest_point: all points at the start [mm], shape (point_count, 3).
    """

    name: str
    settings: settings.CableSettings
    owner: np.ndarray
    nodes: np.ndarray
    weights: np.ndarray
    place: np.ndarray
    rest_point: np.ndarray

    @property
    def rest_length(self) -> float:
        """Length at the start [mm]."""
        return float(np.linalg.norm(np.diff(self.rest_point, axis=0), axis=1).sum())

    @property
    def compliance(self) -> np.ndarray:
        """Stretch of the cable's coordinates [mm] by its tension and by the tensions lost at its inner points [mN].

        The first is by how much the cable is longer than it was; then by how much shorter the parts are that begin at
        the inner points of a cable with friction. Shape (coordinate_count, coordinate_count), all 0 where nothing
        stretches.
        """
        inner = len(self.owner) - 2 if self.settings.friction else 0
        stiffness = self.settings.axial_stiffness or (STRETCHING_WHERE_IT_RUBS if inner else np.inf)
        segments = np.linalg.norm(np.diff(self.rest_point, axis=0), axis=1) / stiffness
        beyond = segments[::-1].cumsum()[::-1][: inner + 1]
        place = np.arange(inner + 1)
        by_loss = beyond[np.maximum(place[:, None], place)]
        by_loss[0, 1:] *= -1.0
        by_loss[1:, 0] *= -1.0
        return by_loss

    @property
    def tension_range(self) -> tuple[float, float]:
        """Smallest and largest tension [mN]."""
        slack = -UNLIMITED if self.settings.rod else 0.0
        return limits(self.settings.lowest_tension, self.settings.highest_tension, slack)

    @property
    def pull_range(self) -> tuple[float, float]:
        """How far it is pulled in at least and at most [mm]."""
        return limits(self.settings.lowest_pull, self.settings.highest_pull)


def make_cable(
    body: SoftBody,
    name: str,
    cable: settings.CableSettings,
    soft: Mapping[str, SoftBody],
    rigid: Mapping[str, tuple[int, RigidBody]],
    obstacles: Mapping[str, Obstacle],
) -> Cable:
    """A cable of a soft body.

    Raises:
        MeshError: a file of points cannot be read.
        SceneError: a point lies outside its body, or two neighbouring points are the same.
    """
    key = f"soft_bodies.{body.name}.cables.{name}"
    listed = read_points(cable.points) if isinstance(cable.points, str) else cable.points
    count = len(listed)
    places = [_place(one, body.name) for one in listed]
    owner = np.full(count, STATIC, dtype=np.int32)
    carried = [(np.zeros((1, 0)), np.zeros((1, 0)))] * count
    place, rest_point = np.zeros((count, 3)), np.zeros((count, 3))
    for carrier in dict.fromkeys(carrier for carrier, _, _ in places):
        on = [index for index, (other, _, _) in enumerate(places) if other == carrier]
        means = np.array([share @ points for _, points, share in (places[index] for index in on)])
        if carrier in soft:
            owner[on] = SOFT
            embedded = _embedded(soft[carrier], [places[index][1] for index in on], on, f"{key}.points")
            for index, (nodes, weights) in zip(on, embedded, strict=True):
                weights = places[index][2][:, None] * weights
                rest_point[index] = np.einsum("pk,pkd->d", weights, soft[carrier].rest_position[nodes])
                carried[index] = (nodes + soft[carrier].nodes.start).reshape(1, -1), weights.reshape(1, -1)
        elif carrier in rigid:
            owner[on], solid = rigid[carrier]
            place[on] = means - solid.centre_of_mass
            (turn,) = matrices_from_quaternions(solid.start_rotation[None])
            rest_point[on] = place[on] @ turn.T + solid.start_position
        else:
            place[on] = rest_point[on] = means @ obstacles[carrier].turn.T + obstacles[carrier].shift
    nodes = stacked([nodes for nodes, _ in carried]).astype(np.int32)
    weights = stacked([weights for _, weights in carried])
    if cable.pull_point is not None:
        turn, shift = rotation_from_degrees(body.settings.rotation), np.asarray(body.settings.translation)
        pull_point = turn @ np.asarray(cable.pull_point) + shift
        owner = np.insert(owner, 0, STATIC)
        nodes, weights = np.insert(nodes, 0, 0, axis=0), np.insert(weights, 0, 0.0, axis=0)
        place, rest_point = (np.insert(table, 0, pull_point, axis=0) for table in (place, rest_point))
    too_near = np.linalg.norm(np.diff(rest_point, axis=0), axis=1) < SHORTEST_SEGMENT
    if too_near.any():
        first = int(np.argmax(too_near)) - (cable.pull_point is not None)
        names = "pull_point and points.0" if first < 0 else f"points.{first} and points.{first + 1}"
        raise SceneError(f"{key}: {names} are the same place; a cable needs a direction between its points")
    return Cable(f"{body.name}.{name}", cable, owner, nodes, weights, place, rest_point)


def _place(listed: Any, own_body: str) -> tuple[str, np.ndarray, np.ndarray]:
    """Body, points [mm] and share of each point in the pull, of one of the points or areas that a scene lists."""
    if isinstance(listed, settings.CablePoint):
        return listed.body, np.array([listed.point]), np.ones(1)
    if isinstance(listed, settings.CableArea):
        weights = np.array(listed.weights if listed.weights is not None else [1.0] * len(listed.area))
        return listed.body or own_body, np.array(listed.area), weights / weights.sum()
    return own_body, np.array([listed], dtype=np.float64), np.ones(1)


def _embedded(
    body: SoftBody, places: Sequence[np.ndarray], numbers: Sequence[int], key: str
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Nodes of the body, and their weights, that carry the points of each place in mesh coordinates [mm]."""
    lower, upper = body.mesh.nodes.min(axis=0), body.mesh.nodes.max(axis=0)
    margin = EMBEDDING_MARGIN * (upper - lower).max()
    for number, points in zip(numbers, places, strict=True):
        outside = ((points < lower - margin) | (points > upper + margin)).any(axis=1)
        if outside.any() and body.settings.points_outside == "refused":
            raise SceneError(
                f"{key}.{number} = {points[np.argmax(outside)].tolist()}: lies outside the mesh of '{body.name}' "
                f"({np.round(lower, 3).tolist()} to {np.round(upper, 3).tolist()} mm, before it is placed)"
            )
    nodes, weights = embed(
        np.vstack(places), body.mesh.nodes, linear_parts(body.mesh.elements), body.settings.embedding
    )
    ends = np.cumsum([len(points) for points in places])[:-1]
    return list(zip(np.split(nodes, ends), np.split(weights, ends), strict=True))
