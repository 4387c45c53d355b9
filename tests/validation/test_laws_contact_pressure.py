"""Contact areas and pressures: flat feet have their footprint, a ball and a roller press as Hertz says."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from blocks import make_block
from conftest import Figures

import taichisoft
from taichisoft import VolumeMesh, load_scene, write_volume_mesh
from taichisoft.pytest_fixtures import TINY_GRIPPER

Box = Callable[[tuple[float, ...], tuple[float, ...], tuple[int, ...]], str]
PLATE = {"plate": {"box": [60.0, 60.0, 10.0], "translation": [0.0, 0.0, -5.1]}}


@pytest.fixture
def box(tmp_path: Path) -> Box:
    """Writes a mesh of a box, given two corners and the numbers of its cells."""

    def write(low: tuple[float, ...], high: tuple[float, ...], cells: tuple[int, ...]) -> str:
        path = tmp_path / f"box{len(list(tmp_path.iterdir()))}.msh"
        mesh = make_block(cells, tuple(np.subtract(high, low)))
        nodes = mesh.nodes - mesh.nodes.min(axis=0) + low
        write_volume_mesh(replace(mesh, nodes=nodes).check(), path)
        return str(path)

    return write


def soft(mesh: str, held: tuple[float, float], **changes: object) -> dict[str, object]:
    """A body of 100 kPa that is held between two heights [mm] and does not bulge."""
    anchors = [{"box": [[-99.0, -99.0, held[0]], [99.0, 99.0, held[1]]]}]
    law = {"element": "linear", "density": 1e-6, "young_modulus": 100.0, "poisson_ratio": 0.0}
    return {"mesh": mesh, "anchors": anchors, **law, **changes}


def pressed(down: float, **bodies: object) -> taichisoft.Observation:
    """What is seen at rest after the frame "top" went down [mm], without friction."""
    path = {"times": [0.0, 0.1], "translations": [[0.0, 0.0, 0.0], [0.0, 0.0, -down]]}
    scene = {
        "gravity": [0.0, 0.0, 0.0],
        "time": {"step": 0.1, "dynamics": "static"},
        "contact": {"friction": 0.0, "contact_distance": 0.1, "alarm_distance": 2.0},
        "frames": {"top": {"path": path}},
    }
    simulation = taichisoft.Simulation(taichisoft.scene_from_dict(scene | bodies))
    for _ in range(2):
        simulation.step()
    seen = simulation.observe()
    for pair, area in seen.contact_areas.items():
        assert seen.peak_pressures[pair] >= seen.normal_forces[pair] / area * (1.0 - 1e-9)
    return seen


@pytest.mark.parametrize(
    ("size", "cells"),
    [((20.0, 20.0, 20.0), (2, 2, 2)), ((20.0, 20.0, 20.0), (4, 4, 2)), ((20.0, 20.0, 20.0), (8, 8, 2))]
    + [((2.0, 20.0, 10.0), cells) for cells in ((1, 5, 1), (1, 5, 5), (2, 5, 5))],
)
def test_a_flat_foot_touches_with_its_footprint(
    box: Box, size: tuple[float, float, float], cells: tuple[int, int, int]
) -> None:
    """A cube, and a blade of which only the edge has nodes: side walls face nothing; pressed by 5 % of 100 kPa."""
    x, y, height = size
    mesh = box((-x / 2, -y / 2, 0.0), (x / 2, y / 2, height), cells)
    foot = soft(mesh, (height - 0.01, height + 0.01), follows="top")
    seen, pair = pressed(0.05 * height, soft_bodies={"foot": foot}, obstacles=PLATE), ("foot", "plate")
    assert seen.normal_forces[pair] == pytest.approx(5.0 * x * y, rel=1e-5)
    assert seen.contact_areas[pair] == pytest.approx(x * y, rel=1e-6)
    assert seen.peak_pressures[pair] == pytest.approx(5.0, rel=1e-4)
    assert seen.contact_area_errors[pair] == pytest.approx(0.0, abs=1e-3)
    assert seen.peak_pressure_errors[pair] == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize("cells", [2, 4, 8])
def test_what_overhangs_does_not_touch(box: Box, cells: int) -> None:
    """7 of 20 mm of a cube stand on a plate, whose edge goes through elements."""
    cube = soft(box((-10.0, -10.0, 0.0), (10.0, 10.0, 20.0), (cells, cells, 2)), (19.9, 20.1), follows="top")
    plate = {"plate": PLATE["plate"] | {"translation": [33.0, 0.0, -5.1]}}
    seen, pair = pressed(1.0, soft_bodies={"cube": cube}, obstacles=plate), ("cube", "plate")
    assert seen.contact_areas[pair] == pytest.approx(140.0, rel=0.12)


@pytest.mark.parametrize(("shape", "area"), [({"box": [10.0, 10.0, 10.0]}, 100.0), ({"box": [1.0, 1.0, 10.0]}, 1.0)])
@pytest.mark.parametrize("cells", [2, 4, 8])
def test_a_rigid_foot_has_its_footprint_on_any_mesh(
    box: Box, shape: dict[str, list[float]], area: float, cells: int
) -> None:
    """Its corners press inside triangles that are smaller or larger than it: what lies beside it does not touch."""
    pad = soft(box((-20.0, -20.0, -20.0), (20.0, 20.0, 0.0), (cells, cells, 4)), (-20.1, -19.9))
    foot = shape | {"position": [1.3, 0.7, 5.1], "follows": "top"}
    seen = pressed(0.5, soft_bodies={"pad": pad}, rigid_bodies={"foot": foot})
    assert seen.contact_areas["pad", "foot"] == pytest.approx(area, rel=0.05)


@pytest.mark.parametrize(("lower", "upper"), [(4, 4), (4, 7), (8, 5), (3, 9)])
def test_soft_on_soft_touches_with_the_smaller_face(box: Box, lower: int, upper: int) -> None:
    """12 x 12 mm on 20 x 20 mm, whichever mesh is finer, and whichever body is named first."""
    block = soft(box((-10.0, -10.0, -20.0), (10.0, 10.0, 0.0), (lower, lower, 3)), (-20.1, -19.9))
    mesh = box((-6.0, -6.0, 0.0), (6.0, 6.0, 12.0), (upper, upper, 3))
    stamp = soft(mesh, (11.9, 12.1), follows="top", translation=[0.4, 0.3, 0.1])
    for bodies in ({"block": block, "stamp": stamp}, {"stamp": stamp, "block": block}):
        seen = pressed(0.3, soft_bodies=bodies)
        assert seen.contact_areas[tuple(bodies)] == pytest.approx(144.0, rel=0.01)


@pytest.mark.parametrize(("lower", "upper"), [(3, 3), (4, 7), (6, 2)])
def test_self_contact_has_the_area_of_one_side(lower: int, upper: int) -> None:
    """Two blocks of one body, 0.3 mm apart and pressed by 1.2: 5 kPa on 400 mm^2."""
    one, other = (make_block((n, n, 2), (20.0, 20.0, 10.0)) for n in (lower, upper))
    nodes = np.vstack([one.nodes, other.nodes + np.array([0.0, 0.0, 10.3])])
    elements = np.vstack([one.elements, other.elements + len(one.nodes)])
    body = soft("tutorial-coarse", (-5.1, -4.9), self_contact=True)
    body["anchors"] = [{"box": [[-99.0, -99.0, z - 0.1], [99.0, 99.0, z + 0.1]]} for z in (-5.0, 15.3)]
    scene = {
        "gravity": [0.0, 0.0, 0.0],
        "time": {"step": 0.1, "dynamics": "static"},
        "contact": {"friction": 0.0, "contact_distance": 0.1, "alarm_distance": 2.0},
        "soft_bodies": {"blocks": body},
    }
    mesh = VolumeMesh("blocks", nodes, elements, {}).check()
    simulation = taichisoft.Simulation(taichisoft.Model(taichisoft.scene_from_dict(scene), {"blocks": mesh}))
    places = simulation.model.rest_position[simulation.model.anchored_nodes].copy()
    places[places[:, 2] > 0.0, 2] -= 1.2
    simulation.step(taichisoft.Control(anchor_positions={"blocks": places}))
    seen, pair = simulation.observe(), ("blocks", "blocks")
    assert seen.normal_forces[pair] == pytest.approx(2000.0, rel=1e-4)
    assert seen.contact_areas[pair] == pytest.approx(400.0, rel=2e-3)
    assert seen.peak_pressures[pair] == pytest.approx(5.0, rel=0.01)


def test_few_contacts_stand_for_all_that_touches(box: Box) -> None:
    """A stiff cube pressed lightly: its nodes touch within the contact law's tolerance, and few carry all."""
    mesh = box((-10.0, -10.0, 0.0), (10.0, 10.0, 20.0), (8, 8, 2))
    cube = soft(mesh, (19.9, 20.1), follows="top", young_modulus=1e4)
    seen, pair = pressed(1e-3, soft_bodies={"cube": cube}, obstacles=PLATE), ("cube", "plate")
    assert seen.contact_counts[pair] < 81
    assert seen.contact_areas[pair] == pytest.approx(400.0, rel=1e-6)
    assert abs(seen.peak_pressures[pair] - 0.5) <= seen.peak_pressure_errors[pair]


@pytest.mark.parametrize("cells", [2, 4])
def test_an_edge_says_that_its_area_is_unknown(box: Box, cells: int) -> None:
    """A cube stands on an edge: the area is some part of the elements there, and finer ones say a smaller one."""
    half = 5.0
    mesh = box((-half, -half, -half), (half, half, half), (cells, cells, cells))
    turned = {"rotation": [45.0, 0.0, 0.0], "translation": [0.0, 0.0, half * np.sqrt(2.0)]}
    cube = soft(mesh, (-9.0, 9.0), follows="top", **turned)
    cube["anchors"] = [{"box": [[-9.0, half - 0.1, -9.0], [9.0, half + 0.1, 9.0]]}]
    seen, pair = pressed(0.5, soft_bodies={"cube": cube}, obstacles=PLATE), ("cube", "plate")
    assert 0.0 < seen.contact_areas[pair] < 10.0 * np.sqrt(2.0) * 10.0 / cells
    assert seen.contact_area_errors[pair] > 0.5 * seen.contact_areas[pair]
    assert seen.peak_pressure_errors[pair] > 0.5 * seen.peak_pressures[pair]


RADIUS, MODULUS, RATIO, DEPTH = 20.0, 100.0, 0.3, 20.0
WEIGHT = 1000.0


def rubber(path: Path, cells: int) -> str:
    """A block of 40 x 40 x 20 mm whose elements are small under the middle of its upper face, z = 0."""
    mesh = make_block((cells, cells, cells // 2), (1.0, 1.0, 1.0))
    x, y, z = mesh.nodes.T
    nodes = np.column_stack([*(40.0 * (0.2 * s + 3.2 * s**3) for s in (x, y)), -DEPTH * (z.max() - z) ** 1.6])
    write_volume_mesh(replace(mesh, nodes=nodes).check(), path)
    return str(path)


@pytest.mark.parametrize(("cells", "area", "peak"), [(10, 0.5, 0.1), (16, 0.1, 0.1)])
def test_a_ball_presses_a_block_as_hertz_says(
    tmp_path: Path, figures: Figures, cells: int, area: float, peak: float
) -> None:
    """F = 4/3 E* sqrt(R) d^1.5 gives a^3 = 3 F R / (4 E*), the area pi a^2 and the peak 3 F / (2 pi a^2) (Hertz 1882).

    Elements at the rim are 0.6 and 0.3 of the radius wide; the error that is said covers that of both figures.
    """
    body = {
        "mesh": rubber(tmp_path / "block.msh", cells),
        "element": "linear",
        "mass": 0.01,
        "young_modulus": MODULUS,
        "poisson_ratio": RATIO,
        "rayleigh_mass": 20.0,
        "rayleigh_stiffness": 0.1,
        "anchors": [{"box": [[-21, -21, -DEPTH - 0.01], [21, 21, -DEPTH + 0.01]]}],
    }
    ball = {"sphere": {"radius": RADIUS}, "mass": WEIGHT / 1000.0, "position": [0.0, 0.0, RADIUS + 0.04]}
    simulation = taichisoft.Simulation(
        taichisoft.scene_from_dict(
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
    force = seen.normal_forces[pair]
    assert force == pytest.approx(WEIGHT, rel=0.03)  # nearly at rest
    radius = (0.75 * force * RADIUS * (1.0 - RATIO**2) / MODULUS) ** (1 / 3)
    hertz, highest = np.pi * radius**2, 1.5 * force / (np.pi * radius**2)
    figures.at_most("area against Hertz", abs(seen.contact_areas[pair] / hertz - 1.0), area)
    figures.at_most("peak against Hertz", abs(seen.peak_pressures[pair] / highest - 1.0), peak)
    assert abs(seen.contact_areas[pair] - hertz) <= seen.contact_area_errors[pair]
    assert abs(seen.peak_pressures[pair] - highest) <= seen.peak_pressure_errors[pair]


@pytest.mark.parametrize(
    ("shape", "cells", "area"), [("capsule", 8, 0.15), ("cylinder", 8, 0.15), ("cylinder", 16, 0.03)]
)
def test_a_roller_presses_a_strip_as_hertz_says(tmp_path: Path, shape: str, cells: int, area: float) -> None:
    """Half the width b = sqrt(4 q R / (pi E*)) for a force q by length, and the peak 2 q / (pi b) (Hertz 1882).

    The strip of 3 mm is free to bulge sideways, so E* = E. Elements at the rim are 0.4 and 0.2 of b wide.
    """
    mesh = make_block((2 * cells, 1, cells), (2.0, 3.0, 1.0))
    x, y, z = mesh.nodes.T
    nodes = np.column_stack([20.0 * (0.3 * x + 0.7 * x**3), y, -DEPTH * np.abs(z.max() - z) ** 1.5])
    write_volume_mesh(replace(mesh, nodes=nodes).check(), tmp_path / "strip.msh")
    strip = soft(str(tmp_path / "strip.msh"), (-DEPTH - 0.1, -DEPTH + 0.1), poisson_ratio=RATIO)
    rod = {shape: {"radius": RADIUS, "length": 100.0}, "rotation": [90.0, 0.0, 0.0]}
    rod |= {"position": [0.0, 0.0, RADIUS + 0.1], "follows": "top"}
    seen, pair = pressed(1.0, soft_bodies={"strip": strip}, rigid_bodies={"rod": rod}), ("strip", "rod")
    load = seen.normal_forces[pair] / 3.0
    half = np.sqrt(4.0 * load * RADIUS / (np.pi * MODULUS))
    assert seen.contact_areas[pair] == pytest.approx(6.0 * half, rel=area)
    assert seen.peak_pressures[pair] == pytest.approx(2.0 * load / (np.pi * half), rel=0.03)
    assert abs(seen.contact_areas[pair] - 6.0 * half) <= seen.contact_area_errors[pair]
    assert abs(seen.peak_pressures[pair] - 2.0 * load / (np.pi * half)) <= seen.peak_pressure_errors[pair]


@pytest.mark.parametrize("ratio", [0.3, 0.45])
def test_errors_cover_a_ball_in_smoothed_elements(tmp_path: Path, ratio: float) -> None:
    """They touch twice as much as Hertz says where they are as large as the contact's radius, and the errors say so."""
    held, radius = (-DEPTH - 0.01, -DEPTH + 0.01), 8.0
    block = soft(rubber(tmp_path / "block.msh", 8), held, element="smoothed", poisson_ratio=ratio)
    ball = {"sphere": {"radius": radius}, "position": [0.4, 0.3, radius + 0.1], "follows": "top"}
    seen, pair = pressed(0.6, soft_bodies={"block": block}, rigid_bodies={"ball": ball}), ("block", "ball")
    hertz = np.pi * (0.75 * seen.normal_forces[pair] * radius * (1.0 - ratio**2) / MODULUS) ** (2 / 3)
    assert abs(seen.contact_areas[pair] - hertz) <= seen.contact_area_errors[pair]
    highest = 1.5 * seen.normal_forces[pair] / hertz
    assert abs(seen.peak_pressures[pair] - highest) <= seen.peak_pressure_errors[pair]


def test_a_smooth_ball_of_triangles_touches_as_a_round_one(tmp_path: Path) -> None:
    """80 triangles stand for the curved surface; their flat faces are up to 0.5 mm below it, its force 8 % smaller."""
    trimesh.creation.icosphere(subdivisions=1, radius=8.0).export(tmp_path / "ball.stl")
    block = soft(rubber(tmp_path / "block.msh", 11), (-DEPTH - 0.01, -DEPTH + 0.01), poisson_ratio=RATIO)
    held = {"position": [0.4, 0.3, 8.1], "follows": "top"}
    shapes = {"sphere": {"radius": 8.0}}, {"surface": str(tmp_path / "ball.stl"), "smooth": True}
    seen = [pressed(0.6, soft_bodies={"block": block}, rigid_bodies={"ball": shape | held}) for shape in shapes]
    pair = "block", "ball"
    round_one, smooth = (one.contact_areas[pair] / one.normal_forces[pair] ** (2 / 3) for one in seen)
    assert smooth == pytest.approx(round_one, rel=0.15)
    round_one, smooth = (one.peak_pressures[pair] / one.normal_forces[pair] ** (1 / 3) for one in seen)
    assert smooth == pytest.approx(round_one, rel=0.15)


def test_patches_of_a_pad_share_the_force_on_it() -> None:
    """The cube of 10 mm touches the middle of a pad's face: patches beside it feel nothing, all together the force."""
    table = "{box=[[-1,-20,-20],[30,20,20]], patches=[1,4,2]}"
    scene = load_scene(TINY_GRIPPER, [f"soft_bodies.left.tactile.pad={table}", "sensors.tactile={resolution=0.5}"])
    simulation = taichisoft.Simulation(scene)
    for _ in range(25):
        simulation.step(taichisoft.Control(pressure={"left.cavity": 9.0, "right.cavity": 9.0}))
    seen = simulation.observe()
    felt, force = seen.truth.tactile["left.pad"], seen.normal_forces["left", "cube"]
    assert felt.shape == (1, 4, 2) and force > 1.0
    assert felt.sum() == pytest.approx(force, rel=1e-9)
    assert (felt[0, [0, 3]] == 0.0).all()
    assert np.array_equal(seen.tactile["left.pad"], 0.5 * np.rint(2 * felt))
    area = seen.contact_areas["left", "cube"]
    assert 0.0 < force / area <= seen.peak_pressures["left", "cube"] * (1 + 1e-9)
