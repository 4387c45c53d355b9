"""Contact detection against brute force: distances of bodies outside each other.

The least distance of two bodies is that of a vertex and a triangle or of two edges, whichever is least; computed
here by trimesh and by a textbook formula for every pair.
"""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from taichisoft import Model, Simulation, make_model
from taichisoft.contact import ContactDetection, MovingSurfaces
from taichisoft.contact.detection import ContactReduction, ContactTable
from taichisoft.contact.kernels.contacts import Contacts
from taichisoft.scene import scene_from_dict

REACH = 5.0


def two_bodies(folder: Path, first: trimesh.Trimesh, second: trimesh.Trimesh) -> Model:
    """Rigid bodies of two surfaces, whose vertices are in world axes."""
    bodies = {}
    for name, surface in (("first", first), ("second", second)):
        surface.export(folder / f"{name}.obj", digits=17)
        bodies[name] = {"surface": str(folder / f"{name}.obj"), "mass": 1.0}
    return make_model(scene_from_dict({"rigid_bodies": bodies}))


def find(model: Model, reach: float = REACH, depth: float = REACH) -> Contacts:
    """The contacts at the start of the scene, after checking what holds for every one."""
    poses = np.array([body.start_position for body in model.rigid_bodies])
    moving = MovingSurfaces(model.surfaces)
    moving.update(model.rest_position, poses, np.tile(np.eye(3), (len(poses), 1, 1)))
    pairs = ContactDetection(model.surfaces, moving).find(reach, depth).trimmed()
    apart = pairs.points[:, 1] - pairs.points[:, 0]
    np.testing.assert_allclose(np.linalg.norm(apart, axis=1), np.abs(pairs.distance), atol=1e-9)
    np.testing.assert_allclose(apart, pairs.distance[:, None] * pairs.normal, atol=1e-7)
    np.testing.assert_allclose(np.linalg.norm(pairs.normal, axis=1), 1.0, rtol=1e-9)
    np.testing.assert_allclose(pairs.weights.sum(axis=2), 1.0, rtol=1e-12)
    assert (pairs.weights >= 0.0).all()
    assert (pairs.distance < reach).all()
    return pairs


def segment_distance(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Distance of inner points of segments a-b and c-d where they cross over each other, infinite elsewhere."""
    along, other, gap = b - a, d - c, c - a
    normal = np.cross(along, other)
    size = (normal**2).sum(axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        s = (np.cross(gap, other) * normal).sum(axis=-1) / size
        t = (np.cross(gap, along) * normal).sum(axis=-1) / size
        distance = np.abs((gap * normal).sum(axis=-1)) / np.sqrt(size)
    crossing = (size > 1e-12) & (s > 0) & (s < 1) & (t > 0) & (t < 1)
    return np.where(crossing, distance, np.inf)


def least_distance(first: trimesh.Trimesh, second: trimesh.Trimesh) -> float:
    """Of two surfaces that do not overlap."""
    least = np.inf
    for points, other in ((first.vertices, second), (second.vertices, first)):
        corners = np.repeat(other.triangles, len(points), axis=0)
        repeated = np.tile(points, (len(other.triangles), 1))
        nearest = trimesh.triangles.closest_point(corners, repeated)
        least = min(least, np.linalg.norm(nearest - repeated, axis=1).min())
    a, b = (first.vertices[first.edges_unique[:, k]][:, None] for k in (0, 1))
    c, d = (second.vertices[second.edges_unique[:, k]][None] for k in (0, 1))
    return float(min(least, segment_distance(a, b, c, d).min()))


def turned_box(random: np.random.Generator, centre: np.ndarray) -> trimesh.Trimesh:
    box = trimesh.creation.box(extents=random.uniform(5, 20, 3))
    turn = Rotation.random(rng=random).as_matrix()
    return trimesh.Trimesh(box.vertices @ turn.T + centre, box.faces, process=False)


@pytest.mark.parametrize("seed", range(20))
def test_the_least_distance_of_two_boxes(seed: int, tmp_path: Path) -> None:
    """Turned at random, 0.5 to 4 mm apart: corners, edges and faces in every combination. Tolerance: round-off."""
    random = np.random.default_rng(seed)
    first, second = turned_box(random, np.zeros(3)), turned_box(random, np.array([60.0, 0.0, 0.0]))
    gap = least_distance(first, second)
    for _ in range(60):  # a convex body moved along one axis: the distance grows with the shift
        second.vertices -= [gap * 0.7 if gap > 4.0 else 0.0, 0.0, 0.0]
        gap = least_distance(first, second)
    pairs = find(two_bodies(tmp_path, first, second))
    assert pairs.distance.min() == pytest.approx(gap, abs=1e-9)
    assert 0.5 < gap <= 4.0


def test_the_least_distance_of_a_ball_and_a_box(tmp_path: Path) -> None:
    """A fine, curved surface against a coarse one; and every local minimum found is one of the ball's vertices."""
    ball = trimesh.creation.icosphere(subdivisions=3, radius=10.0)
    ball.vertices = ball.vertices @ Rotation.from_rotvec([0.3, 0.2, 0.1]).as_matrix().T
    box = trimesh.creation.box(extents=[30, 30, 10])
    box.vertices += [1.0, 2.0, 17.0]
    pairs = find(two_bodies(tmp_path, ball, box))
    assert pairs.distance.min() == pytest.approx(least_distance(ball, box), abs=1e-9)
    near_the_pole = ball.vertices[12.0 - ball.vertices[:, 2] < REACH]
    assert pairs.count[0] == len(near_the_pole)


def test_nothing_is_found_beyond_the_reach(tmp_path: Path) -> None:
    first, second = trimesh.creation.box(extents=[10, 10, 10]), trimesh.creation.box(extents=[8, 8, 8])
    second.vertices += [0, 0, 5 + 4 + REACH + 1e-6]
    assert find(two_bodies(tmp_path, first, second)).count[0] == 0
    second.vertices -= [0, 0, 2e-6]
    assert find(two_bodies(tmp_path, first, second)).count[0] == 4


def first_choice(model: Model, size: list[float], spacing: float) -> tuple[Contacts, np.ndarray]:
    """All contacts, and which of them are added first of all, the closest being the worst."""
    pairs, reduction = find(model), ContactReduction(np.array(size), spacing, contact_distance=1.0)
    table = ContactTable.with_room(pairs, np.ones(len(pairs.distance)))
    reduction.begin(table, model.initial_state())
    assert reduction.add(table, np.ones(pairs.count[0], dtype=bool), pairs.distance, beside=True)
    return pairs, table.is_chosen


def test_of_close_contacts_the_closest_is_added_first(tmp_path: Path) -> None:
    """No two contacts that are added are closer than the spacing, and each one left out has a closer neighbour."""
    ball = trimesh.creation.icosphere(subdivisions=3, radius=10.0)
    box = trimesh.creation.box(extents=[30, 30, 10])
    box.vertices += [0.0, 0.0, 16.0]
    pairs, added = first_choice(two_bodies(tmp_path, ball, box), [20.0, np.inf], spacing=4.0)
    assert 0 < added.sum() < pairs.count[0]
    all_middles = pairs.points.mean(axis=1)
    middle = all_middles[added]
    apart = np.linalg.norm(middle[:, None] - middle, axis=2) + 1e3 * np.eye(added.sum())
    assert apart.min() >= 4.0
    near = np.linalg.norm(all_middles[:, None] - middle, axis=2) < 4.0
    assert (near & (pairs.distance[added] <= pairs.distance[:, None])).any(axis=1).all()


def test_a_small_body_gets_contacts_that_lie_close_together(tmp_path: Path) -> None:
    """A box of 6 mm stands on four corners; a spacing of 9 mm is bounded by a fifth of the box."""
    small, large = trimesh.creation.box(extents=[6, 6, 6]), trimesh.creation.box(extents=[40, 40, 10])
    small.vertices += [0, 0, 9]
    model = two_bodies(tmp_path, small, large)
    for size, added_count in (([6.0, 10.0], 4), ([60.0, 60.0], 1)):
        pairs, added = first_choice(model, size, spacing=9.0)
        assert pairs.count[0] == 4
        assert added.sum() == added_count


@pytest.mark.parametrize("sections", [64, 400])
def test_a_finely_triangulated_body_keeps_features(sections: int, tmp_path: Path) -> None:
    """Its faces turn by less than a degree from one to the next; it must stand on the floor all the same."""
    trimesh.creation.cylinder(radius=10.0, height=20.0, sections=sections).export(tmp_path / "cylinder.stl")
    body = {"surface": str(tmp_path / "cylinder.stl"), "mass": 0.01, "position": [0.0, 0.0, 12.0]}
    floor = {"plane": {"point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}}
    simulation = Simulation(scene_from_dict({"rigid_bodies": {"cylinder": body}, "obstacles": {"floor": floor}}))
    for _ in range(50):
        report = simulation.step()
        assert report.converged
    assert simulation.state.rigid_position[0, 2] == pytest.approx(11.0, abs=1e-3)
    assert report.observation.normal_forces["cylinder", "floor"] == pytest.approx(98.1, rel=1e-3)
    assert 8 <= report.contact_count <= 40
