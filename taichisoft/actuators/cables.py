"""Cables, driven by their tension or by how far they are pulled in: their lengths change with the bodies' motion."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from taichisoft.actuators.kind import ActuatorFigure, ActuatorKind, ActuatorSet, Drive, Room
from taichisoft.actuators.lines import Line
from taichisoft.bodies.body_geometry import Poses
from taichisoft.bodies.rotations import matrices_from_quaternions
from taichisoft.meshes.surface import stacked

if TYPE_CHECKING:
    from taichisoft.bodies.rigid_body_arrays import Obstacle, RigidBody
    from taichisoft.bodies.soft_body_arrays import SoftBody
    from taichisoft.scenes.scene import Scene


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
        """Find the points of all cables in the bodies, and which of the frames of these names carry pull points.

        Raises:
            MeshError: a file of points cannot be read.
            SceneError: a point lies outside its body, or two neighbouring points are the same.
        """
        from taichisoft.actuators.cable_points import make_cable

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

    def shapes(self, room: Room) -> "CableShapes":
        """What measures their lengths."""
        return CableShapes(self, room)

    def _lay_out(self) -> None:
        from taichisoft.actuators.kernels import polylines as kernels

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

    def __init__(self, cables: Cables, room: Room):
        """Take the arrays to write to."""
        from taichisoft.actuators.kernels import polylines as kernels

        point_count = len(cables.paths.owner)
        self._cables, self._room, self._kernel = cables, room, kernels.measure
        self._shapes = kernels.CableShapeArrays(
            place=cables.place.copy(),
            position=np.empty((point_count, 3)),
            both=np.empty((point_count, 3)),
            onward=np.zeros((point_count, 3)),
            length=room.value,
            grip=room.grip,
        )
        self._node_position = np.empty((room.node_count, 3))
        self._pulled_from_space = np.flatnonzero(cables.has_pull_point)
        self._pull_point_places = cables.paths.point_start[:-1][cables.has_pull_point]

    def update(self, poses: Poses, pull_point: np.ndarray) -> None:
        """Fill lengths [mm], gradients and grips for these bodies and pull points [mm], shape (cable_count, 3)."""
        self._shapes.place[self._pull_point_places] = pull_point[self._pulled_from_space]
        self._node_position[:] = poses.position
        self._kernel(
            self._room.first,
            self._cables.paths,
            self._room.coordinates,
            self._node_position,
            poses.rigid_position.copy(),
            matrices_from_quaternions(poses.rigid_rotation),
            self._shapes,
            self._room.gradient,
        )

    def coordinates(self) -> np.ndarray:
        """The coordinates where they were last measured [mm]: for a whole cable its length with a minus, which differs
        from how far it is pulled in by a constant; for an inner point the length beyond it; (coordinate_count,)."""
        paths, position = self._cables.paths, self._shapes.position
        way = np.zeros(len(position))
        way[1:] = np.linalg.norm(np.diff(position, axis=0), axis=1)
        along = np.cumsum(way)
        first, last = paths.point_start[paths.cable], paths.point_start[paths.cable + 1] - 1
        beyond = along[last] - along[paths.first_point]
        return np.where(paths.first_point == first, -beyond, beyond)


def _make(
    scene: "Scene", soft: "Sequence[SoftBody]", rigid: "Sequence[RigidBody]", obstacles: "Sequence[Obstacle]"
) -> Cables:
    return Cables(list(scene.all_frames), soft, rigid, obstacles)


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
        asked="cable_tension",
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
        asked="cable_pull",
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
    make=_make,
)
