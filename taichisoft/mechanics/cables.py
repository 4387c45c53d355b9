"""Cables, driven by their tension or by how far they are pulled in: their lengths change with the bodies' motion."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from taichisoft.base.rotations import matrices_from_quaternions, rotation_from_degrees
from taichisoft.errors import SceneError
from taichisoft.mechanics.actuator_kind import (
    UNLIMITED,
    ActuatorBuffers,
    ActuatorFigure,
    ActuatorKind,
    ActuatorSet,
    Drive,
    Line,
    limits,
)
from taichisoft.mechanics.body_geometry import Poses
from taichisoft.mechanics.rigid_body_arrays import Obstacle, RigidBody
from taichisoft.mechanics.selection import embed, far_outside
from taichisoft.mechanics.soft_body_arrays import SoftBody
from taichisoft.mesh.mesh_files import read_points
from taichisoft.mesh.surface import stacked
from taichisoft.mesh.volume_mesh import linear_parts
from taichisoft.runtime.language import SOFT, STATIC
from taichisoft.scene import actuators as settings

if TYPE_CHECKING:
    pass

# Cables at rest: their points, found in the bodies that carry them.

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
    """A cable of a soft body."""
    key = f"soft_bodies.{body.name}.cables.{name}"
    listed = read_points(cable.points) if isinstance(cable.points, str) else cable.points
    count = len(listed)
    places = [_place(point, body.name) for point in listed]
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
    for number, points in zip(numbers, places, strict=True):
        outside, box = far_outside(points, body.mesh)
        if outside.any() and body.settings.points_outside == "refused":
            raise SceneError(
                f"{key}.{number} = {points[np.argmax(outside)].tolist()}: lies outside the mesh of '{body.name}' "
                f"({box}, before it is placed)"
            )
    nodes, weights = embed(
        np.vstack(places), body.mesh.nodes, linear_parts(body.mesh.elements), body.settings.embedding
    )
    ends = np.cumsum([len(points) for points in places])[:-1]
    return list(zip(np.split(nodes, ends), np.split(weights, ends), strict=True))


class Cables(ActuatorSet):
    """All cables in one set of arrays.

    A coordinate of a cable is how far it is pulled in; with friction a coordinate for each inner point follows it, the
    length beyond that point.

    Attributes:
        all: the cables.
        paths: what the kernels read.
        place: points that no soft body carries, see `Cable`, shape (point_count, 3).
        rest_pull_point: pull points at the start [mm], the first point where there is none, shape (cable_count, 3).
        has_pull_point: whether a cable has a pull point, shape (cable_count,).
        pull_point_frame: number of the frame that carries it; -1 where none does, shape (cable_count,).
    """

    sign = -1.0

    def __init__(
        self,
        frames: "Sequence[str]",
        soft: "Sequence[SoftBody]",
        rigid: "Sequence[RigidBody]",
        obstacles: "Sequence[Obstacle]",
    ):
        """Find the points of all cables in the bodies, and which of the frames of these names carry pull points."""

        others = {body.name: (index, body) for index, body in enumerate(rigid)}
        bodies = {body.name: body for body in soft}
        fixed = {obstacle.name: obstacle for obstacle in obstacles}
        self.all = tuple(
            make_cable(body, name, cable, bodies, others, fixed)
            for body in soft
            for name, cable in body.settings.cables.items()
        )
        super().__init__(
            names=[cable.name for cable in self.all],
            rest_value=np.array([cable.rest_length for cable in self.all]),
            coordinate_range=np.array([cable.pull_range for cable in self.all]),
            effort_range=np.array([cable.tension_range for cable in self.all]),
            soft_entries=[],
        )
        self.effort_at_stop = self.effort_range[:, 0]  # a stop is not a motor, and a cable does not push there either
        self.pushes_and_pulls = np.array([cable.settings.rod for cable in self.all], dtype=bool)
        self.rubs = np.array([cable.settings.friction > 0.0 for cable in self.all], dtype=bool)
        self.compliance = [cable.compliance for cable in self.all]
        self.place = np.vstack([np.zeros((0, 3)), *(cable.place for cable in self.all)])
        self.rest_pull_point = np.array([cable.rest_point[0] for cable in self.all]).reshape(-1, 3)
        pulled_from_space = [cable.settings.pull_point is not None for cable in self.all]
        self.has_pull_point = np.array(pulled_from_space, dtype=bool)
        carriers = [frames.index(body.settings.follows) for body in soft for _ in body.settings.cables]
        moves = self.has_pull_point & np.array([cable.settings.pull_point_moves for cable in self.all], dtype=bool)
        self.pull_point_frame = np.where(moves, np.array(carriers, dtype=np.int64), -1)
        self.lines = tuple(
            Line(
                name=cable.name,
                number=number,
                owner=cable.owner,
                nodes=cable.nodes,
                weights=cable.weights,
                place=cable.place,
                rest_length=cable.rest_length,
                friction=cable.settings.friction,
                has_pull_point=bool(self.has_pull_point[number]),
                frame=int(self.pull_point_frame[number]),
            )
            for number, cable in enumerate(self.all)
        )
        self._lay_out()

    def start(self) -> dict[str, np.ndarray]:
        """The pull points of the first state."""
        return {"pull_point": self.rest_pull_point.copy()}

    def shapes(self, buffers: ActuatorBuffers) -> "CableShapes":
        """What measures their lengths."""
        return CableShapes(self, buffers)

    def _lay_out(self) -> None:
        from taichisoft.mechanics.kernels import actuator_coordinates as kernels

        starts = np.cumsum([0, *(len(cable.owner) for cable in self.all)])
        slots, rigid_slots, cable_of, first_points = [], [], [], []
        self.rigid_entries = []
        for index, (cable, start) in enumerate(zip(self.all, starts[:-1], strict=True)):
            acts = cable.weights != 0.0
            nodes = np.unique(cable.nodes[acts])
            slots.append(np.where(acts, np.searchsorted(nodes, cable.nodes), -1))
            bodies = np.unique(cable.owner[cable.owner >= 0])
            rigid_slots.append(np.where(cable.owner >= 0, np.searchsorted(bodies, cable.owner), -1))
            inner = range(1, len(cable.owner) - 1) if cable.settings.friction else ()
            firsts = [start, *(start + point for point in inner)]
            first_points += firsts
            cable_of += [index] * len(firsts)
            self.soft_entries += [nodes] * len(firsts)
            self.rigid_entries += [bodies] * len(firsts)
            self.coordinate_start[index + 1] = len(cable_of)
        self.paths = kernels.CablePaths(
            point_start=starts.astype(np.int32),
            owner=_joined([cable.owner for cable in self.all], (0,), np.int32),
            nodes=stacked([cable.nodes for cable in self.all]).astype(np.int32),
            weights=stacked([cable.weights for cable in self.all]).astype(np.float64),
            slot=stacked([slot + 1 for slot in slots]).astype(np.int32) - 1,
            rigid_slot=_joined(rigid_slots, (0,), np.int32),
            cable=np.array(cable_of, dtype=np.int32),
            first_point=np.array(first_points, dtype=np.int32),
            friction=np.array([cable.settings.friction for cable in self.all]),
        )


def _joined(tables: Sequence[np.ndarray], empty: tuple[int, ...], kind: type) -> np.ndarray:
    return np.concatenate([np.zeros(empty), *tables]).astype(kind)


class CableShapes:
    """Where the cables run, how long they are, and how that changes with the bodies, at present positions."""

    def __init__(self, cables: Cables, buffers: ActuatorBuffers):
        from taichisoft.mechanics.kernels import actuator_coordinates as kernels

        point_count = len(cables.paths.owner)
        self._cables, self._buffers, self._kernel = cables, buffers, kernels.measure
        self._shapes = kernels.CableShapeArrays(
            place=cables.place.copy(),
            position=np.empty((point_count, 3)),
            both=np.empty((point_count, 3)),
            onward=np.zeros((point_count, 3)),
            length=buffers.value,
            grip=buffers.grip,
        )
        self._node_position = np.empty((buffers.node_count, 3))
        self._pulled_from_space = np.flatnonzero(cables.has_pull_point)
        self._pull_point_places = cables.paths.point_start[:-1][cables.has_pull_point]

    def update(self, poses: Poses, pull_point: np.ndarray) -> None:
        """Fill lengths [mm], gradients and grips for these bodies and pull points [mm], shape (cable_count, 3)."""
        self._shapes.place[self._pull_point_places] = pull_point[self._pulled_from_space]
        self._node_position[:] = poses.position
        self._kernel(
            self._buffers.first,
            self._cables.paths,
            self._buffers.coordinates,
            self._node_position,
            poses.rigid_position.copy(),
            matrices_from_quaternions(poses.rigid_rotation),
            self._shapes,
            self._buffers.gradient,
        )

    def coordinates(self) -> np.ndarray:
        """The coordinates where they were last measured [mm]: for a whole cable its length with a minus, which differs
        from how far it is pulled in by a constant; for an inner point the length beyond it; (coordinate_count,)."""
        paths, position = self._cables.paths, self._shapes.position
        segment = np.zeros(len(position))
        segment[1:] = np.linalg.norm(np.diff(position, axis=0), axis=1)
        along = np.cumsum(segment)
        first, last = paths.point_start[paths.cable], paths.point_start[paths.cable + 1] - 1
        beyond = along[last] - along[paths.first_point]
        return np.where(paths.first_point == first, -beyond, beyond)


CABLES = ActuatorKind(
    name="cable",
    plural="cables",
    effort=Drive(
        "tension",
        "mN",
        observed="cable_tensions",
        meaning="tension at the pulled end, mean of all cables",
        plotted="tension [mN]",
        metric="largest",
        digits=0,
        request="cable_tension",
        rate="tension_rate",
        step=100.0,
        furthest=10000.0,
        more="raise the tension",
        less="lower the tension",
    ),
    coordinate=Drive(
        "pull",
        "mm",
        observed="cable_pulls",
        meaning="how far cables are pulled in, mean of all",
        plotted="pulled in by [mm]",
        metric="largest",
        request="cable_pull",
        rate="pull_speed",
        step=1.0,
        furthest=1.0 / 3.0,
        relative=True,
        more="pull the cables in",
        less="pay the cables out",
    ),
    value=ActuatorFigure("cable_length", "mm", observed="cable_lengths", meaning="mean of all cables"),
    imposed="pull_imposed",
    loss="tension_loss",
    drawn="lines",
    make=lambda scene, soft, rigid, obstacles: Cables(list(scene.all_frames), soft, rigid, obstacles),
)
