"""Contact detection where surfaces have slipped through each other: how deep, and which way out."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from blocks import make_block

from taichisoft import Model, Simulation, make_model, write_volume_mesh
from taichisoft.contact import ContactDetection, MovingSurfaces
from taichisoft.contact.kernels.contacts import Contacts
from taichisoft.scene import scene_from_dict

FAR = 500.0


def surfaces_at(model: Model, positions: list[list[float]]) -> MovingSurfaces:
    """The surfaces with the rigid bodies' centres there, none of them turned."""
    surfaces = MovingSurfaces(model.surfaces)
    surfaces.update(model.rest_position, np.array(positions, dtype=float), np.tile(np.eye(3), (len(positions), 1, 1)))
    return surfaces


def pairs_at(model: Model, positions: list[list[float]], depth: float = 5.0) -> Contacts:
    """The contacts of these surfaces."""
    return ContactDetection(model.surfaces, surfaces_at(model, positions)).find(5.0, depth).trimmed()


@pytest.fixture(scope="module")
def boxes() -> Model:
    """A large and a small box, far apart at the start."""
    bodies = {"large": {"box": [40, 30, 20], "mass": 1}, "small": {"box": [4, 4, 4], "mass": 1}}
    bodies["small"]["position"] = [FAR, 0, 0]
    return make_model(scene_from_dict({"rigid_bodies": bodies}))


@pytest.mark.parametrize("depth", [0.0, 1e-6, 0.5, 1.9])
@pytest.mark.parametrize(("axis", "half"), [(0, 20), (1, 15), (2, 10)])
@pytest.mark.parametrize("side", [-1, 1])
def test_corners_inside_a_box_leave_by_the_nearest_face(
    boxes: Model, depth: float, axis: int, half: float, side: int
) -> None:
    """Four corners of the small box are `depth` under a face of the large one: distance -depth, normal the face's."""
    centre = np.array([3.0, 2.0, 1.0])
    centre[axis] = side * (half + 2 - depth)
    pairs = pairs_at(boxes, [[0, 0, 0], centre.tolist()])
    outward = np.zeros(3)
    outward[axis] = side
    deepest = pairs.distance < pairs.distance.min() + 1e-9
    assert deepest.sum() == 4
    np.testing.assert_allclose(pairs.distance[deepest], -depth, atol=1e-9)
    np.testing.assert_allclose(pairs.normal[deepest], np.tile(outward, (4, 1)), atol=1e-7)


def test_deeper_than_the_depth_is_not_a_contact(boxes: Model) -> None:
    """A small box in the middle of the large one, its corners 8 mm under the nearest faces."""
    assert pairs_at(boxes, [[0, 0, 0], [0, 0, 0]], depth=5.0).count[0] == 0
    pairs = pairs_at(boxes, [[0, 0, 0], [0, 0, 0]], depth=20.0)
    np.testing.assert_allclose(pairs.distance[pairs.distance < 0], -8.0, atol=1e-9)


def test_points_in_a_ball(tmp_path: Path) -> None:
    """Vertices of a small ball in a large one: the distance to a convex surface from inside is that to the nearest
    plane of a face, max over faces of n . (p - a), negative. Tolerance: round-off."""
    large = trimesh.creation.icosphere(subdivisions=2, radius=20.0)
    small = trimesh.creation.icosphere(subdivisions=1, radius=6.0)
    bodies = {}
    for name, ball in (("large", large), ("small", small)):
        ball.export(tmp_path / f"{name}.obj", digits=17)
        bodies[name] = {"surface": str(tmp_path / f"{name}.obj"), "mass": 1}
    bodies["small"]["position"] = [FAR, 0, 0]
    model = make_model(scene_from_dict({"rigid_bodies": bodies}))
    positions = [[0, 0, 0], [11.0, 12.0, 7.0]]
    pairs = pairs_at(model, positions, depth=20.0)
    points = surfaces_at(model, positions).moved.position[slice(*model.surfaces.vertex_range[1])]
    heights = np.einsum("fd,pfd->pf", large.face_normals, points[:, None] - large.triangles[:, 0])
    expected = heights.max(axis=1)
    inside = np.flatnonzero(expected < -1e-6)
    assert 3 < len(inside) < len(points)
    of_vertex = pairs.weights[:, 1, 0] == 1.0
    found = {int(v): d for v, d in zip(pairs.vertices[of_vertex, 1, 0], pairs.distance[of_vertex], strict=True)}
    first = int(model.surfaces.vertex_range[1, 0])
    np.testing.assert_allclose([found[first + int(v)] for v in inside], expected[inside], atol=1e-9)


def test_edges_that_have_slipped_through_keep_their_normal() -> None:
    """Two bars on edge, crossing, 0.5 mm into each other: one edge contact of -0.5 mm, along their common normal."""
    reach = 10 / np.sqrt(2)
    bodies = {
        "low": {"box": [60, 10, 10], "mass": 1, "rotation": [45, 0, 0]},
        "high": {"box": [10, 60, 10], "mass": 1, "rotation": [0, 45, 0], "position": [0, 0, FAR]},
    }
    simulation = Simulation(scene_from_dict({"gravity": [0, 0, 0], "rigid_bodies": bodies}))
    for overlap in (-0.5, 0.5):
        position = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 2 * reach - overlap]])
        simulation.state = replace(simulation.state, rigid_position=position, rigid_velocity=np.zeros((2, 3)))
        report = simulation.step()
        assert report.contact_count == 1
        assert report.max_penetration == pytest.approx(1.0 + overlap)
        np.testing.assert_allclose(report.contact_points, [[0, 0, reach - overlap / 2]], atol=1e-9)
        np.testing.assert_allclose(simulation.state.contact_normal, [[0, 0, 1]], atol=1e-9)
        apart = simulation.state.rigid_position[1] - simulation.state.rigid_position[0]
        np.testing.assert_allclose(apart, [0, 0, 2 * reach + 1.0], atol=1e-6)
        simulation = Simulation(simulation.model)


def test_a_floor_pushes_up_however_deep(tmp_path: Path) -> None:
    """A plane is solid all the way down: every vertex below it touches, with its depth and the plane's normal."""
    write_volume_mesh(make_block((1, 1, 1), (10.0, 10.0, 10.0)), tmp_path / "block.msh")
    body = {"mesh": str(tmp_path / "block.msh"), "mass": 1, "young_modulus": 100, "poisson_ratio": 0.3}
    floor = {"plane": {"point": [0, 0, -20], "normal": [0, 0, 2]}}
    model = make_model(scene_from_dict({"soft_bodies": {"block": body}, "obstacles": {"floor": floor}}))
    surfaces = MovingSurfaces(model.surfaces)
    surfaces.update(model.rest_position - [0, 0, 100], np.zeros((0, 3)), np.zeros((0, 3, 3)))
    pairs = ContactDetection(model.surfaces, surfaces).find(5.0, 5.0).trimmed()
    np.testing.assert_allclose(np.sort(pairs.distance), [-85.0] * 4 + [-75.0] * 4, rtol=1e-12)
    np.testing.assert_array_equal(pairs.normal, np.tile([0, 0, -1.0], (8, 1)))
