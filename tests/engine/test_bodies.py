"""Bodies of a model: what does not fit their meshes is refused; their surfaces and axes in a state."""

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import trimesh
from blocks import make_block
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from taichisoft import Control, Model, Scene, Simulation, VolumeMesh, make_model, write_volume_mesh
from taichisoft.base import matrices_from_quaternions
from taichisoft.contact import MovingSurfaces
from taichisoft.errors import MeshError, SceneError
from taichisoft.mechanics import axes_of_bodies, body_surfaces, planes_of
from taichisoft.mechanics.body_geometry import RigidAxes, SoftAxes, best_rotation
from taichisoft.mesh import enclosed_volume
from taichisoft.scene import lame_parameters, scene_from_dict

# What does not fit its meshes, or cannot be started, is refused before anything is simulated.


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


def cavity_file(folder: Path, offset: tuple[float, float, float], inverted: bool = False, hole: bool = False) -> Any:
    """A cavity of a surface file, a cube of 8 mm^3 to the single precision of STL."""
    box = trimesh.creation.box(extents=[2, 2, 2])
    box.vertices += offset
    if inverted:
        box.invert()
    if hole:
        box.update_faces(np.arange(1, 12))
    box.export(folder / "cavity.stl")
    return {"cavities": {"air": {"surface": str(folder / "cavity.stl")}}}


def test_cavity_of_a_file_has_its_volume(hollow: dict[str, Any], tmp_path: Path) -> None:
    """Embedded in the material, not made of its nodes; one that is inside out is turned with a warning."""
    made = model({**hollow, **cavity_file(tmp_path, (8.0, 8.0, 8.0))})
    assert made.cavities.rest_value[0] == pytest.approx(8.0, rel=1e-6)
    with pytest.warns(UserWarning, match=r"cavity\.stl: is inside out"):
        made = model({**hollow, **cavity_file(tmp_path, (8.0, 8.0, 8.0), inverted=True)})
    assert made.cavities.rest_value[0] == pytest.approx(8.0, rel=1e-6)


@pytest.mark.parametrize(
    ("height", "hole", "message"),
    [
        (8.0, True, r"cavity\.stl: is not closed: \d+ edges"),
        # Another finger's cavity, or metres for millimetres.
        (30.0, False, r"cavity\.stl: vertex \d+ at \[.*\] mm lies outside the body .*\.msh"),
        # In the body's box, but in no element, nor near one; the hollow is 6.7 mm wide, its elements as large.
        (0.0, False, r"cavity\.stl: vertex \d+ at \[.*\] mm lies outside .*\.msh .* mm\); give the"),
    ],
)
def test_cavity_that_does_not_fit_is_refused(
    hollow: dict[str, Any], tmp_path: Path, height: float, hole: bool, message: str
) -> None:
    with pytest.raises(MeshError, match=message):
        model({**hollow, **cavity_file(tmp_path, (0.0, 0.0, height), hole=hole)})


def test_outer_points_are_extrapolated_on_request(hollow: dict[str, Any], tmp_path: Path) -> None:
    """From the element with the nearest centroid: as the body is sheared, so is what lies outside."""
    made = model({**hollow, **cavity_file(tmp_path, (0.0, 0.0, 30.0)), "points_outside": "extrapolated"})
    (cavity,) = made.soft_bodies[0].cavities
    shear = np.array([[1.0, 0.5, 0.0], [0.0, 1.0, 0.2], [0.0, 0.0, 1.0]])
    moved = cavity.surface.positions(made.rest_position @ shear.T)
    assert moved == pytest.approx(cavity.surface.positions(made.rest_position) @ shear.T)
    assert moved[:, 2].min() > 20.0


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


def test_overlapping_soft_bodies_and_impossible_inertia_are_refused(hollow: dict[str, Any]) -> None:
    bodies = {"left": hollow, "right": {**hollow, "translation": [19.0, 1.0, 2.0]}}
    with pytest.raises(SceneError, match="bodies 'left' and 'right' overlap at the start by 1 mm"):
        make_model(scene_from_dict({"soft_bodies": bodies}))
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


def test_tutorial_surface_leaves_out_cavity_walls(shared: Path) -> None:
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


def test_inverted_obstacle_is_turned_with_a_warning(tmp_path: Path) -> None:
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


# Regions of a soft body that share elements.


def test_later_region_wins_whole(block: Callable[..., str]) -> None:
    """Where both are, the second one's modulus and, since it gives none, the body's Poisson's ratio."""
    box = [[-100, -100, -100], [100, 100, 100]]
    regions = [{"box": box, "young_modulus": 900, "poisson_ratio": 0.1}, {"box": box, "young_modulus": 700}]
    body = {"mesh": block((2, 1, 1), (20.0, 10.0, 10.0)), "mass": 1, "young_modulus": 500, "poisson_ratio": 0.3}
    model = make_model(scene_from_dict({"soft_bodies": {"block": {**body, "regions": regions}}}))
    expected = lame_parameters(np.array([700.0]), np.array([0.3]))
    np.testing.assert_array_equal(model.soft_bodies[0].lame, np.repeat(expected, 12, axis=0))


# Where the surfaces of bodies are in a state, found without kernels.

BODIES = {name: {"box": [1.0, 1.0, 1.0], "mass": 1.0} for name in ("ball", "cube")}


def test_surfaces_are_where_contact_finds_them(taichisoft_scene: Scene) -> None:
    """After steps in which the pads bend and the base turns; contact moves its own vertices with kernels."""
    simulation = Simulation(taichisoft_scene)
    model = simulation.model
    for _ in range(5):
        simulation.step(Control(pressure={"left.cavity": 5.0}, base_velocity=np.array([0.0, 10.0, 20.0])))
    state = simulation.state
    surfaces = body_surfaces(model.soft_bodies, model.rigid_bodies, model.obstacles)
    assert [(surface.name, surface.kind) for surface in surfaces] == [
        ("left", "soft"),
        ("left.cavity", "cavity"),
        ("right", "soft"),
        ("right.cavity", "cavity"),
        ("cube", "rigid"),
    ]
    moving = MovingSurfaces(model.surfaces)
    moving.update(state.position, state.rigid_position, matrices_from_quaternions(state.rigid_rotation))
    found = [surface.vertices(state) for surface in surfaces if surface.kind != "cavity"]
    np.testing.assert_allclose(np.vstack(found), moving.moved.position, atol=1e-12)
    (floor,) = planes_of(model.obstacles)
    assert floor.name == "floor" and floor.normal.tolist() == [0.0, 0.0, 1.0]


@pytest.mark.parametrize(
    ("gravity", "up"), [([-9810.0, 0.0, 0.0], [1.0, 0.0, 0.0]), ([0.0, 3.0, -4.0], [0.0, -0.6, 0.8])]
)
def test_up_is_against_gravity(gravity: list[float], up: list[float]) -> None:
    assert scene_from_dict({"gravity": gravity, "rigid_bodies": BODIES}).up.tolist() == pytest.approx(up)


def test_up_is_z_without_gravity() -> None:
    assert scene_from_dict({"gravity": [0.0, 0.0, 0.0], "rigid_bodies": BODIES}).up.tolist() == [0.0, 0.0, 1.0]


def test_the_main_object_is_that_of_the_goal_or_the_first() -> None:
    assert scene_from_dict({"rigid_bodies": BODIES}).main_object == "ball"
    assert scene_from_dict({"rigid_bodies": BODIES, "goal": {"object": "cube"}}).main_object == "cube"
    soft = {"finger": {"mesh": "m", "mass": 1.0, "young_modulus": 500.0, "poisson_ratio": 0.3}}
    assert Scene.model_validate({"soft_bodies": soft}).main_object is None


# The axes of bodies go with them: those of a soft body turn as the rotation that fits its nodes best.

ANGLES = st.tuples(*3 * [st.floats(-3.0, 3.0)])
POINTS = np.random.default_rng(1).normal(size=(20, 3)) * [30.0, 10.0, 5.0]


@given(ANGLES)
def test_best_rotation_finds_a_rigid_motion(angles: tuple[float, float, float]) -> None:
    turn = Rotation.from_rotvec(angles).as_matrix()
    np.testing.assert_allclose(best_rotation(POINTS, POINTS @ turn.T + [5.0, 6.0, 7.0]), turn, atol=1e-9)


@given(ANGLES, st.integers(0, 1000))
def test_it_is_a_rotation_that_no_other_near_it_betters(angles: tuple[float, float, float], seed: int) -> None:
    """Also of mirrored and noisy points: what is left is a minimum over 20 small turns."""
    noise = np.random.default_rng(seed).normal(size=(20, *POINTS.shape))
    after = POINTS @ Rotation.from_rotvec(angles).as_matrix().T * [1.0, 1.0, -1.0] + noise[0]
    found = best_rotation(POINTS, after)
    np.testing.assert_allclose(found @ found.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(found) > 0.0

    def left(turn: np.ndarray) -> float:
        return float((((POINTS - POINTS.mean(0)) @ turn.T - (after - after.mean(0))) ** 2).sum())

    for small in 0.01 * noise[:, 0]:
        assert left(Rotation.from_rotvec(small).as_matrix() @ found) >= left(found) * (1.0 - 1e-12)


def test_moved_body_keeps_the_axes_of_its_mesh() -> None:
    placement, turn = (Rotation.from_euler("xyz", angles, degrees=True) for angles in ([30, 40, 50], [0, 0, 90]))
    rest = placement.apply(POINTS) + np.array([1.0, 2.0, 3.0])
    position = np.vstack([np.zeros((4, 3)), turn.apply(rest) + np.array([0.0, 0.0, 9.0])])
    axes = SoftAxes(slice(4, 24), rest, placement.as_matrix())
    origin, *directions = axes.place(SimpleNamespace(position=position))  # type: ignore[arg-type]
    np.testing.assert_allclose(origin, position[4:].mean(axis=0))
    np.testing.assert_allclose(directions, (turn * placement).as_matrix().T, atol=1e-9)


def test_axes_are_of_bodies_that_want_them() -> None:
    soft = {"mesh": "m", "mass": 1.0, "young_modulus": 500.0, "poisson_ratio": 0.3}
    rigid = {"box": [1.0, 1.0, 1.0], "mass": 1.0}
    scene = Scene.model_validate(
        {
            "soft_bodies": {"a": soft, "b": {**soft, "axes": True}},
            "rigid_bodies": {"c": rigid, "d": {**rigid, "axes": True}},
        }
    )
    bodies = [SimpleNamespace(name=name, nodes=slice(0, 4), rest_position=POINTS[:4]) for name in "ab"]
    axes = axes_of_bodies(scene, bodies)
    assert list(axes) == ["b", "d"] and axes["d"] == RigidAxes(1)
    quaternion = Rotation.from_euler("z", 90, degrees=True).as_quat()[[3, 0, 1, 2]]
    poses = SimpleNamespace(rigid_position=np.array([[0, 0, 0], [1, 2, 3]]), rigid_rotation=np.array([quaternion] * 2))
    expected = [[1, 2, 3], [0, 1, 0], [-1, 0, 0], [0, 0, 1]]
    np.testing.assert_allclose(axes["d"].place(poses), expected, atol=1e-12)  # type: ignore[arg-type]
