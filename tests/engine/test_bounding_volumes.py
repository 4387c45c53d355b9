"""The trees of boxes: they hold what they should, and finding contacts through them misses none."""

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
import trimesh
from conftest import examples, make_block
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from taichisoft.building.simulation import make_model
from taichisoft.contact import bounding_volumes
from taichisoft.contact.bounding_volumes import LEAF_TRIANGLES
from taichisoft.contact.detection import ContactPairs
from taichisoft.kernels.runtime import STATIC
from taichisoft.meshes.files import write_volume_mesh
from taichisoft.model import Model
from taichisoft.scenes.file import scene_from_dict

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
            patch.setattr(bounding_volumes, "LEAF_TRIANGLES", leaf_triangles)
            models[leaf_triangles] = make_model(scene)
    return models


def place(model: Model, seed: int, spread: float) -> None:
    """Bodies turned at random, about `spread` [mm] from each other, the soft one deformed."""
    random = np.random.default_rng(seed)
    nodes = (model.rest_position - model.rest_position.mean(axis=0)) @ Rotation.random(rng=random).as_matrix().T
    nodes += random.normal(scale=0.3, size=nodes.shape) + spread * random.normal(size=3)
    positions = spread * random.normal(size=(4, 3))
    model.surfaces.update(nodes, positions, Rotation.random(4, rng=random).as_matrix())


@examples(200)
@given(seed=st.integers(0, 10**6), spread=st.floats(1.0, 40.0), reach=st.floats(0.0, 10.0), depth=st.floats(0.0, 30.0))
def test_the_contacts_are_those_of_every_feature_against_every_other(
    models: dict[int, Model], seed: int, spread: float, reach: float, depth: float
) -> None:
    """In the same order and bit for bit: the same features go through the same arithmetic."""
    found = {}
    for leaf_triangles, model in models.items():
        place(model, seed, spread)
        found[leaf_triangles] = model.detection.find(reach, depth)
    for field in fields(ContactPairs):
        of_brute_force = getattr(found[ALL], field.name)
        for leaf_triangles in (LEAF_TRIANGLES, 1):
            np.testing.assert_array_equal(getattr(found[leaf_triangles], field.name), of_brute_force)


@examples(30)
@given(seed=st.integers(0, 10**6), spread=st.floats(1.0, 40.0), reach=st.floats(0.0, 10.0))
def test_the_contacts_with_a_plane_are_all_vertices_near_it(
    models: dict[int, Model], seed: int, spread: float, reach: float
) -> None:
    model = models[LEAF_TRIANGLES]
    place(model, seed, spread)
    surfaces = model.surfaces
    height = (surfaces.position - surfaces.plane_point[0]) @ surfaces.plane_normal[0]
    expected = np.flatnonzero((height < reach) & (surfaces.vertex_is_feature == 1) & (surfaces.vertex_owner != STATIC))
    pairs = model.detection.find(reach, 0.0)
    on_plane = pairs.bodies[:, 1] == surfaces.plane_body[0]
    np.testing.assert_array_equal(np.sort(pairs.vertices[on_plane, 0, 0]), expected)


@examples(30)
@given(seed=st.integers(0, 10**6))
def test_every_box_is_that_of_the_triangles_below_it(models: dict[int, Model], seed: int) -> None:
    """Down to the leaves, after the vertices have moved: no box is too small, and none larger than it need be."""
    model = models[LEAF_TRIANGLES]
    place(model, seed, 20.0)
    surfaces, volumes = model.surfaces, model.surfaces.volumes
    for node, behind in enumerate(volumes.escape):
        below = volumes.triangle[volumes.triangle_start[node] : volumes.triangle_start[behind]]
        corners = surfaces.position[surfaces.triangles[below]].reshape(-1, 3)
        np.testing.assert_array_equal(volumes.lower[node], corners.min(axis=0))
        np.testing.assert_array_equal(volumes.upper[node], corners.max(axis=0))


def test_every_feature_belongs_to_one_leaf_that_holds_it(models: dict[int, Model]) -> None:
    surfaces, volumes = models[LEAF_TRIANGLES].surfaces, models[LEAF_TRIANGLES].surfaces.volumes
    np.testing.assert_array_equal(np.sort(volumes.triangle), np.arange(len(surfaces.triangles)))
    np.testing.assert_array_equal(np.sort(volumes.vertex), np.flatnonzero(surfaces.vertex_is_feature))
    np.testing.assert_array_equal(np.sort(volumes.edge), np.flatnonzero(surfaces.edge_is_feature))
    for node, behind in enumerate(volumes.escape):
        triangles, vertices, edges = (
            members[start[node] : start[node + 1]]
            for start, members in (
                (volumes.triangle_start, volumes.triangle),
                (volumes.vertex_start, volumes.vertex),
                (volumes.edge_start, volumes.edge),
            )
        )
        if behind == node + 1:
            assert 0 < len(triangles) <= LEAF_TRIANGLES
        else:
            assert len(triangles) == len(vertices) == len(edges) == 0
        corners = surfaces.triangles[triangles]
        assert np.isin(vertices, corners).all()
        assert np.isin(surfaces.edges[edges], corners).all()


def test_trees_are_shallow(tmp_path: Path) -> None:
    """A search goes down no further than some log2 of the number of leaves."""
    trimesh.creation.icosphere(subdivisions=4).export(tmp_path / "ball.obj", digits=17)
    model = make_model(scene_from_dict({"rigid_bodies": {"ball": {"surface": str(tmp_path / "ball.obj"), "mass": 1}}}))
    volumes = model.surfaces.volumes
    depth = np.zeros(len(volumes.escape), dtype=int)
    for node, behind in enumerate(volumes.escape):
        if behind > node + 1:
            depth[[node + 1, volumes.escape[node + 1]]] = depth[node] + 1
    leaves = volumes.most_leaves
    assert leaves == (np.diff(volumes.triangle_start) > 0).sum()
    assert leaves <= len(model.surfaces.triangles) / LEAF_TRIANGLES + 1
    assert depth.max() <= np.log2(leaves) + 2
