"""What does not fit its meshes, or cannot be started, is refused before anything is simulated."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from blocks import make_block

from taichisoft import Model, VolumeMesh, make_model, write_volume_mesh
from taichisoft.errors import MeshError, SceneError
from taichisoft.mesh import enclosed_volume
from taichisoft.scene import scene_from_dict


@pytest.fixture
def hollow(block: Callable[..., str]) -> dict[str, Any]:
    """The table of a hollow block of 20 mm about the origin."""
    mesh = block((3, 3, 3), (20.0, 20.0, 20.0), hollow=True)
    return {"mesh": mesh, "mass": 0.01, "young_modulus": 500, "poisson_ratio": 0.3}


def model(body: dict[str, Any], **tables: Any) -> Model:
    return make_model(scene_from_dict({"soft_bodies": {"block": body}, **tables}))


NOWHERE = {"box": [[50, 0, 0], [60, 1, 1]]}


@pytest.mark.parametrize(
    ("changes", "key", "hint"),
    [
        ({"anchors": [NOWHERE]}, "anchors.0.box = ", "selects no node of .* span .*-10.0, -10.0, -10.0. to"),
        ({"regions": [{**NOWHERE, "young_modulus": 1}]}, "regions.0.box = ", "selects no element of .* span .*-8.333"),
        ({"anchors": [{"nodes": [7, 64, 3]}]}, "anchors.0.nodes names node 64", r"block.* has nodes 0 to 63$"),
        ({"tip": {"nodes": [1, 2, 640]}}, "tip.nodes names node 640", r"block.* has nodes 0 to 63$"),
        ({"anchors": [{"group": "base"}]}, "anchors.0.group = 'base': ", "there are: cavity"),
        ({"regions": [{"group": "stiff", "young_modulus": 1}]}, "regions.0.group = 'stiff': ", "there are: none"),
        ({"cavities": {"air": {"group": "room"}}}, "cavities.air.group = 'room': ", "there are: cavity"),
    ],
)
def test_selections_that_select_nothing(hollow: dict[str, Any], changes: dict[str, Any], key: str, hint: str) -> None:
    """With what there is: the span of the nodes, or the names of the groups."""
    with pytest.raises(SceneError, match=hint) as refused:
        model({**hollow, **changes})
    assert str(refused.value).startswith(f"soft_bodies.block.{key}")


def test_anchors_and_tips_by_the_numbers_of_their_nodes(hollow: dict[str, Any]) -> None:
    """A node named is a node held, in whatever order the numbers stand, and its neighbours are not."""
    anchors = [{"nodes": [7, 0, 5], "stiffness": 2.0}, {"nodes": [60]}]
    (body,) = model({**hollow, "anchors": anchors, "tip": {"nodes": [9, 3, 20]}}).soft_bodies
    np.testing.assert_array_equal(np.flatnonzero(body.anchored), [0, 5, 7, 60])
    np.testing.assert_array_equal(body.anchor_stiffness[[0, 5, 7, 60]], np.tile([[2.0], [2.0], [2.0], [1e12]], 3))
    np.testing.assert_array_equal(body.tip_nodes, [3, 9, 20])


def cavity_file(folder: Path, surface: trimesh.Trimesh) -> dict[str, Any]:
    surface.export(folder / "cavity.stl")
    return {"cavities": {"air": {"surface": str(folder / "cavity.stl")}}}


def test_a_cavity_of_a_file_has_its_volume(hollow: dict[str, Any], tmp_path: Path) -> None:
    """Embedded in the material, not made of its nodes; 8 mm^3 to the single precision of STL."""
    box = trimesh.creation.box(extents=[2, 2, 2])
    box.vertices += [8, 8, 8]
    made = model({**hollow, **cavity_file(tmp_path, box)})
    assert made.cavities.rest_value[0] == pytest.approx(8.0, rel=1e-6)


def test_a_cavity_with_a_hole_is_refused(hollow: dict[str, Any], tmp_path: Path) -> None:
    box = trimesh.creation.box(extents=[2, 2, 2])
    box.update_faces(np.arange(1, 12))
    with pytest.raises(MeshError, match=r"cavity\.stl: is not closed: \d+ edges"):
        model({**hollow, **cavity_file(tmp_path, box)})


def test_a_cavity_inside_out_is_turned_round_with_a_warning(hollow: dict[str, Any], tmp_path: Path) -> None:
    box = trimesh.creation.box(extents=[2, 2, 2])
    box.vertices += [8, 8, 8]
    box.invert()
    with pytest.warns(UserWarning, match=r"cavity\.stl: is inside out"):
        made = model({**hollow, **cavity_file(tmp_path, box)})
    assert made.cavities.rest_value[0] == pytest.approx(8.0, rel=1e-6)


def test_a_cavity_outside_its_body_is_refused_with_a_vertex(hollow: dict[str, Any], tmp_path: Path) -> None:
    """Whoever takes another finger's cavity, or metres for millimetres, must be told."""
    box = trimesh.creation.box(extents=[2, 2, 2])
    box.vertices += [0, 0, 30]
    with pytest.raises(MeshError, match=r"cavity\.stl: vertex \d+ at \[.*\] mm lies outside the body .*\.msh"):
        model({**hollow, **cavity_file(tmp_path, box)})


def test_points_outside_a_body_follow_it_where_the_scene_says_so(hollow: dict[str, Any], tmp_path: Path) -> None:
    """Extrapolated from the element with the nearest centroid: as the body is sheared, so is what lies outside."""
    box = trimesh.creation.box(extents=[2, 2, 2])
    box.vertices += [0, 0, 30]
    made = model({**hollow, **cavity_file(tmp_path, box), "points_outside": "extrapolated"})
    (cavity,) = made.soft_bodies[0].cavities
    shear = np.array([[1.0, 0.5, 0.0], [0.0, 1.0, 0.2], [0.0, 0.0, 1.0]])
    moved = cavity.surface.positions(made.rest_position @ shear.T)
    assert moved == pytest.approx(cavity.surface.positions(made.rest_position) @ shear.T)
    assert moved[:, 2].min() > 20.0


def test_a_surface_in_a_hollow_of_its_body_is_refused_with_a_vertex(hollow: dict[str, Any], tmp_path: Path) -> None:
    """It lies in the body's box, but in no element, nor near one; the hollow is 6.7 mm wide, its elements as large."""
    box = trimesh.creation.box(extents=[2, 2, 2])
    with pytest.raises(MeshError, match=r"cavity\.stl: vertex \d+ at \[.*\] mm lies outside .*\.msh .* mm\); give the"):
        model({**hollow, **cavity_file(tmp_path, box)})


@pytest.mark.parametrize(
    ("tables", "names"),
    [
        ({"rigid_bodies": {"cube": {"box": [10, 10, 10], "mass": 1, "position": [12, 3, 2]}}}, ("block", "cube")),
        ({"obstacles": {"floor": {"plane": {"point": [0, 0, -9], "normal": [0, 0, 1]}}}}, ("block", "floor")),
    ],
)
def test_bodies_that_overlap_at_the_start_are_refused(
    hollow: dict[str, Any], tables: dict[str, Any], names: tuple[str, str]
) -> None:
    """They would be thrown apart; the error says which, how deep and where."""
    with pytest.raises(SceneError, match=r"overlap at the start by .* mm at .* mm; move one of them away") as refused:
        model(hollow, **tables)
    assert str(refused.value).startswith(f"bodies '{names[0]}' and '{names[1]}'")


def test_soft_bodies_that_overlap_are_refused(hollow: dict[str, Any]) -> None:
    bodies = {"left": hollow, "right": {**hollow, "translation": [19.0, 1.0, 2.0]}}
    with pytest.raises(SceneError, match="bodies 'left' and 'right' overlap at the start by 1 mm"):
        make_model(scene_from_dict({"soft_bodies": bodies}))


def test_an_inertia_that_is_none_is_refused() -> None:
    cube = {"box": [1, 1, 1], "mass": 1, "inertia": [[1, 0, 0], [0, -1, 0], [0, 0, 1]]}
    with pytest.raises(SceneError, match=r"rigid_bodies\.cube\.inertia = .*: must be symmetric and positive definite"):
        make_model(scene_from_dict({"rigid_bodies": {"cube": cube}}))


def test_mass_and_inertia_come_from_the_surface(tmp_path: Path) -> None:
    """A box by a surface file away from its origin and scaled: I = m (b^2 + c^2) / 12 about the middle."""
    box = trimesh.creation.box(extents=[1, 2, 3])
    box.vertices += [10, 0, 0]
    box.export(tmp_path / "box.obj", digits=17)
    table = {"surface": str(tmp_path / "box.obj"), "scale": 2, "density": 1e-3, "position": [0, 0, 5]}
    (body,) = make_model(scene_from_dict({"rigid_bodies": {"box": table}})).rigid_bodies
    assert body.mass == pytest.approx(0.048, rel=1e-12)
    expected = 0.048 / 12 * np.diag([4**2 + 6**2, 2**2 + 6**2, 2**2 + 4**2])
    np.testing.assert_allclose(body.inertia, expected, atol=1e-12)
    np.testing.assert_allclose(body.start_position, [20, 0, 5], atol=1e-12)


def test_every_piece_of_a_mesh_has_a_surface_and_no_cavity_has(tmp_path: Path) -> None:
    """Two hollow blocks in one mesh: both outsides touch others, as large as they were; the hollows do not."""
    one = make_block((3, 3, 3), (20.0, 20.0, 20.0), hollow=True)
    nodes = np.vstack([one.nodes, one.nodes + np.array([50.0, 0.0, 0.0])])
    elements = np.vstack([one.elements, one.elements + len(one.nodes)])
    write_volume_mesh(VolumeMesh("two", nodes, elements), tmp_path / "two.msh")
    made = model({"mesh": str(tmp_path / "two.msh"), "mass": 0.01, "young_modulus": 500, "poisson_ratio": 0.3})
    surface = made.soft_bodies[0].surface
    assert enclosed_volume(surface.positions(nodes), surface.triangles) == pytest.approx(2 * 20.0**3)


def test_the_tutorials_surface_touches_without_the_walls_of_its_cavity(shared: Path) -> None:
    """The file holds both: 60050 mm^3 outside, 8887.5 mm^3 within."""
    meshes = shared / "tutorial-meshes"
    files = {"mesh": str(meshes / "pneunetCutCoarse.vtk"), "collision_surface": str(meshes / "pneunetCut.stl")}
    made = model({**files, "mass": 0.04, "young_modulus": 500, "poisson_ratio": 0.3})
    assert len(made.soft_bodies[0].surface.triangles) == 2056


def obstacle_file(folder: Path, surface: trimesh.Trimesh) -> np.ndarray:
    """The triangles of the obstacle that Model makes of a surface file."""
    surface.export(folder / "table.obj")
    tables = {
        "rigid_bodies": {"cube": {"box": [1, 1, 1], "mass": 1, "position": [0, 0, 9]}},
        "obstacles": {"table": {"surface": str(folder / "table.obj")}},
    }
    triangles = make_model(scene_from_dict(tables)).obstacles[0].triangles
    assert triangles is not None
    return triangles


def test_a_closed_obstacle_inside_out_is_turned_round_with_a_warning(tmp_path: Path) -> None:
    """Else it would pull in what touches it from outside. The warning points to the program, not into the engine."""
    box = trimesh.creation.box(extents=[2, 2, 2])
    box.invert()
    with pytest.warns(UserWarning, match=r"table\.obj: is inside out") as told:
        triangles = obstacle_file(tmp_path, box)
    assert {one.filename for one in told} == {__file__}
    assert enclosed_volume(box.vertices, triangles) == pytest.approx(8.0)


def test_an_open_obstacle_stays_as_it_is(tmp_path: Path) -> None:
    """Its author alone knows which side is solid."""
    box = trimesh.creation.box(extents=[2, 2, 2])
    box.invert()
    box.update_faces(np.arange(1, 12))
    np.testing.assert_array_equal(obstacle_file(tmp_path, box), box.faces)
