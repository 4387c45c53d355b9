"""The trees of boxes: they hold what they should, and finding contacts through them misses none."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from blocks import make_block
from conftest import examples
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from taichisoft import Model, make_model, write_volume_mesh
from taichisoft.contact import ContactDetection, MovingSurfaces, detection, surfaces
from taichisoft.contact.kernels.contacts import Contacts
from taichisoft.contact.surfaces import LEAF_TRIANGLES, most_leaves
from taichisoft.runtime.language import STATIC
from taichisoft.scene import scene_from_dict

ALL = 10**6  # triangles in a leaf: one box around each body
FAR = 200.0  # [mm] apart at the start
BALL_RADIUS, RING_RADIUS = 12.0, 20.0  # [mm]


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> dict[int, Model]:
    """Bodies of all kinds, by the number of triangles in a leaf of their trees."""
    folder = tmp_path_factory.mktemp("surfaces")
    x, y = np.meshgrid(np.arange(-20.0, 21.0, 2.0), np.arange(-20.0, 21.0, 2.0))
    at = np.arange(x.size).reshape(x.shape)
    halves = [at[:-1, :-1], at[:-1, 1:], at[1:, 1:]], [at[:-1, :-1], at[1:, 1:], at[1:, :-1]]
    corners = np.column_stack([x.ravel(), y.ravel(), 3.0 * np.sin(0.2 * (x + 0.5 * y)).ravel()])
    sheet = trimesh.Trimesh(corners, np.vstack([np.stack(half, axis=-1).reshape(-1, 3) for half in halves]))
    sheet.export(folder / "sheet.obj", digits=17)
    trimesh.creation.icosphere(subdivisions=2, radius=BALL_RADIUS).export(folder / "ball.obj", digits=17)
    trimesh.creation.torus(RING_RADIUS, 4.0).export(folder / "ring.obj", digits=17)
    write_volume_mesh(make_block((4, 4, 4), (20.0, 20.0, 20.0)), folder / "block.msh")
    soft = {"mesh": str(folder / "block.msh"), "mass": 1, "young_modulus": 100, "poisson_ratio": 0.3}
    soft["translation"] = [0, 0, FAR]
    scene = scene_from_dict(
        {
            "soft_bodies": {"block": soft},
            "rigid_bodies": {
                "ball": {"surface": str(folder / "ball.obj"), "mass": 1, "position": [FAR, 0, 0]},
                "ring": {"surface": str(folder / "ring.obj"), "mass": 1, "position": [0, FAR, 0]},
                "die": {"box": [2, 2, 2], "mass": 1, "position": [0, 0, 2 * FAR]},
                "peg": {"box": [1, 1, 3], "mass": 1, "position": [FAR, FAR, 0]},
            },
            "obstacles": {
                "sheet": {"surface": str(folder / "sheet.obj")},
                "floor": {"plane": {"point": [0, 0, -20], "normal": [0.1, 0.2, 1]}},
            },
        }
    )
    models = {}
    with pytest.MonkeyPatch.context() as patch:
        for leaf_triangles in (LEAF_TRIANGLES, 1, ALL):
            patch.setattr(surfaces, "LEAF_TRIANGLES", leaf_triangles)
            models[leaf_triangles] = make_model(scene)
    return models


def place(model: Model, seed: int, spread: float) -> MovingSurfaces:
    """Surfaces of bodies turned at random, about `spread` [mm] from each other, the soft one deformed."""
    random = np.random.default_rng(seed)
    nodes = (model.rest_position - model.rest_position.mean(axis=0)) @ Rotation.random(rng=random).as_matrix().T
    nodes += random.normal(scale=0.3, size=nodes.shape) + spread * random.normal(size=3)
    positions = spread * random.normal(size=(4, 3))
    moving = MovingSurfaces(model.surfaces)
    moving.update(nodes, positions, Rotation.random(4, rng=random).as_matrix())
    return moving


@examples(50)
@given(seed=st.integers(0, 10**6), spread=st.floats(1.0, 40.0), reach=st.floats(0.0, 10.0), depth=st.floats(0.0, 30.0))
def test_the_contacts_are_those_of_every_feature_against_every_other(
    models: dict[int, Model], seed: int, spread: float, reach: float, depth: float
) -> None:
    """In the same order and bit for bit: the same features go through the same arithmetic."""
    found = {}
    for leaf_triangles, model in models.items():
        moving = place(model, seed, spread)
        found[leaf_triangles] = ContactDetection(model.surfaces, moving).find(reach, depth).trimmed()
    for field in Contacts._fields:
        of_brute_force = getattr(found[ALL], field)
        for leaf_triangles in (LEAF_TRIANGLES, 1):
            np.testing.assert_array_equal(getattr(found[leaf_triangles], field), of_brute_force)


def test_the_room_for_contacts_grows(models: dict[int, Model], monkeypatch: pytest.MonkeyPatch) -> None:
    model = models[LEAF_TRIANGLES]
    moving = place(model, 3, 5.0)
    expected = ContactDetection(model.surfaces, moving).find(5.0, 5.0).trimmed()
    assert expected.count[0] > 20
    monkeypatch.setattr(detection, "FIRST_CAPACITY", 4)
    with_little_room = ContactDetection(model.surfaces, moving)
    for _ in range(2):
        for field, of_enough_room in zip(with_little_room.find(5.0, 5.0).trimmed(), expected, strict=True):
            np.testing.assert_array_equal(field, of_enough_room)


def test_what_moves_in_one_simulation_stays_where_it_is_in_another(models: dict[int, Model]) -> None:
    """Contacts found in turns are those found alone."""
    surfaces = models[LEAF_TRIANGLES].surfaces
    places = [place(models[LEAF_TRIANGLES], seed, 5.0) for seed in (3, 4)]
    detections = [ContactDetection(surfaces, moving) for moving in places]
    found = [one.find(5.0, 5.0) for one in detections]
    alone = [one.trimmed() for one in found]
    assert alone[0].count[0] != alone[1].count[0]
    detections[1].find(1.0, 5.0)
    for field, expected in zip(found[0].trimmed(), alone[0], strict=True):
        np.testing.assert_array_equal(field, expected)
    for field, expected in zip(detections[0].find(5.0, 5.0).trimmed(), alone[0], strict=True):
        np.testing.assert_array_equal(field, expected)


@examples(30)
@given(seed=st.integers(0, 10**6), spread=st.floats(1.0, 40.0), reach=st.floats(0.0, 10.0))
def test_the_contacts_with_a_plane_are_all_vertices_near_it(
    models: dict[int, Model], seed: int, spread: float, reach: float
) -> None:
    model = models[LEAF_TRIANGLES]
    surfaces, moving = model.surfaces, place(model, seed, spread)
    height = (moving.moved.position - surfaces.planes.point[0]) @ surfaces.planes.normal[0]
    expected = np.flatnonzero((height < reach) & surfaces.vertex_is_feature & (surfaces.carriers.owner != STATIC))
    pairs = ContactDetection(surfaces, moving).find(reach, 0.0).trimmed()
    on_plane = pairs.bodies[:, 1] == surfaces.planes.body[0]
    np.testing.assert_array_equal(np.sort(pairs.vertices[on_plane, 0, 0]), expected)


@examples(30)
@given(seed=st.integers(0, 10**6))
def test_every_box_is_that_of_the_triangles_below_it(models: dict[int, Model], seed: int) -> None:
    """Down to the leaves, after the vertices have moved: no box is too small, and none larger than it need be."""
    model = models[LEAF_TRIANGLES]
    moved, surfaces, trees = place(model, seed, 20.0).moved, model.surfaces, model.surfaces.trees
    for node, behind in enumerate(trees.escape):
        below = trees.triangle[trees.triangle_start[node] : trees.triangle_start[behind]]
        corners = moved.position[surfaces.topology.triangles[below]].reshape(-1, 3)
        np.testing.assert_array_equal(moved.lower[node], corners.min(axis=0))
        np.testing.assert_array_equal(moved.upper[node], corners.max(axis=0))


def test_every_feature_belongs_to_one_leaf_that_holds_it(models: dict[int, Model]) -> None:
    surfaces = models[LEAF_TRIANGLES].surfaces
    topology, trees = surfaces.topology, surfaces.trees
    np.testing.assert_array_equal(np.sort(trees.triangle), np.arange(len(topology.triangles)))
    np.testing.assert_array_equal(np.sort(trees.vertex), np.flatnonzero(surfaces.vertex_is_feature))
    np.testing.assert_array_equal(np.sort(trees.edge), np.flatnonzero(surfaces.edge_is_feature))
    for node, behind in enumerate(trees.escape):
        triangles, vertices, edges = (
            members[start[node] : start[node + 1]]
            for start, members in (
                (trees.triangle_start, trees.triangle),
                (trees.vertex_start, trees.vertex),
                (trees.edge_start, trees.edge),
            )
        )
        if behind == node + 1:
            assert 0 < len(triangles) <= LEAF_TRIANGLES
        else:
            assert len(triangles) == len(vertices) == len(edges) == 0
        corners = topology.triangles[triangles]
        assert np.isin(vertices, corners).all()
        assert np.isin(topology.edges[edges], corners).all()


def test_trees_are_shallow(tmp_path: Path) -> None:
    """A search goes down no further than some log2 of the number of leaves."""
    trimesh.creation.icosphere(subdivisions=4).export(tmp_path / "ball.obj", digits=17)
    model = make_model(scene_from_dict({"rigid_bodies": {"ball": {"surface": str(tmp_path / "ball.obj"), "mass": 1}}}))
    trees = model.surfaces.trees
    depth = np.zeros(len(trees.escape), dtype=int)
    for node, behind in enumerate(trees.escape):
        if behind > node + 1:
            depth[[node + 1, trees.escape[node + 1]]] = depth[node] + 1
    leaves = most_leaves(trees)
    assert leaves == (np.diff(trees.triangle_start) > 0).sum()
    assert leaves <= len(model.surfaces.topology.triangles) / LEAF_TRIANGLES + 1
    assert depth.max() <= np.log2(leaves) + 2
