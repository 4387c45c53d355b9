"""Membranes, fibres, springs: forces by virtual work, a strip in tension, McKibben's angle of a wound cylinder."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from blocks import make_block
from conftest import Figures
from energy import total_energy
from scenes import silicone, simulate
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from taichisoft import Control, Simulation, VolumeMesh, write_volume_mesh
from taichisoft.errors import MeshError, SceneError
from taichisoft.mechanics import ElasticSystem
from taichisoft.mechanics.elasticity import internal_force
from taichisoft.mechanics.kernels.reinforcement_forces import CORD, SPRING
from taichisoft.mesh import boundary_triangles
from taichisoft.scene import scene_from_dict
from taichisoft.scene.scene import LEAST_NEWTON_OF_WRINKLES
from taichisoft.scene.soft_body import Helix

SIZE = (40.0, 10.0, 2.0)
STATIC = {"step": 0.01, "dynamics": "static"}
PAPER = {"group": "top", "thickness": 0.2, "young_modulus": 1e5}


def with_faces(mesh: VolumeMesh) -> VolumeMesh:
    """The mesh with its faces at the lowest and the highest z as the surface groups "bottom" and "top"."""
    walls = boundary_triangles(mesh.elements)
    height, ends = mesh.nodes[walls][..., 2], mesh.nodes[:, 2]
    groups = {name: walls[(height == end).all(axis=1)] for name, end in (("bottom", ends.min()), ("top", ends.max()))}
    return VolumeMesh(mesh.source, mesh.nodes, mesh.elements, {**mesh.surface_groups, **groups}).check()


@pytest.fixture(scope="module")
def strip(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("strip") / "strip.msh"
    write_volume_mesh(with_faces(make_block((8, 2, 1), SIZE)), path)
    return str(path)


def stretched(strain: np.ndarray, stiffness: np.ndarray) -> float:
    return float(0.5 * strain @ stiffness @ strain)


def relaxed(strain: np.ndarray, stiffness: np.ndarray) -> float:
    """The least energy with any W = R^T R added to E (Pipkin 1986), by a search from several sides."""
    scale = stiffness.max()

    def with_wrinkles(r: np.ndarray) -> tuple[float, np.ndarray]:
        added = np.array([r[0] ** 2, r[1] ** 2 + r[2] ** 2, 2.0 * r[0] * r[1]])
        slope = np.array([[2.0 * r[0], 0.0, 0.0], [0.0, 2.0 * r[1], 2.0 * r[2]], [2.0 * r[1], 2.0 * r[0], 0.0]])
        tension = stiffness @ (strain + added) / scale
        return 0.5 * float((strain + added) @ tension), tension @ slope

    size = np.sqrt(np.abs(strain).max())
    starts = size * np.array([[1.0, 0.1, 0.1], [0.1, 0.1, 1.0], [0.7, -0.7, 0.1], [0.7, 0.7, 0.1]])
    found = [minimize(with_wrinkles, start, method="BFGS", jac=True, options={"gtol": 1e-12}).fun for start in starts]
    return float(min(found) * scale)


def energy(simulation: Simulation, position: np.ndarray) -> float:
    """The sum of A E:C:E / 2 over membranes, L EA E^2 / 2 over fibres, k (l - L)^2 / 2 over springs [uJ], from
    positions alone.

    That of a part that slackens is the least with any shortening W >= 0 of its fibres added to E, found by search.
    """
    assert simulation.model.elasticity is not None and simulation.model.elasticity.reinforcements is not None
    parts, total = simulation.model.elasticity.reinforcements.parts, 0.0
    for p, (first, end) in enumerate(zip(parts.start[:-1], parts.start[1:], strict=True)):
        if parts.slackening[p] in (SPRING, CORD):
            stiffness, rest = parts.stiffness[p, :2]
            stretch = np.linalg.norm(np.diff(position[parts.node[first:end]], axis=0)) - rest
            total += 0.5 * stiffness * (max(stretch, 0.0) if parts.slackening[p] == CORD else stretch) ** 2
            continue
        gradient = position[parts.node[first:end]].T @ parts.gradient[first:end, :2]
        green = 0.5 * (gradient.T @ gradient - np.eye(2))
        if len(np.flatnonzero(parts.gradient[first:end, 1])) == 0:
            green[1, 1] = 0.0
        strain = np.array([green[0, 0], green[1, 1], 2.0 * green[0, 1]])
        stiffness = np.zeros((3, 3))
        stiffness[np.triu_indices(3)] = parts.stiffness[p]
        stiffness += np.triu(stiffness, 1).T
        total += parts.measure[p] * (relaxed if parts.slackening[p] else stretched)(strain, stiffness)
    return total


KINDS: dict[str, dict[str, Any]] = {
    "sheet": {"membranes": {"paper": {**PAPER, "poisson_ratio": 0.3}}},
    "threads": {"membranes": {"cloth": {**PAPER, "directions": [[1.0, 0.0, 0.0], [1.0, 2.0, 0.5]]}}},
    "fibre": {"fibres": {"line": {"points": [[-18, -4, 0.5], [0, 4, -0.5], [17, 0, 0]], "diameter": 0.2}}},
}
KINDS["fibre"]["fibres"]["line"]["young_modulus"] = 1e6
WEB = {"nodes": [[0, 53], [3, 30], [40, 10], [5, 20]], "stiffness": [500.0, 200.0, 0.0, 300.0]}
KINDS["springs"] = {"springs": {"web": WEB, "zero": {"nodes": [[1, 2]], "stiffness": 100.0, "length": 0.0}}}
KINDS["cords"] = {"springs": {"web": {**WEB, "length": [30.0, 12.0, 1.0, 90.0], "tension_only": True}}}
COARSE = {"start": [-15, 0, 0], "end": [15, 0, 0], "radius": 5.0, "angle": 30.0, "spacing": 11}
DENSE = {"start": [-15, 0, 0], "end": [15, 0, 0], "radius": 0.5, "angle": 60.0, "spacing": 2e-4}


SLACKENING = {
    "wrinkled sheet": {"membranes": {"paper": {**KINDS["sheet"]["membranes"]["paper"], "tension_only": True}}},
    "slack threads": {"membranes": {"cloth": {**KINDS["threads"]["membranes"]["cloth"], "tension_only": True}}},
}


@pytest.mark.parametrize("kind", [*KINDS, *SLACKENING])
def test_forces_are_the_slope_of_the_energy_and_the_matrix_that_of_the_forces(strip: str, kind: str) -> None:
    """In a state that is turned by 100 degrees and stretched, by central differences: 1e-6 of the largest.

    The matrix is without the damping and with the mass taken off; everything is in tension, so that nothing of the
    second part is left out. What slackens is crumpled as well, and has no compression to leave out.
    """
    bodies = {"strip": silicone(strip, element="linear", rayleigh_stiffness=0.0, rotation=[20.0, 0.0, 30.0])}
    plain = simulate(soft_bodies=bodies)
    reinforced = {"strip": {**bodies["strip"], **(KINDS | SLACKENING)[kind]}}
    simulation = simulate(time={"step": 0.01, "newton": 3}, soft_bodies=reinforced)
    rest, random = simulation.model.rest_position, np.random.default_rng(1)
    turn = Rotation.from_rotvec([1.0, -1.2, 0.7]).as_matrix()
    position = 1.1 * rest @ turn.T + 0.02 * random.normal(size=rest.shape)
    if kind in SLACKENING:
        position += 0.4 * random.normal(size=rest.shape)
    elastic = simulation.model.elasticity
    assert elastic is not None and plain.model.elasticity is not None
    force = internal_force(elastic, position) - internal_force(plain.model.elasticity, position)
    way = random.normal(size=rest.shape)
    slope = (energy(simulation, position + 1e-5 * way) - energy(simulation, position - 1e-5 * way)) / 2e-5
    assert -(force * way).sum() == pytest.approx(slope, rel=1e-6)
    assert force.sum(axis=0) == pytest.approx(np.zeros(3), abs=1e-9 * np.abs(force).max())
    turned = internal_force(elastic, position @ turn.T) - internal_force(plain.model.elasticity, position @ turn.T)
    assert turned == pytest.approx(force @ turn.T, abs=1e-9 * np.abs(force).max())

    def stiffness_times(model: Any) -> np.ndarray:
        system = ElasticSystem(model)
        system.position[:] = position
        system.assemble()
        product = np.zeros_like(way)
        for (row, column), block in zip(model.symbolic.block_pairs, system.solver.blocks, strict=True):
            product[row] += block @ way[column]
            if row != column:
                product[column] += block.T @ way[row]
        return product

    product = (stiffness_times(elastic) - stiffness_times(plain.model.elasticity)) / 0.01**2
    ahead, behind = (
        internal_force(elastic, position + d * way) - internal_force(plain.model.elasticity, position + d * way)
        for d in (1e-5, -1e-5)
    )
    assert product == pytest.approx(-(ahead - behind) / 2e-5, abs=1e-6 * np.abs(product).max())
    if kind in SLACKENING:
        assert simulation.model.elasticity is not None
        middle = [energy(simulation, position + d * way) for d in (-0.5, 0.0, 0.5)]
        assert middle[1] < 0.5 * (middle[0] + middle[2]) - 0.1 * middle[1], "the energy is convex"


def pulled(strip: str, force: float, young_modulus: float, sheet: dict[str, Any]) -> tuple[float, float]:
    """Stretch along and across [-] of a strip between two sheets, whose ends move freely across."""
    length, width, _ = SIZE
    sheets = {end: {"group": end, "thickness": 0.2, "young_modulus": 1e5, **sheet} for end in ("top", "bottom")}
    left, right = -length / 2.0, length / 2.0
    body = silicone(
        strip,
        element="linear",
        young_modulus=young_modulus,
        poisson_ratio=0.0,
        membranes=sheets,
        anchors=[
            {"box": [[left, -9, -9], [left, 9, 9]], "directions": ["x"]},
            {"box": [[-99, 0, -9], [99, 0, 9]], "directions": ["y"]},
            {"box": [[-99, -9, -1], [99, 9, -1]], "directions": ["z"]},
        ],
        forces=[  # half as much on nodes at the edges as on those between them
            {"box": [[right, -9, -9], [right, 9, 9]], "force": [0.75 * force, 0.0, 0.0]},
            {"box": [[right, -1, -9], [right, 1, 9]], "force": [0.25 * force, 0.0, 0.0]},
        ],
    )
    simulation = Simulation(scene_from_dict({"soft_bodies": {"strip": body}, "gravity": [0, 0, 0], "time": STATIC}))
    assert simulation.step().converged
    rest, position = simulation.model.rest_position, simulation.state.position
    end = rest[:, 0] > right - 1e-9
    stretch = 1.0 + float((position - rest)[end, 0].mean()) / length
    side = rest[:, 1] > width / 2.0 - 1e-9
    narrowed = 1.0 + float((position - rest)[side, 1].mean()) / (width / 2.0)
    return stretch, narrowed


@pytest.mark.parametrize(("ratio", "tension_only"), [(0.0, False), (0.3, False), (0.3, True)])
def test_a_strip_in_tension_stretches_by_the_stiffness_of_its_sheets(
    strip: str, figures: Figures, ratio: float, tension_only: bool
) -> None:
    """F = 2 E t w (stretch^3 - stretch) / 2 of two sheets under Green's strain, and -ratio times the strain across.

    Silicone of 0.01 kPa between them adds 1e-5 of it.
    """
    force, modulus = 2000.0, 2.0 * 1e5 * 0.2
    stretch, narrowed = pulled(strip, force, 0.01, {"poisson_ratio": ratio, "tension_only": tension_only})
    green, across = 0.5 * (stretch**2 - 1.0), 0.5 * (narrowed**2 - 1.0)
    figures.close(f"force of a strip of ratio {ratio:g}, mN", modulus * SIZE[1] * green * stretch, force, 1e-3 * force)
    figures.close(f"strain across of ratio {ratio:g}", across, -ratio * green, 1e-5)


@pytest.mark.parametrize("sheet", [{}, {"poisson_ratio": 0.3}, {"directions": [[1.0, 1.0, 0.0], [1.0, -1.0, 0.0]]}])
def test_a_strip_of_sheets_that_take_tension_alone_is_pressed_as_if_there_were_none(
    strip: str, figures: Figures, sheet: dict[str, Any]
) -> None:
    """Force over E times area of the silicone alone, under Hooke's law, where it does not widen: -4 %, to 0.2 % of it,
    since the forces on the nodes of the end stretch the sheets there a little."""
    stretch, narrowed = pulled(strip, -80.0, 100.0, {**sheet, "tension_only": True})
    figures.close("strain of a strip that is pressed", stretch - 1.0, -80.0 / (100.0 * SIZE[1] * SIZE[2]), 8e-5)
    assert narrowed == pytest.approx(1.0, abs=1e-4)
    assert pulled(strip, -80.0, 100.0, sheet)[0] > 0.97, "what does not slacken resists"


def test_nodes_on_springs_swing_and_come_to_rest(strip: str, figures: Figures) -> None:
    """By (1 - exp(-d t) (cos w t + d / w sin w t)) m g / k, d = c / 2 m, w^2 = k / m - d^2, from the length at rest.

    Every node of the end hangs on its own spring, beside elements of next to no stiffness; to 1 % of m g / k.
    """
    nodes = make_block((8, 2, 1), SIZE).nodes
    end, before = (np.flatnonzero(np.abs(nodes[:, 0] - x) < 1e-9) for x in (20.0, 15.0))
    stiffness, damping, gravity = 2.0, 1e-3, 9810.0
    springs = {"nodes": np.column_stack([before, end]).tolist(), "stiffness": stiffness, "damping": damping}
    body = silicone(
        strip,
        element="linear",
        corotation="none",
        young_modulus=1e-9,
        rayleigh_mass=0.0,
        rayleigh_stiffness=0.0,
        springs={"holders": springs},
        anchors=[{"box": [[-99, -99, -99], [16, 99, 99]], "stiffness": 1e9}],
    )
    time = {"step": 1e-4, "theta": 0.55}
    simulation = Simulation(scene_from_dict({"soft_bodies": {"strip": body}, "gravity": [gravity, 0, 0], "time": time}))
    assert simulation.model.elasticity is not None
    mass = simulation.model.elasticity.node_mass[end]
    decay = damping / (2.0 * mass)
    frequency = np.sqrt(stiffness / mass - decay**2)
    for _ in range(4):
        for _ in range(60):
            simulation.step()
        now = simulation.state.time
        swing = np.cos(frequency * now) + decay / frequency * np.sin(frequency * now)
        moved = (simulation.state.position - simulation.model.rest_position)[end, 0] * stiffness / (mass * gravity)
        error = np.abs(moved - 1.0 + np.exp(-decay * now) * swing).max()
        figures.at_most(f"swing at {now:.3f} s over m g / k", error, 0.01)


RADIUS, LENGTH = 10.0, 60.0


@pytest.fixture(scope="module")
def tube(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A hollow block whose cross-section has become a disc: a cylinder with a wall of 1 mm, closed at both ends."""
    block = make_block((8, 8, 12), (2.0, 2.0, LENGTH), hollow=True)
    x, y = block.nodes[:, :2].T
    ring = np.maximum(np.abs(x), np.abs(y))
    radius = np.where(ring > 0.76, RADIUS - 4.0 * (1.0 - ring), ring / 0.75 * (RADIUS - 1.0))
    with np.errstate(invalid="ignore", divide="ignore"):
        angle = np.where(np.abs(x) >= np.abs(y), np.arctan2(0.0, x) + np.pi / 4.0 * np.nan_to_num(y / x), 0.0)
        angle = np.where(np.abs(x) < np.abs(y), np.arctan2(y, 0.0) - np.pi / 4.0 * np.nan_to_num(x / y), angle)
    nodes = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), block.nodes[:, 2]])
    path = tmp_path_factory.mktemp("tube") / "tube.msh"
    write_volume_mesh(VolumeMesh("tube", nodes, block.elements, block.surface_groups).check(), path)
    return str(path)


def inflated(tube: str, pressure: float, **body: Any) -> tuple[float, float, float]:
    """Strain along the axis and around it in the middle of the tube [-], and the turn of its upper half [radians]."""
    table = silicone(
        tube,
        young_modulus=200.0,
        anchors=[{"box": [[-99, -99, -30], [99, 99, -29.9]]}],
        cavities={"air": {"group": "cavity"}},
        **body,
    )
    simulation = Simulation(scene_from_dict({"soft_bodies": {"tube": table}, "gravity": [0, 0, 0], "time": STATIC}))
    report = simulation.step(Control(pressure={"tube.air": pressure}))
    assert report.converged
    rest, position = simulation.model.rest_position, simulation.state.position
    outer = np.hypot(rest[:, 0], rest[:, 1]) > RADIUS - 0.1
    low, high = (outer & (np.abs(rest[:, 2] - place) < 0.1) for place in (-10.0, 10.0))
    along = (position[high, 2].mean() - position[low, 2].mean()) / 20.0 - 1.0
    radius = np.hypot(*(position[low | high, :2]).T).mean()
    (x, y), (a, b) = rest[high, :2].T, position[high, :2].T
    turned = np.arctan2(x * b - y * a, x * a + y * b)
    return float(along), float(radius / RADIUS - 1.0), float(turned.mean())


def wound(angle: float, hand: str = "both") -> dict[str, Any]:
    helix = {"start": [0, 0, -28], "end": [0, 0, 28], "radius": 9.9, "angle": angle, "hand": hand, "count": 8}
    return {"fibres": {"aramid": {"helix": helix, "diameter": 0.2, "young_modulus": 1e8}}}


def test_a_wound_cylinder_keeps_its_shape_at_one_angle_and_shortens_below_it_and_grows_above(
    tube: str, figures: Figures
) -> None:
    """Threads that cannot stretch and carry p pi R^2 along and p R around the axis are at atan(sqrt 2), 54.7 degrees,
    to the axis. There 4 % of the strain without threads is left, since the wall is a tenth of the radius thick."""
    pressure = 1.0
    _, plain, _ = inflated(tube, pressure)
    strains = {angle: inflated(tube, pressure, **wound(angle)) for angle in (45.0, 54.7356, 65.0)}
    for number, which in enumerate(("along", "around")):
        figures.at_most(f"strain {which} at 54.7 degrees of {plain:.3g}", abs(strains[54.7356][number]), 0.04 * plain)
    assert strains[45.0][0] < -0.3 * plain and strains[45.0][1] > 0.3 * plain
    assert strains[65.0][0] > 0.3 * plain and strains[65.0][1] < 0.0
    assert abs(strains[45.0][2]) < 1e-9


def test_threads_of_one_hand_twist_a_cylinder_the_way_that_unwinds_them(tube: str) -> None:
    right, left = (inflated(tube, 1.0, **wound(54.7356, hand))[2] for hand in ("right", "left"))
    assert right < -0.05 < 0.05 < left
    assert right == pytest.approx(-left, rel=0.02)


def pad(path: Path, layer: float) -> str:
    """A hollow pad with a layer of elements below it, which replaces as much of its height, or without one."""
    cells, half = (16, 4, 5), 5.0
    block = make_block((cells[0], cells[1], cells[2] + bool(layer)), (60.0, 10.0, 2.0))
    level = np.rint((block.nodes[:, 2] + 1.0) / 2.0 * (cells[2] + bool(layer))).astype(int)
    heights = np.linspace(-half, half, cells[2] + 1)
    if layer:
        heights = np.concatenate([[-half - layer / 2.0, -half + layer / 2.0], heights[1:]])
    nodes = np.column_stack([block.nodes[:, :2], heights[level]])
    middle = nodes[block.elements].mean(axis=1)
    inner = (np.abs(middle[:, 0]) < 26.25) & (np.abs(middle[:, 1]) < 2.5)
    inner &= (middle[:, 2] > heights[1 + bool(layer)]) & (middle[:, 2] < heights[-2])
    used, elements = np.unique(block.elements[~inner], return_inverse=True)
    elements, nodes = elements.reshape(-1, 4), nodes[used]
    walls = boundary_triangles(elements)
    inside = (np.abs(nodes[walls]) < [30.0, 5.0, half - layer]).all(axis=(1, 2))
    bottom = (nodes[walls][..., 2] == heights[0]).all(axis=1)
    groups = {"cavity": walls[inside][:, ::-1], "bottom": walls[bottom]}
    write_volume_mesh(VolumeMesh("pad", nodes, elements, groups).check(), path)
    return str(path)


def test_a_membrane_bends_an_inflated_pad_as_a_thin_layer_of_elements_does(tmp_path: Path, figures: Figures) -> None:
    """Within 3 %: a layer of 0.3 mm and 20 MPa below silicone of 0.2 MPa, whose own stiffness in bending is small."""
    layer = 0.3
    paper = {"group": "bottom", "thickness": layer, "young_modulus": 2e4, "poisson_ratio": 0.3}
    region = {"box": [[-99, -99, -6], [99, 99, -5 + layer / 2]], "young_modulus": 2e4}
    ends = {}
    for name, mesh, keys in (
        ("membrane", pad(tmp_path / "without.msh", 0.0), {"membranes": {"paper": paper}}),
        ("layer", pad(tmp_path / "with.msh", layer), {"regions": [region]}),
        ("silicone", pad(tmp_path / "without.msh", 0.0), {}),
    ):
        anchors = [{"box": [[-31, -9, -9], [-29.9, 9, 9]]}]
        body = silicone(mesh, young_modulus=200.0, anchors=anchors, cavities={"air": {"group": "cavity"}}, **keys)
        simulation = Simulation(scene_from_dict({"soft_bodies": {"pad": body}, "gravity": [0, 0, 0], "time": STATIC}))
        simulation.step(Control(pressure={"pad.air": 3.0}))
        moved = simulation.state.position - simulation.model.rest_position
        ends[name] = float(moved[simulation.model.rest_position[:, 0] > 29.9, 2].mean())
    assert abs(ends["silicone"]) < 0.1 * abs(ends["layer"])
    figures.close("end of the pad, mm", ends["membrane"], ends["layer"], 0.03 * abs(ends["layer"]))


@pytest.mark.parametrize(("tension_only", "newton"), [(False, 1), (True, LEAST_NEWTON_OF_WRINKLES)])
def test_a_sheet_that_is_thrown_gains_no_energy(strip: str, tension_only: bool, newton: int) -> None:
    """It turns and waves, without damping, with as few linearisations as are allowed: the energy of all falls."""
    paper = {**PAPER, "tension_only": tension_only}
    body = silicone(strip, element="linear", rayleigh_stiffness=0.0, membranes={"paper": paper})
    simulation = simulate(time={"step": 0.001, "newton": newton}, soft_bodies={"strip": body})
    x, y, _ = simulation.model.rest_position.T
    velocity = np.column_stack([-5.0 * y, 5.0 * x, 300.0 * np.sin(x / 5.0)])
    simulation.restore(replace(simulation.state, velocity=velocity))
    energies = []
    for _ in range(10):
        energies.append(total_energy(simulation) + energy(simulation, simulation.state.position))
        simulation.step()
    assert np.diff(energies).max() <= 1e-9 * energies[0]


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"membranes": {"paper": {**PAPER, "group": "tpo"}}}, "no such surface group; there are: bottom, outer, top"),
        ({"membranes": {"paper": {**PAPER, "directions": [[0.0, 0.0, 1.0]]}}}, "is across all of group 'top'"),
        ({"membranes": {"paper": {**PAPER, "directions": [[0.0, 0.0, 0.0]]}}}, "directions.0: [0.0, 0.0, 0.0] has no"),
        (
            {"membranes": {"paper": {**PAPER, "directions": [[1, 2, 0], [-2, -4, 0]]}}},
            "directions has two along one line",
        ),
        ({"membranes": {"paper": {**PAPER, "thickness": 0.0}}}, "membranes.paper.thickness"),
        ({"membranes": {"paper": {**PAPER, "tension_only": True}}}, "time.newton = 1 must be at least 3"),
        ({"membranes": {"paper": PAPER}, "element": "quadratic"}, 'not element = "quadratic"'),
        ({"springs": {"web": {**WEB, "stiffness": [1.0, 2.0]}}}, "stiffness has 2 numbers for 4 springs"),
        ({"springs": {"web": {"nodes": [[0, 54]], "stiffness": 1.0}}}, "names node 54; "),
        ({"springs": {"web": {"nodes": [[7, 7]], "stiffness": 1.0}}}, "nodes joins node 7 to itself"),
        ({"springs": {"web": {"nodes": [[7, 8]], "stiffness": float("nan")}}}, "springs.web.stiffness"),
        ({"springs": {"web": {**WEB, "damping": -1.0}}}, "springs.web.damping"),
        ({"springs": {"web": WEB}, "element": "quadratic"}, 'not element = "quadratic"'),
        ({"fibres": {"line": {"points": [[0, 0, 0], [90, 0, 0]], "diameter": 1, "young_modulus": 1}}}, "lies outside"),
        ({"fibres": {"line": {"points": [[0, 0, 0], [0, 0, 0]], "diameter": 1, "young_modulus": 1}}}, "are the same"),
        ({"fibres": {"line": {"diameter": 1, "young_modulus": 1}}}, "exactly one of points, helix is needed"),
        (
            {"fibres": {"line": {"helix": COARSE, "diameter": 1, "young_modulus": 1}}},
            "= 11 must be at most 10 mm",
        ),
        ({"fibres": {"line": {"helix": DENSE, "diameter": 1, "young_modulus": 1}}}, "asks for 600000 straight pieces"),
    ],
)
def test_what_is_wrong_with_a_reinforcement_is_said_in_one_line(strip: str, keys: dict[str, Any], message: str) -> None:
    with pytest.raises((SceneError, MeshError)) as refused:
        simulate(soft_bodies={"strip": silicone(strip, **keys)})
    assert message in str(refused.value) and "\n" not in str(refused.value)


def test_a_helix_lies_on_its_cylinder_at_its_angle() -> None:
    helix = Helix(start=(1.0, 2.0, 3.0), end=(1.0, 32.0, 3.0), radius=5.0, angle=60.0, count=3, spacing=0.1)
    lines = helix.lines()
    assert len(lines) == 6
    for line in lines:
        assert np.hypot(line[:, 0] - 1.0, line[:, 2] - 3.0) == pytest.approx(np.full(len(line), 5.0))
        assert line[[0, -1], 1] == pytest.approx([2.0, 32.0])
        pieces = np.diff(line, axis=0)
        slope = np.degrees(np.arccos(pieces[:, 1] / np.linalg.norm(pieces, axis=1)))
        assert slope == pytest.approx(np.full(len(pieces), 60.0), abs=0.01)
