"""Several collision surfaces of a soft body: which of them touch, and what the body then does to itself."""

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from blocks import make_block

from taichisoft import Model, Simulation, VolumeMesh, make_model, write_volume_mesh
from taichisoft.errors import MeshError, SceneError
from taichisoft.scene import scene_from_dict, scene_from_toml, scene_to_toml

EDGE, GAP = 10.0, 2.0
WEIGHT = 1e-6 * EDGE**3 * 9810.0


def two_cubes(folder: Path, groups: tuple[list[int], list[int]], gap: float = GAP) -> dict[str, Any]:
    """One soft body of two cubes, one above the other; the lower one is held. Each has a collision surface."""
    cube, rise = make_block((2, 2, 2), (EDGE, EDGE, EDGE)), np.array([0.0, 0.0, EDGE + gap])
    nodes, elements = np.vstack([cube.nodes, cube.nodes + rise]), np.vstack([cube.elements, cube.elements + 27])
    write_volume_mesh(VolumeMesh("", nodes, elements), folder / "cubes.msh")
    surfaces = []
    for name, place, some in zip(("lower", "upper"), (0.0 * rise, rise), groups, strict=True):
        box = trimesh.creation.box([EDGE, EDGE, EDGE])
        box.apply_translation(place)
        box.export(folder / f"{name}.stl")
        surfaces.append({"file": str(folder / f"{name}.stl"), "groups": some})
    return {
        "mesh": str(folder / "cubes.msh"),
        "element": "linear",
        "density": 1e-6,
        "young_modulus": 500.0,
        "poisson_ratio": 0.3,
        "rayleigh_stiffness": 0.01,
        "anchors": [{"box": [[-EDGE, -EDGE, -EDGE / 2], [EDGE, EDGE, -EDGE / 2]]}],
        "collision_surface": surfaces,
    }


def test_a_part_of_a_body_rests_on_another_part(tmp_path: Path) -> None:
    """Surfaces without a common group: the upper cube stays at the contact distance, and its weight is carried."""
    pair = ("cubes", "cubes")
    scene = {"soft_bodies": {"cubes": two_cubes(tmp_path, ([1], [2]))}, "contact": {"contact_distance": 0.5}}
    scene["contact"]["pairs"] = [{"bodies": list(pair), "friction": 0.1}]
    simulation = Simulation(scene_from_dict(scene))
    for _ in range(150):
        report = simulation.step()
        assert report.converged
    assert report.observation.normal_forces[pair] == pytest.approx(WEIGHT, rel=1e-6)
    assert report.observation.contact_counts[pair] >= 4
    assert simulation.model.friction.tolist() == [[0.1]]
    lower, upper = simulation.state.position[:27], simulation.state.position[27:]
    assert upper[:, 2].min() - lower[:, 2].max() == pytest.approx(0.5, abs=0.01)
    np.testing.assert_allclose(report.contact_forces.sum(axis=0), [0.0, 0.0, WEIGHT], atol=1e-4 * WEIGHT)


def test_what_has_a_group_in_common_passes_through(tmp_path: Path) -> None:
    """Free fall from rest: h^2 g n (n + 1) / 2 after n steps."""
    simulation = Simulation(scene_from_dict({"soft_bodies": {"cubes": two_cubes(tmp_path, ([1, 3], [2, 3]))}}))
    for _ in range(6):
        assert simulation.step().contact_count == 0
    fallen = (simulation.model.rest_position - simulation.state.position)[27:, 2]
    np.testing.assert_allclose(fallen, 1e-4 * 9810.0 * 21, rtol=1e-9)


def touching(model: Model) -> list[tuple[str, str]]:
    """Which surfaces can touch: bodies by name, with the numbers of their surfaces."""
    bodies = model.surfaces.topology.body.tolist()
    names = [f"{model.body_names[body]}{bodies[:place].count(body)}" for place, body in enumerate(bodies)]
    return [(names[first], names[second]) for first, second in model.surfaces.topology.pairs.tolist()]


def test_surfaces_with_a_common_group_do_not_touch_whosever_they_are(tmp_path: Path) -> None:
    """Groups count across bodies; what has none touches everything, and nothing touches itself."""
    left = two_cubes(tmp_path, ([1], [1, 2]))
    right = {**left, "translation": [100.0, 0.0, 0.0]}
    lower, upper = (surface["file"] for surface in left["collision_surface"])
    right["collision_surface"] = [{"file": lower, "groups": [2]}, {"file": upper}]
    ball = {"box": [5.0, 5.0, 5.0], "mass": 0.01, "position": [50.0, 0.0, 0.0]}
    made = make_model(scene_from_dict({"soft_bodies": {"left": left, "right": right}, "rigid_bodies": {"ball": ball}}))
    assert touching(made) == [
        ("left0", "right0"),
        ("left0", "right1"),
        ("left0", "ball0"),
        ("left1", "right1"),
        ("left1", "ball0"),
        ("right0", "right1"),
        ("right0", "ball0"),
        ("right1", "ball0"),
    ]


def test_a_body_with_several_surfaces_is_seen_as_one(tmp_path: Path) -> None:
    """All of them are in pictures and recordings, and the scene comes back equal from its text."""
    scene = scene_from_dict({"soft_bodies": {"cubes": two_cubes(tmp_path, ([1], [2]))}})
    assert scene_from_toml(scene_to_toml(scene), "text") == scene
    (body,) = make_model(scene).soft_bodies
    vertices = body.surface.positions(body.rest_position)
    assert vertices[:, 2].min() == -EDGE / 2 and vertices[:, 2].max() == pytest.approx(1.5 * EDGE + GAP)
    assert len(body.surface.triangles) == 24 and body.surface.triangles.max() == 15
    parts = [one.surface.positions(body.rest_position) for one in body.collision_surfaces]
    np.testing.assert_array_equal(vertices, np.vstack(parts))


def test_surfaces_of_a_body_that_overlap_are_refused_unless_they_do_not_touch(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"^collision surfaces of 'cubes' overlap at the start.* a group in common"):
        make_model(scene_from_dict({"soft_bodies": {"cubes": two_cubes(tmp_path, ([], []), gap=-3.0)}}))
    make_model(scene_from_dict({"soft_bodies": {"cubes": two_cubes(tmp_path, ([7], [7]), gap=-3.0)}}))


def test_a_body_that_does_not_collide_goes_through_all(tmp_path: Path) -> None:
    """Neither others nor a plane stop it: free fall."""
    body = {**two_cubes(tmp_path, ([1], [1])), "anchors": [], "collides": False}
    cube = {"box": [EDGE, EDGE, EDGE], "mass": 0.001}
    plane = {"plane": {"point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}}
    scene: dict[str, Any] = {"soft_bodies": {"cubes": body}, "rigid_bodies": {"cube": {**cube, "collides": False}}}
    simulation = Simulation(scene_from_dict({**scene, "obstacles": {"floor": plane}}))
    for _ in range(6):
        assert simulation.step().contact_count == 0
    fallen = -1e-4 * 9810.0 * 21
    assert simulation.state.rigid_position[0, 2] == pytest.approx(fallen, rel=1e-9)
    assert simulation.state.position[:27, 2].mean() == pytest.approx(fallen, rel=1e-9)
    scene["rigid_bodies"]["cube"] = cube
    assert touching(make_model(scene_from_dict(scene))) == []
    with pytest.raises(SceneError, match=r"^bodies 'cube' and 'floor' overlap at the start"):
        make_model(scene_from_dict({**scene, "obstacles": {"floor": plane}}))


def test_groups_of_rigid_bodies_and_obstacles_count_as_well(tmp_path: Path) -> None:
    soft = two_cubes(tmp_path, ([1], [2]))
    box = {"box": [EDGE, EDGE, EDGE], "mass": 0.001, "position": [50.0, 0.0, 0.0]}
    floor = {"surface": soft["collision_surface"][0]["file"], "translation": [0.0, 50.0, 0.0]}
    scene: dict[str, Any] = {"soft_bodies": {"cubes": soft}}
    scene["rigid_bodies"] = {"box": {**box, "groups": [1]}}
    scene["obstacles"] = {"floor": {**floor, "groups": [2]}}
    assert touching(make_model(scene_from_dict(scene))) == [
        ("cubes0", "cubes1"),
        ("cubes0", "floor0"),
        ("cubes1", "box0"),
        ("box0", "floor0"),
    ]


def test_an_open_surface_holds_what_is_on_the_side_that_it_faces(tmp_path: Path) -> None:
    """A cube lies on a soft block whose collision surface is its upper face alone."""
    block = make_block((4, 4, 2), (40.0, 40.0, 10.0))
    write_volume_mesh(block, tmp_path / "block.msh")
    sheet = trimesh.Trimesh(
        [[-20.0, -20.0, 5.0], [20.0, -20.0, 5.0], [20.0, 20.0, 5.0], [-20.0, 20.0, 5.0]], [[0, 1, 2], [0, 2, 3]]
    )
    sheet.export(tmp_path / "sheet.stl")
    surface = {"file": str(tmp_path / "sheet.stl"), "open": True}
    soft = {"mesh": str(tmp_path / "block.msh"), "density": 1e-6, "young_modulus": 500.0, "poisson_ratio": 0.3}
    soft |= {"rayleigh_stiffness": 0.01, "anchors": [{"box": [[-20.0, -20.0, -5.0], [20.0, 20.0, -5.0]]}]}
    cube = {"box": [EDGE, EDGE, EDGE], "density": 1e-6, "position": [1.0, 2.0, 11.5]}
    scene = {"soft_bodies": {"block": {**soft, "collision_surface": [surface]}}, "rigid_bodies": {"cube": cube}}
    simulation = Simulation(scene_from_dict({**scene, "contact": {"contact_distance": 0.5, "alarm_distance": 3.0}}))
    for _ in range(150):
        report = simulation.step()
    assert report.observation.normal_forces[("block", "cube")] == pytest.approx(WEIGHT, rel=1e-4)
    assert simulation.state.rigid_position[0, 2] == pytest.approx(10.5, abs=0.1)
    scene["soft_bodies"]["block"]["collision_surface"] = [{**surface, "open": False}]
    with pytest.raises(MeshError, match=r"sheet.stl: is not closed"):
        make_model(scene_from_dict(scene))


@pytest.mark.parametrize("apart", [1e-300, 1e-160])
def test_faces_without_an_area_and_edges_without_a_length_change_no_feature(tmp_path: Path, apart: float) -> None:
    """A corner of a box is two points without a distance, with faces between them; numpy warned, or found no axes."""
    box = trimesh.creation.box([EDGE, EDGE, EDGE])
    corners = np.array(box.vertices) + EDGE / 2
    face = next(index for index, one in enumerate(box.faces) if 0 in one)
    turned = np.roll(box.faces[face], -list(box.faces[face]).index(0))
    faces = [*np.delete(box.faces, face, axis=0), [8, turned[1], turned[2]], [0, turned[1], 8], [0, 8, turned[2]]]
    assert not corners[0].any()
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in [*corners.tolist(), [apart, 0.0, 0.0]]]
    (tmp_path / "box.obj").write_text("\n".join([*lines, *(f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces)]))
    body = {"surface": str(tmp_path / "box.obj"), "mass": 0.001, "position": [0.0, 0.0, 0.0]}
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        model = make_model(scene_from_dict({"rigid_bodies": {"box": body}}))
    assert model.surfaces.vertex_is_feature[:8].sum() == 8
