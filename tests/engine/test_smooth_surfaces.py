"""Triangulated balls that stand for smooth ones, against the ball itself; its error falls with the resolution."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from taichisoft import Simulation, make_model
from taichisoft.contact import ContactDetection, MovingSurfaces
from taichisoft.errors import MeshError
from taichisoft.scene import scene_from_dict

RADIUS = 20.0
FLOOR = {"plane": {"point": [0, 0, 0], "normal": [0, 0, 1]}}
BOX = {"box": [30.0, 24.0, 18.0], "mass": 1.0}


def ball(folder: Path, subdivisions: int, **changes: Any) -> dict[str, Any]:
    """A ball of 10 * 4^subdivisions + 2 vertices, turned so that it has no symmetry along the axes."""
    surface = trimesh.creation.icosphere(subdivisions, RADIUS)
    surface.vertices = surface.vertices @ Rotation.from_rotvec([0.3, 0.2, 0.1]).as_matrix().T
    file = folder / f"ball{subdivisions}.obj"
    surface.export(file, digits=17)
    return {"surface": str(file), "smooth": True, "mass": 0.05, **changes}


@pytest.mark.parametrize(("subdivisions", "tolerance"), [(2, 0.04), (3, 0.006), (4, 0.001)])
@pytest.mark.parametrize("ball_first", [True, False])
def test_the_least_distance_from_a_box(subdivisions: int, tolerance: float, ball_first: bool, tmp_path: Path) -> None:
    """Of faces, edges and corners: that of the ball's centre less the radius, to the error of the curved surface."""
    bodies = {"ball": ball(tmp_path, subdivisions), "box": {**BOX, "position": [100, 0, 0]}}
    order = sorted(bodies, reverse=not ball_first)
    model = make_model(scene_from_dict({"rigid_bodies": {name: bodies[name] for name in order}}))
    random = np.random.default_rng(1)
    half = 0.5 * np.array(BOX["box"])
    zones = set()
    for turn in Rotation.random(120, rng=random).as_matrix():
        near = random.uniform(-1.6, 1.6, 3) * half
        foot = np.clip(near, -half, half)
        if np.allclose(foot, near):
            continue
        away = (near - foot) / np.linalg.norm(near - foot)
        gap = random.uniform(0.1, 3.0)
        place = -turn @ (foot + (RADIUS + gap) * away)  # of the box, the ball being at the origin
        positions = np.array([np.zeros(3), place])
        rotations = np.array([np.eye(3), turn])
        if order[0] != "ball":
            positions, rotations = positions[::-1].copy(), rotations[::-1].copy()
        moving = MovingSurfaces(model.surfaces)
        moving.update(model.rest_position, positions, rotations)
        found = ContactDetection(model.surfaces, moving).find(5.0, 5.0).trimmed()
        nearest = int(found.distance.argmin())
        assert found.distance[nearest] == pytest.approx(gap, abs=tolerance)
        outward = turn @ away if order[0] != "ball" else -turn @ away  # from the first body to the second
        assert found.normal[nearest] @ outward > 1.0 - 1e-4
        apart = found.points[:, 1] - found.points[:, 0]
        np.testing.assert_allclose(apart, found.distance[:, None] * found.normal, atol=1e-9)
        zones.add(int((np.abs(near) > half).sum()))
    assert zones == {1, 2, 3}  # faces, edges, corners


@pytest.mark.parametrize(("subdivisions", "tolerance"), [(2, 3.0), (3, 1.2), (4, 0.3)])
@pytest.mark.parametrize("step", [0.01, 0.002])
def test_rolling_converges_with_the_resolution(
    subdivisions: int, tolerance: float, step: float, tmp_path: Path
) -> None:
    """100 mm/s after 1 s, to 3, 1.2 and 0.3 %: the error falls with the square of the edges' length.

    Without `smooth` these balls lose half of their speed or all of it, however fine they are.
    """
    table = ball(
        tmp_path, subdivisions, position=[0, 0, RADIUS + 1], velocity=[100, 0, 0], angular_velocity=[0, 100 / RADIUS, 0]
    )
    simulation = Simulation(
        scene_from_dict({"time": {"step": step}, "rigid_bodies": {"ball": table}, "obstacles": {"floor": FLOOR}})
    )
    for _ in range(round(1.0 / step)):
        report = simulation.step()
        assert report.converged
        assert report.contact_count == 1
    assert simulation.state.rigid_velocity[0, 0] == pytest.approx(100.0, abs=tolerance)


def test_it_rolls_off_an_edge_as_the_sphere_does(tmp_path: Path) -> None:
    """The edge of a table holds it for a while: the way is that of the exact sphere."""
    ways = []
    for table in (ball(tmp_path, 4), {"sphere": {"radius": RADIUS}, "mass": 0.05}):
        body = {**table, "position": [-8, 0, RADIUS + 1], "velocity": [200, 0, 0], "angular_velocity": [0, 10, 0]}
        top = {"box": [400, 400, 40], "translation": [-200, 0, -20]}
        scene = {"time": {"step": 0.002}, "rigid_bodies": {"ball": body}, "obstacles": {"table": top}}
        simulation = Simulation(scene_from_dict(scene))
        for _ in range(80):
            simulation.step()
        ways.append(simulation.state.rigid_position[0])
    assert ways[1][2] < RADIUS - 1.0  # it has begun to fall
    np.testing.assert_allclose(ways[0], ways[1], atol=0.3)


def test_what_is_not_smooth_is_refused(tmp_path: Path) -> None:
    tube = trimesh.creation.capsule(30.0, 5.0, count=[32, 32]).subdivide().subdivide()
    shapes = {
        "box": (trimesh.creation.box(extents=[10, 10, 10]), r"turns by up to 90 degrees, by more than 40 at 12 edges"),
        "tube": (tube, r"triangles are flat or curved in one direction"),
    }
    for name, (surface, message) in shapes.items():
        surface.export(tmp_path / f"{name}.obj", digits=17)
        body = {"surface": str(tmp_path / f"{name}.obj"), "mass": 1.0, "smooth": True}
        with pytest.raises(MeshError, match=rf"^rigid_bodies\.body\.smooth = true: .*{message}"):
            make_model(scene_from_dict({"rigid_bodies": {"body": body}}))
