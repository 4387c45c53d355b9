"""The runs of the training and of the validation of a scene."""

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation

from taichisoft import Scene
from taichisoft.errors import TaichisoftError
from taichisoft.mechanics import ACTUATOR_KINDS, UNLIMITED, Drive, SoftBody
from taichisoft.mesh import MappedSurface
from taichisoft.scene import scene_from_dict, scene_to_toml
from taichisoft_reduction.body_shapes import BodyShape, mesh_digest
from taichisoft_reduction.errors import ReductionError
from taichisoft_reduction.training_run import AXES, RunResult, Timetable, TrainingRun

if TYPE_CHECKING:
    from taichisoft import Model

# How far the actuators of a body are driven in the training.

BEYOND = 1.25
"""The training goes so far beyond what the scene's own run asks for."""

Ranges = Mapping[str, tuple[str, float, float]]
"""Key of `taichisoft.Control`, smallest and largest value of each actuator of the first body of a shape, by name."""


def actuator_ranges(
    model: "Model", shape: BodyShape, own_run: RunResult | None, given: Mapping[str, tuple[float, float]], full: bool
) -> Ranges:
    """The ranges of the first body's actuators, over all copies.

    Args:
        model: model of the scene.
        shape: the body and its copies.
        own_run: what the scene's own controller asks for; None without one.
        given: ranges that the user gives, by "body.actuator".
        full: whether to go to the scene's limits, and not only somewhat beyond the own run.
    """
    ranges = {}
    for kind in ACTUATOR_KINDS:
        for name in model.actuators.names_of(kind):
            if name.partition(".")[0] == shape.name:
                copies = [f"{body}.{name.partition('.')[2]}" for body in shape.bodies]
                ranges[name] = _range(model, copies, own_run, given, full, (kind.effort, kind.coordinate))
    return ranges


def _range(
    model: "Model",
    copies: Sequence[str],
    own_run: RunResult | None,
    given: Mapping[str, tuple[float, float]],
    full: bool,
    drives: tuple[Drive, Drive],
) -> tuple[str, float, float]:
    used = [own_run.drives[name] for name in copies if own_run is not None and name in own_run.drives]
    by_coordinate = any(key == drives[1].request for key, _, _ in used)
    drive = drives[by_coordinate]
    for name in copies:
        if name in given:
            return drive.request, *given[name]
    low, high = min((value for _, value, _ in used), default=0.0), max((value for _, _, value in used), default=0.0)
    limit_low, limit_high = _limits(model, copies[0], drive, by_coordinate)
    if (full or low == high) and math.isfinite(limit_high):
        return drive.request, min(0.0, limit_low) if math.isfinite(limit_low) else 0.0, limit_high
    if low == high:
        raise ReductionError(
            f"--range {copies[0]}=LOW:HIGH: needed, since neither the scene's own run drives '{copies[0]}' nor a limit "
            f"ends its {drive.words} [{drive.unit}]"
        )
    return drive.request, max(BEYOND * low, limit_low), min(BEYOND * high, limit_high)


def _limits(model: "Model", name: str, drive: Drive, by_coordinate: bool) -> tuple[float, float]:
    """Smallest and largest value that the actuator and the scene's limits allow; infinite where none is set."""
    number = model.actuators.names.index(name)
    ranges = model.actuators.coordinate_range if by_coordinate else model.actuators.effort_range
    low, high = (float(bound) for bound in ranges[number])
    limits = model.scene.limits
    scene_low, scene_high = (
        getattr(limits, f"lowest_{drive.name}", None),
        getattr(limits, f"highest_{drive.name}", None),
    )
    low = max(low, -np.inf if scene_low is None else scene_low)
    high = min(high, np.inf if scene_high is None else scene_high)
    return low if low > -UNLIMITED else -math.inf, high if high < UNLIMITED else math.inf


# Timetables that excite a body: ramps, steps and waves of its actuators, gravity and the motion of its base.

RISE = 0.8
"""Time of a ramp [s]."""
PAUSE = 0.4
"""Time in which a body settles [s]."""
FREQUENCY = 1.5
"""Of waves [Hz]."""
TURN = math.radians(40.0)
"""How far the base turns."""
FURTHER, HEAVIER = 1.6, 6.0
"""How far actuators, and gravity across, go beyond the training, over what they do in it."""

Channels = dict[str, tuple[float, ...]]


def excitations(ranges: Ranges, gravity: Sequence[float], shift: float) -> dict[str, Timetable]:
    """Timetables of the training by name.

    Args:
        ranges: ranges of the body's actuators.
        gravity: of the scene [mm/s^2], shape (3,).
        shift: how far the base moves [mm].
    """
    tables = {}
    if ranges:
        tables["ramp"] = ramp(ranges)
        tables["step"] = _step(ranges, 0.6)
        tables["wave"] = wave(ranges, FREQUENCY)
        if any(low < 0.0 for _, low, _ in ranges.values()):
            tables["suction"] = _lowest(ranges)
    if len(ranges) > 1:
        tables |= {f"alone-{_plain(name)}": ramp({name: limits}) for name, limits in ranges.items()}
        tables["out-of-step"] = wave(ranges, FREQUENCY, apart=True)
    tables |= {f"gravity-{number}": table for number, table in enumerate(_gravities(ranges, gravity))}
    for level in (0.0, 0.6) if ranges else (0.0,):
        tables[f"shaken-{level:g}"] = _moved(ranges, level, "base_translation", shift)
        tables[f"turned-{level:g}"] = _moved(ranges, level, "base_rotation", TURN)
    return tables


def unseen(ranges: Ranges, shift: float) -> dict[str, Timetable]:
    """Timetables of the validation by name: other frequencies, levels and directions than any of the training."""
    tables = {}
    if ranges:
        tables["unseen-wave"] = wave(ranges, 0.9, level=0.85, apart=len(ranges) > 1)
    times = np.linspace(0.0, 2.0, 81)
    channels = _constant_after_rise(ranges, 0.4, times)
    motion = np.sin(2.0 * math.pi * 1.1 * times) * np.minimum(1.0, times / 0.5)
    for axis, share in zip(AXES, (0.5, -0.35, 0.4), strict=True):
        channels[f"base_translation/{axis}"] = tuple((shift * share * motion).tolist())
        channels[f"base_rotation/{axis}"] = tuple((TURN * 0.5 * share * motion[::-1] * np.minimum(1.0, times)).tolist())
    tables["unseen-sway"] = Timetable(tuple(times.tolist()), channels)
    return tables


def ramp(ranges: Ranges, level: float = 1.0) -> Timetable:
    """Up to the largest values, and let go."""
    times = (0.0, RISE, RISE + PAUSE / 2, RISE + PAUSE / 2 + 1e-6, RISE + 2 * PAUSE)
    return Timetable(times, _channels(ranges, level, (0.0, 1.0, 1.0, 0.0, 0.0)))


def wave(ranges: Ranges, frequency: float, level: float = 1.0, apart: bool = False) -> Timetable:
    """Waves from 0 to `level` times the largest values; `apart`: each actuator at a frequency of its own."""
    times = np.linspace(0.0, 1.6, 65)
    channels: Channels = {}
    for number, (name, (key, _, high)) in enumerate(ranges.items()):
        own = frequency * (1.0 + 0.37 * number * apart)
        shape = 0.5 * (1.0 - np.cos(2.0 * math.pi * own * times))
        channels[f"{key}/{name}"] = tuple((level * high * shape).tolist())
    return Timetable(tuple(times.tolist()), channels)


def _step(ranges: Ranges, level: float) -> Timetable:
    return Timetable((0.0, 2.0 * PAUSE), _channels(ranges, level, (1.0, 1.0)))


def _lowest(ranges: Ranges) -> Timetable:
    lows = {name: (key, 0.0, low) for name, (key, low, _) in ranges.items() if low < 0.0}
    return Timetable((0.0, RISE, RISE + PAUSE), _channels(lows, 1.0, (0.0, 1.0, 1.0)))


def beyond(ranges: Ranges, gravity: Sequence[float]) -> dict[str, Timetable]:
    """Timetables far beyond those of the training, by which its errors there are estimated."""
    tables = {"beyond-ramp": ramp(ranges, FURTHER)} if ranges else {}
    heavy = _gravities(ranges, [HEAVIER * component for component in gravity])
    return tables | {f"beyond-gravity-{number}": table for number, table in enumerate(heavy) if number in (1, 3)}


def _gravities(ranges: Ranges, gravity: Sequence[float]) -> list[Timetable]:
    """Ramps under gravity in the other directions."""
    own = np.array(gravity)
    strength = float(np.linalg.norm(own))
    if strength == 0.0:
        return []
    first = np.cross(own, np.roll(np.eye(3)[np.argmax(np.abs(own))], 1))
    first *= strength / np.linalg.norm(first)
    second = np.cross(own, first) / strength
    times = (0.0, RISE, RISE + PAUSE)
    tables = []
    for direction in (-own, first, -first, second, -second):
        fixed: Channels = {
            f"gravity/{axis}": (value,) * 3 for axis, value in zip(AXES, direction.tolist(), strict=True)
        }
        tables.append(Timetable(times, {**_channels(ranges, 0.8, (0.0, 1.0, 1.0)), **fixed}))
    return tables


def _moved(ranges: Ranges, level: float, key: str, size: float) -> Timetable:
    """The base goes along, or turns about, each axis and comes back, one after the other."""
    times = np.linspace(0.0, PAUSE + 3 * 0.6, 89)
    channels = _constant_after_rise(ranges, level, times)
    for number, axis in enumerate(AXES):
        phase = np.clip((times - PAUSE - 0.6 * number) / 0.6, 0.0, 1.0)
        channels[f"{key}/{axis}"] = tuple((size * np.sin(2.0 * math.pi * phase)).tolist())
    return Timetable(tuple(times.tolist()), channels)


def _constant_after_rise(ranges: Ranges, level: float, times: np.ndarray) -> Channels:
    return _channels(ranges, level, tuple(np.minimum(1.0, times / PAUSE).tolist()))


def _channels(ranges: Ranges, level: float, shape: Sequence[float]) -> Channels:
    """The actuators' channels: the shape times their largest values."""
    return {f"{key}/{name}": tuple(level * high * share for share in shape) for name, (key, _, high) in ranges.items()}


def _plain(name: str) -> str:
    return name.partition(".")[2]


# Where a body is pressed in the training: obstacles in the way of its surface, at places spread over its pads.

KINDS = ("ball", "box", "cylinder", "plane")
PRESSES, UNSEEN_PRESSES = 10, 6
"""Places in the training; and in the validation, of which the first is taken."""
SHARES, UNSEEN_SHARE = (0.15, 0.45), 0.3
"""How far the actuators are when the body meets the obstacle; further where it would be in the way at rest."""
RADIUS = 0.1
"""Radius of what presses, as a share of the body's largest extent; boxes and cylinders are as thick as the ball."""
UNSEEN_RADIUS = 0.075
DRAG = 0.03
"""How far the base drags the pressed body along its surface, as a share of the body's largest extent."""
DEPTH = 0.04
"""How far the base presses a body that has no actuators, likewise."""
LEADING = 0.3
"""Share of the fastest advance that a place of the surface must have to be a pad."""


@dataclass(frozen=True)
class Press:
    """An obstacle, and the direction from the body into it.

    Attributes:
        obstacle: its table in a scene.
        normal: unit vector, shape (3,).
    """

    obstacle: Mapping[str, Any]
    normal: np.ndarray


def presses(body: SoftBody, ramp: RunResult | None, touched: np.ndarray, gap: float, unseen: bool) -> list[Press]:
    """Obstacles that touch the body when its actuators are at some share of their largest values.

    Args:
        body: the body at rest.
        ramp: result of the ramp of its actuators; None where it has none.
        touched: whether something pressed a node in the scene's own run, shape (node_count,).
        gap: distance between the obstacle and the body at that moment [mm].
        unseen: whether they are for the validation: one obstacle, of another size at another place than any other.
    """
    surface, path = body.surface, _path(body, ramp)
    end, start = surface.positions(path[-1]), surface.positions(path[0])
    held = _any_node(surface, body.anchored)
    pads = ~held
    if ramp is not None:
        normals = _normals(surface.positions(path[len(path) // 2]), surface.triangles)
        advance = np.einsum("vd,vd->v", end - start, normals)
        pads &= advance > LEADING * advance.max()
    size = float(np.ptp(body.rest_position, axis=0).max())
    radius = size * (RADIUS if not unseen else UNSEEN_RADIUS)
    samples = _samples(start, surface.triangles)

    def press(vertex: int, share: float, kind: str) -> Press | None:
        """What meets a vertex then; None where it would overlap the body at rest, or the base."""
        moved = surface.positions(path[int(share * (len(path) - 1))])
        motion = end[vertex] - moved[vertex]
        normal = motion / np.linalg.norm(motion) if ramp is not None else _normals(moved, surface.triangles)[vertex]
        contact = moved[vertex], normal, radius, gap
        of_base = clearance(kind, start[held], *contact) if held.any() else np.inf
        is_free = clearance(kind, samples, *contact) > 0.0 and of_base > 2.0 * DRAG * size
        return _press(kind, *contact) if is_free else None

    # A groove, which not even a ball fits into, is no pad.
    for vertex in np.flatnonzero(pads).tolist():
        pads[vertex] = press(vertex, max(SHARES), "ball") is not None
    sets = [vertices for vertices in (pads & _any_node(surface, touched), pads) if vertices.any()]
    patches = (PRESSES if not unseen else UNSEEN_PRESSES) // max(1, len(sets))
    result = []
    for number, vertex in enumerate(
        vertex for vertices in sets for vertex in _spread(start, np.flatnonzero(vertices), patches)
    ):
        first = SHARES[number % 2] if not unseen else UNSEEN_SHARE
        tries = (
            press(vertex, share, KINDS[(number + unseen + other) % len(KINDS)])
            for other in range(len(KINDS))
            for share in sorted({first, max(SHARES)})
        )
        result += [obstacle for obstacle in tries if obstacle is not None][:1]
    return result[:1] if unseen else result


def press_timetable(ranges: Ranges, press: Press, size: float, level: float = 1.0) -> Timetable:
    """Press the body with its actuators, or with the base where it has none, and drag it along the obstacle."""
    normal = press.normal
    along = np.cross(normal, np.roll(np.eye(3)[np.argmax(np.abs(normal))], 1))
    along /= np.linalg.norm(along)
    across = np.cross(normal, along)
    drag = DRAG * size
    deep = np.zeros(3) if ranges else DEPTH * size * normal
    shifts = [np.zeros(3), deep, deep + drag * along, deep - drag * along, deep + drag * across, deep - drag * across]
    times = (0.0, RISE, *(RISE + 0.5 * PAUSE * (1 + number) for number in range(len(shifts) - 2)))
    channels = {f"{key}/{name}": (0.0, *(level * high,) * (len(shifts) - 1)) for name, (key, _, high) in ranges.items()}
    for number, axis in enumerate(AXES):
        channels[f"base_translation/{axis}"] = tuple(float(shift[number]) for shift in shifts)
    return Timetable(times, channels)


def clearance(kind: str, points: np.ndarray, place: np.ndarray, normal: np.ndarray, radius: float, gap: float) -> float:
    """Least distance [mm] of points, shape (count, 3), from what presses at `place`; the arguments as for `_press`."""
    turn = _turn(normal)
    if kind == "plane":
        return float((-(points - place) @ normal).min() + gap)
    local = (points - place - (radius + gap) * normal) @ turn
    if kind == "ball":
        return float(np.linalg.norm(local, axis=1).min() - radius)
    if kind == "cylinder":  # its axis is the x axis of the turned frame, see `_press`
        outside = np.column_stack([np.hypot(local[:, 1], local[:, 2]) - radius, np.abs(local[:, 0]) - 2.0 * radius])
    else:
        outside = np.abs(local) - radius
    return float(np.linalg.norm(np.maximum(outside, 0.0), axis=1).min() + min(0.0, outside.max(axis=1).min()))


def _press(kind: str, place: np.ndarray, normal: np.ndarray, radius: float, gap: float) -> Press:
    """An obstacle that touches a place of the surface [mm], shape (3,), on its outer side, up to `gap`."""
    turn = _turn(normal)
    centre = (place + (radius + gap) * normal).tolist()
    if kind == "plane":
        point = (place + gap * normal).tolist()
        return Press({"plane": {"point": point, "normal": (-normal).tolist()}}, normal)
    if kind == "ball":
        return Press({"sphere": {"radius": radius}, "translation": centre}, normal)
    shape: dict[str, Any] = {"box": [2.0 * radius] * 3}
    if kind == "cylinder":
        shape = {"cylinder": {"radius": radius, "length": 4.0 * radius}}
        turn = turn[:, [1, 2, 0]]  # its axis z along the surface
    angles = Rotation.from_matrix(turn).as_euler("xyz", degrees=True).tolist()
    return Press({**shape, "rotation": angles, "translation": centre}, normal)


def _turn(normal: np.ndarray) -> np.ndarray:
    """A rotation whose z axis is the normal."""
    first = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    first /= np.linalg.norm(first)
    return np.column_stack([first, np.cross(normal, first), normal])


def _path(body: SoftBody, ramp: RunResult | None) -> np.ndarray:
    """Placed positions [mm] from rest to the largest values of the actuators, shape (count, node_count, 3)."""
    if ramp is None or not len(ramp.time):
        return np.repeat(body.rest_position[None], 3, axis=0)
    turn = Rotation.from_euler("xyz", body.settings.rotation, degrees=True).as_matrix()
    rising = ramp.displacement[body.name][ramp.time <= RISE].astype(np.float64)
    return np.concatenate([body.rest_position[None], body.rest_position + rising @ turn.T])


def _any_node(surface: MappedSurface, nodes: np.ndarray) -> np.ndarray:
    """Whether one of the nodes that carry a vertex is among some, shape (node_count,)."""
    carried: np.ndarray = (nodes[surface.nodes] & (surface.weights != 0.0)).any(axis=1)
    return carried


def _normals(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Outward unit normals of a closed surface at its vertices, shape (vertex_count, 3)."""
    corners = vertices[triangles]
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sums = np.zeros_like(vertices)
    for column in range(3):
        np.add.at(sums, triangles[:, column], areas)
    lengths = np.linalg.norm(sums, axis=1, keepdims=True)
    return np.divide(sums, lengths, out=np.zeros_like(sums), where=lengths > 0.0)


def _samples(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Points of a surface: vertices, and on every triangle points a quarter of its sides apart, shape (count, 3)."""
    shares = np.array([(i, j, 4 - i - j) for i in range(5) for j in range(5 - i)]) / 4.0
    return np.concatenate([vertices, np.einsum("sk,tkd->std", shares, vertices[triangles]).reshape(-1, 3)])


def _spread(points: np.ndarray, chosen: np.ndarray, count: int) -> list[int]:
    """Numbers of points near the middles of equal patches, of `some` of the points, shape (some_count,).

    Lloyd's algorithm from points that are far from each other.
    """
    own = points[chosen]
    middles = own[[int(np.linalg.norm(own - own.mean(axis=0), axis=1).argmax())]]
    while len(middles) < min(count, len(own)):
        farthest = np.linalg.norm(own[:, None] - middles, axis=2).min(axis=1).argmax()
        middles = np.vstack([middles, own[farthest]])
    for _ in range(10):
        patch = np.linalg.norm(own[:, None] - middles, axis=2).argmin(axis=1)
        middles = np.array([own[patch == number].mean(axis=0) for number in np.unique(patch)])
    return list(dict.fromkeys(int(chosen[np.linalg.norm(own - middle, axis=1).argmin()]) for middle in middles))


OWN_RUN = "own-run"
OWN_INSTANTS = 120
"""Instants that are kept of a run of the validation."""
STRONGER = 1.2
"""Factor on what the scene's own controller asks for, in the training."""
SHIFT = 0.15
"""How far the base is shaken, as a share of the body's largest extent."""
SOLID = ("surface", "scale", "smooth", "box", "sphere", "cylinder", "capsule", "inertia", "centre_of_mass", "density")
"""Keys of a rigid body that say what it is made of."""


class TrainingPlan:
    """Makes the requests for the runs of a scene.

    Attributes:
        model: the model of the scene.
        shapes: the soft bodies that are reduced.
    """

    def __init__(self, scene: Scene, model: "Model", shapes: Sequence[BodyShape], plugins: Sequence[str]):
        """Plan for a scene; `plugins` are paths of the plug-ins that it needs."""
        self.model, self.shapes = model, shapes
        self._scene = scene
        self._tables = scene.model_dump(exclude_none=True)
        self._common: dict[str, Any] = {"plugins": tuple(plugins), "files": mesh_digest(model.soft_bodies)}
        self._all_bodies = tuple(name for shape in shapes for name in shape.bodies)
        self._bodies = {body.name: body for body in model.soft_bodies}

    def own_runs(self) -> list[TrainingRun]:
        """The scene's own run, for the validation; none without a controller."""
        return [self._own(OWN_RUN, self._scene, instants=OWN_INSTANTS)] if self._scene.controller is not None else []

    def grasps(self, own_training: bool) -> list[TrainingRun]:
        """Further runs of the scene's controller for the validation and, if wanted, the training."""
        return [*(self._grasps() if own_training else []), *self._unseen_grasps()]

    def first_runs(self, ranges: Mapping[str, Ranges]) -> list[TrainingRun]:
        """Ramps of each shape, by which the places to press are found."""
        return [self._alone(shape, "ramp", ramp(own)) for shape in self.shapes if (own := ranges[shape.name])]

    def training(
        self, ranges: Mapping[str, Ranges], ramps: Mapping[str, RunResult], own: Sequence[RunResult]
    ) -> list[TrainingRun]:
        """All runs of the training, those of `first_runs` first."""
        runs = self.first_runs(ranges)
        for shape in self.shapes:
            tables = excitations(ranges[shape.name], self._scene.gravity, self._shift(shape))
            runs += [self._alone(shape, name, table) for name, table in tables.items() if name != "ramp"]
            runs += self._presses(shape, ranges[shape.name], ramps.get(shape.name), own, False)
        return runs + self._grasps()

    def validation(
        self, ranges: Mapping[str, Ranges], ramps: Mapping[str, RunResult], own: Sequence[RunResult]
    ) -> list[TrainingRun]:
        """Runs that are not trained on: the scene's own first, if it has a controller."""
        runs = self.own_runs()
        for shape in self.shapes:
            tables = unseen(ranges[shape.name], self._shift(shape))
            runs += [self._alone(shape, name, table, OWN_INSTANTS) for name, table in tables.items()]
            runs += self._presses(shape, ranges[shape.name], ramps.get(shape.name), own, True)
        return runs + self._unseen_grasps()

    def beyond(self, ranges: Mapping[str, Ranges]) -> list[TrainingRun]:
        """Runs far beyond the training, in which reduced bodies are expected to err."""
        tables = {shape: beyond(ranges[shape.name], self._scene.gravity) for shape in self.shapes}
        return [
            self._alone(shape, *table, OWN_INSTANTS) for shape, by_name in tables.items() for table in by_name.items()
        ]

    def _grasps(self) -> list[TrainingRun]:
        """The scene's own run with other efforts, and with other objects in the place of its own."""
        if self._scene.controller is None:
            return []
        objects: Mapping[str, Callable[[np.ndarray], dict[str, Any]]] = {
            "ball": lambda size: {"sphere": {"radius": 0.5 * float(size.min())}},
            "cylinder": lambda size: {
                "cylinder": {"radius": 0.5 * float(min(size[:2])), "length": float(size[2])},
            },
        }
        runs = [self._own("own-stronger", self._scene, factor=STRONGER)]
        for name, make in objects.items():
            runs += [self._own(f"grasp-{name}", scene) for scene in self._with_object(make)]
        return runs

    def _unseen_grasps(self) -> list[TrainingRun]:
        return [
            self._own("unseen-grasp", scene, instants=OWN_INSTANTS)
            for scene in self._with_object(lambda size: {"box": (0.93 * size).tolist()})
        ]

    def _with_object(self, make: Callable[[np.ndarray], dict[str, Any]]) -> list[Scene]:
        """The scene with another shape, made of the extents [mm], in the place of its main object, if it has one."""
        name = self._scene.main_object
        rigid = next((body for body in self.model.rigid_bodies if body.name == name), None)
        if rigid is None or name is None:
            return []
        table = {key: value for key, value in self._tables["rigid_bodies"][name].items() if key not in SOLID}
        table |= make(np.ptp(rigid.vertices, axis=0))
        table |= {"mass": rigid.mass, "position": rigid.start_position.tolist()}
        return self._valid({**self._tables, "rigid_bodies": {**self._tables["rigid_bodies"], name: table}})

    def _presses(
        self, shape: BodyShape, ranges: Ranges, ramp: RunResult | None, own: Sequence[RunResult], is_unseen: bool
    ) -> list[TrainingRun]:
        body = self._bodies[shape.name]
        if not body.settings.collides:
            return []
        touched = np.zeros(len(body.rest_position), bool)
        for result, name in itertools.product(own, shape.bodies):
            if name in result.touched:
                touched |= result.touched[name]
        size = self._size(shape)
        gap = self._scene.contact.contact_distance
        runs = []
        for number, press in enumerate(presses(body, ramp, touched, gap, is_unseen)):
            table = press_timetable(ranges, press, size, 1.0 if not is_unseen else 0.8)
            name = f"press-{number}" if not is_unseen else "unseen-press"
            for scene in self._valid({**self._alone_tables(shape), "obstacles": {"press": press.obstacle}}):
                runs.append(
                    self._request(
                        f"{shape.name}-{name}", scene, (shape.name,), table, OWN_INSTANTS if is_unseen else 24
                    )
                )
        return runs

    def _alone(self, shape: BodyShape, name: str, table: Timetable, instants: int = 24) -> TrainingRun:
        """A run of the first body of a shape alone, or with all soft bodies where it cannot be alone."""
        scenes = self._valid(self._alone_tables(shape)) or self._valid(self._without(self._tables, "obstacles"))
        scene = scenes[0] if scenes else self._scene
        return self._request(f"{shape.name}-{name}", scene, (shape.name,), table, instants)

    def _alone_tables(self, shape: BodyShape) -> dict[str, Any]:
        tables = self._without(self._tables, "obstacles", "rigid_bodies", "goal", "external_forces")
        tables["soft_bodies"] = {shape.name: self._tables["soft_bodies"][shape.name]}
        tables["contact"] = {key: value for key, value in self._tables["contact"].items() if key != "pairs"}
        return tables

    @staticmethod
    def _without(tables: Mapping[str, Any], *keys: str) -> dict[str, Any]:
        return {key: value for key, value in tables.items() if key not in (*keys, "controller")}

    @staticmethod
    def _valid(tables: Mapping[str, Any]) -> list[Scene]:
        """The scene of these tables; none where it is not valid, such as that of a cable whose other body is gone."""
        try:
            return [scene_from_dict(tables)]
        except TaichisoftError:
            return []

    def _own(self, name: str, scene: Scene, factor: float = 1.0, instants: int = 40) -> TrainingRun:
        return TrainingRun(
            name,
            scene_to_toml(scene),
            self._all_bodies,
            scene.time.duration,
            factor=factor,
            instants=instants,
            **self._common,
        )

    def _request(
        self, name: str, scene: Scene, bodies: tuple[str, ...], table: Timetable, instants: int
    ) -> TrainingRun:
        duration = max(scene.time.step, round(table.duration / scene.time.step) * scene.time.step)
        return TrainingRun(name, scene_to_toml(scene), bodies, duration, table, instants=instants, **self._common)

    def _size(self, shape: BodyShape) -> float:
        return float(np.ptp(self._bodies[shape.name].rest_position, axis=0).max())

    def _shift(self, shape: BodyShape) -> float:
        return SHIFT * self._size(shape)
