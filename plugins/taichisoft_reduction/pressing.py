"""Where a body is pressed in the training: obstacles in the way of its surface, at places spread over its pads."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from taichisoft.bodies import SoftBody
from taichisoft.meshes import MappedSurface
from taichisoft_reduction.actuator_ranges import Ranges
from taichisoft_reduction.excitations import AXES, PAUSE, RISE
from taichisoft_reduction.run_request import RunResult, Timetable

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
        way = end[vertex] - moved[vertex]
        normal = way / np.linalg.norm(way) if ramp is not None else _normals(moved, surface.triangles)[vertex]
        contact = moved[vertex], normal, radius, gap
        of_base = clearance(kind, start[held], *contact) if held.any() else np.inf
        is_free = clearance(kind, samples, *contact) > 0.0 and of_base > 2.0 * DRAG * size
        return _press(kind, *contact) if is_free else None

    # A groove, which not even a ball fits into, is no pad.
    for vertex in np.flatnonzero(pads).tolist():
        pads[vertex] = press(vertex, max(SHARES), "ball") is not None
    sets = [one for one in (pads & _any_node(surface, touched), pads) if one.any()]
    patches = (PRESSES if not unseen else UNSEEN_PRESSES) // max(1, len(sets))
    found = []
    for number, vertex in enumerate(vertex for one in sets for vertex in _spread(start, np.flatnonzero(one), patches)):
        first = SHARES[number % 2] if not unseen else UNSEEN_SHARE
        tries = (
            press(vertex, share, KINDS[(number + unseen + other) % len(KINDS)])
            for other in range(len(KINDS))
            for share in sorted({first, max(SHARES)})
        )
        found += [one for one in tries if one is not None][:1]
    return found[:1] if unseen else found


def press_timetable(ranges: Ranges, press: Press, size: float, level: float = 1.0) -> Timetable:
    """Press the body with its actuators, or with the base where it has none, and drag it along the obstacle."""
    normal = press.normal
    along = np.cross(normal, np.roll(np.eye(3)[np.argmax(np.abs(normal))], 1))
    along /= np.linalg.norm(along)
    across = np.cross(normal, along)
    drag = DRAG * size
    deep = np.zeros(3) if ranges else DEPTH * size * normal
    ways = [np.zeros(3), deep, deep + drag * along, deep - drag * along, deep + drag * across, deep - drag * across]
    times = (0.0, RISE, *(RISE + 0.5 * PAUSE * (1 + number) for number in range(len(ways) - 2)))
    channels = {f"{key}/{name}": (0.0, *(level * high,) * (len(ways) - 1)) for name, (key, _, high) in ranges.items()}
    for number, axis in enumerate(AXES):
        channels[f"base_translation/{axis}"] = tuple(float(way[number]) for way in ways)
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


def _any_node(surface: MappedSurface, some: np.ndarray) -> np.ndarray:
    """Whether one of the nodes that carry a vertex is among some, shape (node_count,)."""
    carried: np.ndarray = (some[surface.nodes] & (surface.weights != 0.0)).any(axis=1)
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


def _spread(points: np.ndarray, some: np.ndarray, count: int) -> list[int]:
    """Numbers of points near the middles of equal patches, of `some` of the points, shape (some_count,).

    Lloyd's algorithm from points that are far from each other.
    """
    own = points[some]
    middles = own[[int(np.linalg.norm(own - own.mean(axis=0), axis=1).argmax())]]
    while len(middles) < min(count, len(own)):
        farthest = np.linalg.norm(own[:, None] - middles, axis=2).min(axis=1).argmax()
        middles = np.vstack([middles, own[farthest]])
    for _ in range(10):
        patch = np.linalg.norm(own[:, None] - middles, axis=2).argmin(axis=1)
        middles = np.array([own[patch == number].mean(axis=0) for number in np.unique(patch)])
    return list(dict.fromkeys(int(some[np.linalg.norm(own - one, axis=1).argmin()]) for one in middles))
