"""Pressures in contacts: their sum over the area is the force, and a ball on rubber presses as Hertz says."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from blocks import make_block
from conftest import Figures

from taichisoft.building.scene_files import load_scene
from taichisoft.building.simulation import Simulation
from taichisoft.control.contact_patches import ContactPatches
from taichisoft.control.control import Control
from taichisoft.meshes.files import write_volume_mesh
from taichisoft.pytest_fixtures import TINY_GRIPPER
from taichisoft.scenes.file import scene_from_dict

RADIUS, MODULUS, RATIO, DEPTH = 20.0, 100.0, 0.3, 20.0
WEIGHT = 1000.0


@pytest.fixture(scope="module")
def rubber(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A block of 40 x 40 x 20 mm whose elements are small under the middle of its upper face, z = 0."""
    mesh = make_block((10, 10, 5), (1.0, 1.0, 1.0))
    x, y, z = mesh.nodes.T
    nodes = np.column_stack([*(40.0 * (0.2 * s + 3.2 * s**3) for s in (x, y)), -DEPTH * (z.max() - z) ** 1.6])
    path = tmp_path_factory.mktemp("rubber") / "block.msh"
    write_volume_mesh(replace(mesh, nodes=nodes).check(), path)
    return path


def test_a_ball_presses_a_block_as_hertz_says(rubber: Path, figures: Figures) -> None:
    """F = 4/3 E* sqrt(R) d^1.5 gives a^3 = 3 F R / (4 E*), the area pi a^2 and the peak 3 F / (2 pi a^2) (Hertz 1882).

    A pressure at a vertex is that of the triangles around it, which regular tetrahedra share out unevenly: with
    elements of a sixth of the radius the area is 23 % too small and the peak 28 % too high, with finer ones (12 x 12
    x 6, an eighth of it) 15 and 8 %.
    """
    body = {
        "mesh": str(rubber),
        "element": "linear",
        "mass": 0.01,
        "young_modulus": MODULUS,
        "poisson_ratio": RATIO,
        "rayleigh_mass": 20.0,
        "rayleigh_stiffness": 0.1,
        "anchors": [{"box": [[-21, -21, -DEPTH - 0.01], [21, 21, -DEPTH + 0.01]]}],
    }
    ball = {"sphere": {"radius": RADIUS}, "mass": WEIGHT / 1000.0, "position": [0.0, 0.0, RADIUS + 0.04]}
    simulation = Simulation(
        scene_from_dict(
            {
                "gravity": [0.0, 0.0, -1000.0],
                "time": {"step": 0.03},
                "contact": {"contact_distance": 0.05, "alarm_distance": 1.0, "friction": 0.0},
                "soft_bodies": {"block": body},
                "rigid_bodies": {"ball": ball},
            }
        )
    )
    for _ in range(25):
        simulation.step()
    seen, pair = simulation.observe(), ("block", "ball")
    patch = ContactPatches(simulation.model).patches(simulation.state)[pair]
    print(vars(patch))
    force = seen.normal_forces[pair]
    assert force == pytest.approx(WEIGHT, rel=0.03)  # nearly at rest
    # Vertical parts: the contacts' normals lean by up to asin(a / R) = 0.23, which takes 1.5 % off at most.
    assert patch.forces.sum() == pytest.approx(force, rel=1e-9)
    effective = MODULUS / (1.0 - RATIO**2)
    radius = (0.75 * force * RADIUS / effective) ** (1 / 3)
    figures.at_most("area against Hertz", abs(seen.contact_areas[pair] / (np.pi * radius**2) - 1.0), 0.25)
    peak = 1.5 * force / (np.pi * radius**2)
    figures.at_most("peak against Hertz", abs(seen.peak_pressures[pair] / peak - 1.0), 0.3)
    places = simulation.model.soft_bodies[0].surface.positions(simulation.state.position)[patch.vertices]
    assert np.hypot(*places[patch.pressure > 0.05 * peak, :2].T).max() < 1.25 * radius


def test_patches_of_a_pad_share_the_force_on_it() -> None:
    """The cube of 10 mm touches the middle of a pad's face: patches beside it feel nothing, all together the force."""
    table = "{box=[[-1,-20,-20],[30,20,20]], patches=[1,4,2]}"
    scene = load_scene(TINY_GRIPPER, [f"soft_bodies.left.tactile.pad={table}", "sensors.tactile={resolution=0.5}"])
    simulation = Simulation(scene)
    for _ in range(25):
        simulation.step(Control(pressure={"left.cavity": 9.0, "right.cavity": 9.0}))
    seen = simulation.observe()
    felt, force = seen.truth.tactile["left.pad"], seen.normal_forces["left", "cube"]
    assert felt.shape == (1, 4, 2) and force > 1.0
    assert felt.sum() == pytest.approx(force, rel=1e-9)
    assert (felt[0, [0, 3]] == 0.0).all()
    assert np.array_equal(seen.tactile["left.pad"], 0.5 * np.rint(2 * felt))
    area = seen.contact_areas["left", "cube"]
    assert 0.0 < force / area <= seen.peak_pressures["left", "cube"] * (1 + 1e-9)
