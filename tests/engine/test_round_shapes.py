"""Spheres, capsules and cylinders as bodies and obstacles: mass, errors, overlap, groups, pictures, recordings."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from taichisoft import Simulation, load_scene, make_model
from taichisoft.errors import SceneError
from taichisoft.mechanics import body_surfaces
from taichisoft.mechanics.rigid_body_arrays import RoundShape
from taichisoft.scene import scene_from_dict, scene_to_toml
from taichisoft_outputs import read_recording
from taichisoft_outputs.recording.recording_output import RecordingOutput
from taichisoft_outputs.recording.resume import ResumeError, recorded_scene, resumed_simulation

BALL: dict[str, Any] = {"sphere": {"radius": 10.0}, "mass": 0.01}
ROD: dict[str, Any] = {"cylinder": {"radius": 2.0, "length": 60.0}, "mass": 0.01}
PILL: dict[str, Any] = {"capsule": {"radius": 5.0, "length": 20.0}, "mass": 0.01}
FLOOR = {"plane": {"point": [0, 0, 0], "normal": [0, 0, 1]}}
sizes = st.floats(0.1, 100.0)


def sliced(shape: RoundShape) -> tuple[float, float, float]:
    """Volume [mm^3], and integrals of the squared distance from the axis and from an axis across it [mm^5].

    Sums over discs: a disc of radius s at height z has the area pi s^2, and second moments of pi s^4 / 2 and
    pi s^4 / 4 + pi s^2 z^2. Gauss's rule is exact for the polynomials that stand here.
    """
    points, weights = np.polynomial.legendre.leggauss(8)
    volume = along = across = 0.0
    half, cap = 0.5 * shape.length, 0.0 if shape.flat else shape.radius
    for low, high in ((-half - cap, -half), (-half, half), (half, half + cap)):
        z = 0.5 * (low + high) + 0.5 * (high - low) * points
        beyond = np.maximum(np.abs(z) - half, 0.0)
        square = shape.radius**2 - beyond**2
        share = 0.5 * (high - low) * weights * np.pi
        volume += share @ square
        along += share @ (0.5 * square**2)
        across += share @ (0.25 * square**2 + square * z**2)
    return volume, along, across


@given(radius=sizes, length=sizes, kind=st.sampled_from(["sphere", "capsule", "cylinder"]))
def test_volume_and_inertia(radius: float, length: float, kind: str) -> None:
    """Closed forms against sums over discs; tolerance: round-off."""
    shape = RoundShape(radius, 0.0 if kind == "sphere" else length, kind == "cylinder")
    volume, along, across = sliced(shape)
    assert shape.volume == pytest.approx(volume, rel=1e-12)
    expected = 2.0 / volume * np.array([across, across, along])
    np.testing.assert_allclose(shape.inertia(2.0), np.diag(expected), rtol=1e-10)


@pytest.mark.parametrize("table", [BALL, ROD, PILL], ids=["sphere", "cylinder", "capsule"])
def test_triangles_lie_on_the_shape(table: dict[str, Any]) -> None:
    """What is drawn is closed, faces outward, and is less than 0.3 % smaller than the shape."""
    (body,) = make_model(scene_from_dict({"rigid_bodies": {"body": table}})).rigid_bodies
    assert body.shape is not None
    drawn = trimesh.Trimesh(body.vertices, body.triangles, process=False)
    assert drawn.is_watertight
    assert 0.997 * body.shape.volume < drawn.volume < body.shape.volume
    np.testing.assert_allclose(drawn.bounds.mean(axis=0), 0.0, atol=1e-9)


def test_density_and_given_properties() -> None:
    turned = {"sphere": {"radius": 10.0}, "density": 1e-6, "centre_of_mass": [1, 0, 0], "position": [5, 0, 0]}
    (body,) = make_model(scene_from_dict({"rigid_bodies": {"ball": turned}})).rigid_bodies
    assert body.mass == pytest.approx(1e-6 * 4 / 3 * np.pi * 1000)
    np.testing.assert_allclose(np.diagonal(body.inertia), 0.4 * body.mass * 100)
    assert body.start_position.tolist() == [6, 0, 0]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"box": [1, 1, 1]}, "exactly one of surface, box, sphere, cylinder, capsule is needed; given: box, sphere"),
        ({"scale": 2.0}, "scale would have no effect beside sphere; remove it"),
        ({"sphere": {"radius": 0.0}}, r"sphere\.radius = 0\.0"),
        ({"sphere": {"radius": 1.0, "length": 2.0}}, r"sphere\.length"),
        ({"sphere": {}}, r"sphere\.radius: this key is missing"),
        ({"sphere": 20.0}, r"sphere = 20\.0: must be a table"),
    ],
)
def test_errors(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        scene_from_dict({"rigid_bodies": {"ball": {**BALL, **changes}}})


def test_an_obstacle_has_one_kind_only() -> None:
    with pytest.raises(SceneError, match="exactly one of plane, surface, box, sphere, cylinder, capsule is needed"):
        scene_from_dict({"rigid_bodies": {"ball": BALL}, "obstacles": {"post": {**FLOOR, "sphere": {"radius": 1}}}})


def test_a_scene_is_written_and_read_and_changed(tmp_path: Path) -> None:
    scene = scene_from_dict({"rigid_bodies": {"ball": BALL, "rod": {**ROD, "position": [50, 0, 0]}}})
    (tmp_path / "scene.toml").write_text(scene_to_toml(scene))
    assert load_scene(str(tmp_path / "scene.toml")) == scene
    changed = load_scene(str(tmp_path / "scene.toml"), ["rigid_bodies.ball.sphere.radius=4"])
    assert make_model(changed).rigid_bodies[0].shape == RoundShape(4.0, 0.0, flat=False)


OVERLAPS: dict[str, dict[str, Any]] = {
    "sphere in floor": {"rigid_bodies": {"ball": BALL}, "obstacles": {"floor": FLOOR}},
    "ball and rod": {"rigid_bodies": {"ball": BALL, "rod": ROD}},
    "rod through a box": {"rigid_bodies": {"rod": ROD, "box": {"box": [40, 40, 3], "mass": 1}}},
    "box in a ball": {"rigid_bodies": {"ball": BALL, "box": {"box": [3, 3, 3], "mass": 1}}},
    "ball in a box": {"rigid_bodies": {"ball": BALL, "box": {"box": [70, 70, 70], "mass": 1}}},
    "pill and obstacle": {
        "rigid_bodies": {"pill": PILL},
        "obstacles": {
            "post": {"cylinder": {"radius": 4, "length": 9}, "rotation": [90, 0, 0], "translation": [8, 0, 0]}
        },
    },
}


@pytest.mark.parametrize("tables", OVERLAPS.values(), ids=OVERLAPS)
def test_overlap_at_the_start_is_refused(tables: dict[str, Any]) -> None:
    with pytest.raises(SceneError, match=r"^bodies '\w+' and '\w+' overlap at the start"):
        make_model(scene_from_dict(tables))


def test_groups_and_bodies_that_do_not_collide() -> None:
    """Both kinds go through each other unhindered; the others would have been refused for their overlap."""
    for changes in ({"groups": [1]}, {"collides": False}):
        bodies = {"ball": {**BALL, **changes, "velocity": [10, 0, 0]}, "rod": {**ROD, "groups": [1]}}
        simulation = Simulation(scene_from_dict({"gravity": [0, 0, 0], "rigid_bodies": bodies}))
        for _ in range(3):
            assert simulation.step().contact_count == 0
        assert simulation.state.rigid_velocity.tolist() == [[10, 0, 0], [0, 0, 0]]


def test_a_run_is_recorded_and_resumed_to_the_bit(tmp_path: Path) -> None:
    """A ball rolls off a rod onto an obstacle; surfaces in the recording are where the shapes are."""
    ball = {**BALL, "position": [1.0, 0.0, 13.0], "velocity": [50, 0, 0]}
    post = {"capsule": {"radius": 4, "length": 20}, "rotation": [90, 0, 0], "translation": [20, 0, -5]}
    tables = {
        "rigid_bodies": {"ball": ball, "rod": {**ROD, "rotation": [90, 0, 0]}},
        "obstacles": {"post": post, "floor": {"plane": {"point": [0, 0, -12], "normal": [0, 0, 1]}}},
    }
    simulation = Simulation(scene_from_dict(tables))
    output = RecordingOutput(tmp_path)
    output.begin(simulation.model, simulation.state)
    touched = set()
    for _ in range(40):
        report = simulation.step()
        assert report.converged
        touched |= {pair for pair, force in report.observation.normal_forces.items() if force > 0}
        output.record(simulation.state, report)
    output.end("completed")
    assert {("ball", "rod"), ("rod", "floor"), ("ball", "post")} <= touched
    with read_recording(tmp_path / "recording.h5") as recording:
        last = recording.surfaces
        assert [surface.name for surface in last] == ["ball", "rod", "post"]
        for recorded, made in zip(last, body_surfaces((), *bodies_of(simulation)), strict=True):
            np.testing.assert_array_equal(recorded.vertices(40), made.vertices(simulation.state))
        resumed = resumed_simulation(recording, 20, recorded_scene(recording, [], None))
        for _ in range(20):
            resumed.step()
        assert resumed.state == simulation.state
        with pytest.raises(ResumeError, match="'ball' is not as it was recorded"):
            resumed_simulation(recording, 20, recorded_scene(recording, ["rigid_bodies.ball.sphere.radius=9"], None))


def bodies_of(simulation: Simulation) -> tuple[Any, Any]:
    return simulation.model.rigid_bodies, simulation.model.obstacles


@pytest.mark.parametrize(
    "shape",
    [{"sphere": {"radius": 5.0}}, {"cylinder": {"radius": 5.0, "length": 30.0}, "rotation": [90.0, 0.0, 0.0]}],
)
def test_a_soft_body_lands_on_a_round_obstacle_that_is_alone_with_it(block, shape) -> None:
    """The obstacle carries the weight, though nothing else in the scene could touch anything."""
    body = {"mesh": block((2, 2, 2), (8.0, 8.0, 8.0)), "density": 1e-6, "young_modulus": 50.0, "poisson_ratio": 0.3}
    placed = {**body, "translation": [0.0, 0.0, 10.2], "rayleigh_mass": 5.0}
    simulation = Simulation(scene_from_dict({"soft_bodies": {"block": placed}, "obstacles": {"post": shape}}))
    for _ in range(15):
        report = simulation.step()
    assert report.observation.normal_forces["block", "post"] > 0.5 * 8.0**3 * 1e-6 * 9810.0
