"""Distances of spheres, capsules and cylinders against brute force, and against other ways to the same answer."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from taichisoft import Model, make_model
from taichisoft.contact import ContactDetection, MovingSurfaces
from taichisoft.contact.kernels.contacts import Contacts
from taichisoft.scene import scene_from_dict

SHAPES: dict[str, dict[str, Any]] = {
    "sphere": {"sphere": {"radius": 8.0}},
    "capsule": {"capsule": {"radius": 4.0, "length": 15.0}},
    "cylinder": {"cylinder": {"radius": 6.0, "length": 14.0}},
    "coin": {"cylinder": {"radius": 9.0, "length": 2.0}},
}
BOX = {"box": [18.0, 12.0, 9.0]}
REACH = 400.0  # everything is near

turns = st.tuples(*[st.floats(-math.pi, math.pi)] * 3)
places = st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda place: np.linalg.norm(place) > 0.1)


def distance_from(table: dict[str, Any], points: np.ndarray) -> np.ndarray:
    """Signed distances of points [mm], shape (count, 3), from a shape or box about the origin: textbook formulas."""
    along, beside = np.abs(points[:, 2]), np.linalg.norm(points[:, :2], axis=1)
    if "sphere" in table:
        return np.linalg.norm(points, axis=1) - table["sphere"]["radius"]
    if "capsule" in table:
        beyond = np.maximum(along - 0.5 * table["capsule"]["length"], 0.0)
        return np.hypot(beside, beyond) - table["capsule"]["radius"]
    if "box" in table:
        over = np.abs(points) - 0.5 * np.array(table["box"])
    else:
        over = np.column_stack([beside - table["cylinder"]["radius"], along - 0.5 * table["cylinder"]["length"]])
    return np.linalg.norm(np.maximum(over, 0.0), axis=1) + np.minimum(over.max(axis=1), 0.0)


def model_of(*bodies: dict[str, Any], **tables: Any) -> Model:
    """Bodies far apart, to be placed by `find`."""
    rigid = {
        f"body{number}": {**body, "mass": 1.0, "position": [200.0 * number, 0.0, 100.0]}
        for number, body in enumerate(bodies)
    }
    return make_model(scene_from_dict({"rigid_bodies": rigid, **tables}))


MODELS: dict[str, Model] = {}


def cached(name: str, *bodies: dict[str, Any], **tables: Any) -> Model:
    """Models are made once: hypothesis asks for them again and again."""
    if name not in MODELS:
        MODELS[name] = model_of(*bodies, **tables)
    return MODELS[name]


def find(model: Model, positions: Any, rotations: Any, reach: float = REACH) -> Contacts:
    """Contacts of bodies with these poses, after checking what holds for every one."""
    turned = np.array([np.asarray(turn, dtype=float).reshape(3, 3) for turn in rotations])
    moving = MovingSurfaces(model.surfaces)
    moving.update(model.rest_position, np.array(positions, dtype=float), turned)
    pairs = ContactDetection(model.surfaces, moving).find(reach, 50.0).trimmed()
    apart = pairs.points[:, 1] - pairs.points[:, 0]
    np.testing.assert_allclose(apart, pairs.distance[:, None] * pairs.normal, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(pairs.normal, axis=1), 1.0, rtol=1e-9)
    assert (pairs.bodies[:, 0] < pairs.bodies[:, 1]).all()
    on_surface = (pairs.vertices >= 0).all(axis=2)
    np.testing.assert_allclose(pairs.weights[on_surface].sum(axis=-1), 1.0, rtol=1e-12)
    assert (pairs.weights >= 0.0).all()
    return pairs


def projection(table: dict[str, Any], points: np.ndarray) -> np.ndarray:
    """Nearest points of a solid about the origin to points [mm], shape (count, 3): textbook formulas."""
    if "box" in table:
        half = 0.5 * np.array(table["box"])
        return np.clip(points, -half, half)
    kind = next(iter(table.values()))
    half = 0.5 * kind.get("length", 0.0)
    on_axis = np.column_stack([np.zeros((len(points), 2)), np.clip(points[:, 2], -half, half)])
    away = points - on_axis
    if "cylinder" in table:
        on_axis[:, 2], away[:, 2] = 0.0, 0.0
    length = np.linalg.norm(away, axis=1, keepdims=True)
    nearest = on_axis + away * np.minimum(1.0, kind["radius"] / np.maximum(length, 1e-300))
    if "cylinder" in table:
        nearest[:, 2] = np.clip(points[:, 2], -half, half)
    return nearest


def least_distances(first: dict[str, Any], second: dict[str, Any], turn: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Of solids `second`, turned (count, 3, 3) and shifted (count, 3), from the solid `first`: projected gradients.

    The squared distance of two points of two convex solids has one minimum; Nesterov's momentum, begun anew where it
    leads uphill (O'Donoghue and Candes 2015), finds it without knowing anything of contact.
    """
    x, y = np.zeros_like(place), place.copy()
    ahead_x, ahead_y, momentum = x, y, np.ones((len(place), 1))
    for _ in range(4000):
        middle = 0.5 * (ahead_x + ahead_y)
        next_x = projection(first, middle)
        local = projection(second, np.einsum("nji,nj->ni", turn, middle - place))
        next_y = np.einsum("nij,nj->ni", turn, local) + place
        uphill = ((ahead_x - next_x) * (next_x - x) + (ahead_y - next_y) * (next_y - y)).sum(axis=1) > 0.0
        momentum[uphill] = 1.0
        following = 0.5 * (1.0 + np.sqrt(1.0 + 4.0 * momentum**2))
        share = (momentum - 1.0) / following
        ahead_x, ahead_y = next_x + share * (next_x - x), next_y + share * (next_y - y)
        x, y, momentum = next_x, next_y, following
    return np.linalg.norm(x - y, axis=1)


PAIRS = [
    ("sphere", "box"), ("capsule", "box"), ("cylinder", "box"), ("coin", "box"),
    ("sphere", "sphere"), ("sphere", "capsule"), ("sphere", "cylinder"), ("sphere", "coin"),
    ("capsule", "capsule"), ("capsule", "cylinder"), ("capsule", "coin"),
    ("cylinder", "cylinder"), ("cylinder", "coin"), ("coin", "coin"),
]  # fmt: skip


@pytest.mark.parametrize(("first", "second"), PAIRS)
def test_the_least_distance(first: str, second: str) -> None:
    """Of solids turned and placed at random, less than a body apart, in either order, to the accuracy of the projected
    gradients."""
    tables = {**SHAPES, "box": BOX}
    random = np.random.default_rng(3)
    turn = Rotation.random(100, rng=random).as_matrix()
    place = random.normal(size=(100, 3))
    place *= random.uniform(10.0, 30.0, (100, 1)) / np.linalg.norm(place, axis=1, keepdims=True)
    expected = least_distances(tables[first], tables[second], turn, place)
    apart = np.flatnonzero(expected > 0.01)
    assert len(apart) > 40
    for order in (1, -1):
        model = cached(f"{first} {second} {order}", *(tables[name] for name in (first, second)[::order]))
        for k in apart:
            found = find(model, [np.zeros(3), place[k]][::order], [np.eye(3), turn[k]][::order])
            assert found.distance.min() == pytest.approx(expected[k], abs=2e-6), (k, order)


@pytest.mark.parametrize("name", SHAPES)
@settings(max_examples=60, deadline=None)
@given(turn=turns, normal=places, height=st.floats(-3.0, 4.0))
def test_a_plane(name: str, turn: tuple[float, ...], normal: tuple[float, ...], height: float) -> None:
    """The lowest point of the shape, at its true depth; its arm ends on the shape's own surface.

    A rim that is level to 5e-4 mm stands on 16 points, which miss its lowest one by 2 % of that.
    """
    up = np.array([0.0, 0.0, 1.0])
    model = cached(
        f"{name} on a plane", SHAPES[name], obstacles={"floor": {"plane": {"point": [0, 0, 0], "normal": [0, 0, 1]}}}
    )
    rotation = Rotation.from_rotvec(turn).as_matrix()
    down = rotation.T @ -up
    table = SHAPES[name]
    if "cylinder" in table:
        lowest = table["cylinder"]["radius"] * np.hypot(down[0], down[1]) + 0.5 * table["cylinder"]["length"] * abs(
            down[2]
        )
    else:
        kind = next(iter(table.values()))
        lowest = kind["radius"] + 0.5 * kind.get("length", 0.0) * abs(down[2])
    place = np.array([normal[0], normal[1], lowest + height])
    pairs = find(model, [place], [rotation], reach=5.0)
    assert pairs.distance.min() == pytest.approx(height, abs=1e-5)
    np.testing.assert_allclose(pairs.normal, np.tile(-up, (len(pairs.normal), 1)), atol=1e-12)
    local = (pairs.points[:, 0] - place) @ rotation
    assert (distance_from(table, local) < 1e-9).all()  # points of the body
    np.testing.assert_allclose(distance_from(table, local)[pairs.distance.argmin()], 0.0, atol=1e-9)
