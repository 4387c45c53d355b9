"""What becomes of a SOFA scene: bodies, contact and appearance, one line for each departure, and what is refused."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from blocks import make_block
from scenes_of_sofa import BODY, loaded

from taichisoft import VolumeMesh, read_volume_mesh, write_volume_mesh
from taichisoft.errors import ControllerFailed, SceneError
from taichisoft.mesh import boundary_triangles, write_stl
from taichisoft.scene import scene_from_dict
from taichisoft_sofa.components.force_fields import MATERIALS
from taichisoft_sofa.components.visuals import NAMED
from taichisoft_sofa.scene_reader import with_files_in
from taichisoft_sofa.translation.parts import Translation
from taichisoft_sofa.translation.translate import translate

VISUAL = """
def visual(node, mapping, **colour):
    child = node.addChild("Visual")
    child.addObject("MeshOBJLoader", name="loader", filename="mesh/cube.obj")
    child.addObject("OglModel", src="@loader", **colour)
    child.addObject(mapping)

def cube(root, name, solver, **shown):
    node = root.addChild(name)
    if solver:
        node.addObject("EulerImplicitSolver")
        node.addObject("CGLinearSolver")
        node.addObject("UncoupledConstraintCorrection")
    node.addObject("MechanicalObject", template="Rigid3", **shown)
    node.addObject("UniformMass", totalMass=0.1)
    surface(node, "mesh/cube.obj", mapping="RigidMapping")
    return node
"""

SIZE = (20.0, 10.0, 10.0)
UNIT = "FreeMotionAnimationLoop"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with a block of 2 x 1 x 1 boxes about the origin, and its surface."""
    block = make_block((2, 1, 1), SIZE)
    write_volume_mesh(block, tmp_path / "block.vtk")
    write_stl(block.nodes, boundary_triangles(block.elements), tmp_path / "block.stl")
    (tmp_path / "open.obj").write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n")
    return tmp_path


def translated(folder: Path, create: str, exact: bool = False) -> Translation:
    return translate(loaded(folder, create, BODY + VISUAL), exact)


def mesh_of(translation: Translation, folder: Path, body: str) -> VolumeMesh:
    translation.files.write(folder)
    return read_volume_mesh(folder / translation.tables["soft_bodies"][body]["mesh"])


def test_soft_body_takes_mesh_mass_and_material(folder: Path) -> None:
    translation = translated(
        folder,
        """
        root.gravity = [0, -9810, 0]
        root.dt = 0.02
        finger = body(root, "finger", rotation=[0, 0, 90], translation=[1, 2, 3])
        finger.addObject("BoxROI", name="roi", box=[-100, -100, -100, 100, -7.9, 100])
        finger.addObject("RestShapeSpringsForceField", points="@roi.indices", stiffness=1e6)
        """,
    )
    assert not translation.refused
    table = translation.tables["soft_bodies"]["finger"]
    expected = {"mass": 0.05, "young_modulus": 500.0, "poisson_ratio": 0.3, "regions": []}
    expected |= {"element": "linear", "corotation": "edges"}
    assert expected.items() <= table.items()
    assert (table["rayleigh_mass"], table["rayleigh_stiffness"]) == (0.2, 0.1)
    assert translation.tables["gravity"] == [0.0, -9810.0, 0.0]
    assert translation.tables["time"] == {"step": 0.02}
    block = make_block((2, 1, 1), SIZE)
    turned = block.nodes[:, [1, 0, 2]] * [-1, 1, 1] + [1, 2, 3]
    mesh = mesh_of(translation, folder, "finger")
    assert mesh.nodes == pytest.approx(turned, abs=1e-13)
    assert (mesh.elements == block.elements).all()
    (anchor,) = table["anchors"]
    assert anchor["nodes"] == np.flatnonzero(block.nodes[:, 0] == -10.0).tolist()
    assert anchor["stiffness"] == 1e6


@pytest.mark.parametrize("poisson", [0.3, 0.45])
def test_overlapping_force_fields_add_lame_parameters(folder: Path, poisson: float) -> None:
    translation = translated(
        folder,
        f"""
        finger = body(root)
        finger.addObject("BoxROI", name="layer", box=[0, -100, -100, 100, 100, 100], strict=False)
        stiff = finger.addChild("stiff")
        stiff.addObject("TetrahedronSetTopologyContainer", position="@../loader.position",
                        tetrahedra="@layer.tetrahedraInROI")
        stiff.addObject("TetrahedronFEMForceField", youngModulus="1000", poissonRatio={poisson})
        """,
    )
    assert not translation.refused
    (region,) = translation.tables["soft_bodies"]["body"]["regions"]
    block = make_block((2, 1, 1), SIZE)
    right = np.flatnonzero(block.nodes[block.elements].mean(axis=1)[:, 0] > 0.0)
    assert mesh_of(translation, folder, "body").element_groups[region["group"]].tolist() == right.tolist()
    young, ratio = region["young_modulus"], region["poisson_ratio"]

    def lame(young: float, ratio: float) -> np.ndarray:
        return np.array([young * ratio / ((1 + ratio) * (1 - 2 * ratio)), young / (2 * (1 + ratio))])

    assert lame(young, ratio) == pytest.approx(lame(500.0, 0.3) + lame(1000.0, poisson), rel=1e-14)
    if poisson == 0.3:
        assert (young, ratio) == (1500.0, 0.3)  # to the last bit, where no arithmetic is needed


def test_unused_points_take_their_share_of_mass(folder: Path) -> None:
    block = make_block((2, 1, 1), SIZE)
    nodes = np.vstack([[[99.0, 0.0, 0.0]], block.nodes])
    write_volume_mesh(VolumeMesh("more", nodes, block.elements + 1), folder / "more.vtk")
    translation = translated(
        folder, 'node = body(root, mesh="more.vtk"); node.addObject("FixedConstraint", indices=[3])'
    )
    table = translation.tables["soft_bodies"]["body"]
    assert table["mass"] == pytest.approx(0.05 * 12 / 13)
    assert table["anchors"][0]["nodes"] == [2]
    assert any("1 points that belong to no tetrahedron" in line for line in translation.departures)
    assert mesh_of(translation, folder, "body").nodes.tolist() == block.nodes.tolist()


@pytest.mark.parametrize(
    ("settings", "made"),
    [
        ("materialName='StVenantKirchhoff', ParameterSet='192 288'", ("hooke", 499.2, 0.3)),
        ("materialName='NeoHookean', ParameterSet=[192, 288]", ("neo-hookean", 499.2, 0.3)),
        ("materialName='StableNeoHookean', ParameterSet=[192, 288]", ("neo-hookean", 499.2, 0.3)),
        ("materialName='MooneyRivlin', ParameterSet='50 46 416'", ("mooney-rivlin", {"c10": 50, "c01": 46}, 0.3)),
        ("materialName='Ogden', ParameterSet='384 3 416'", ("ogden", {"mu1": 128, "alpha1": 3}, 0.3)),
        (
            "materialName='Costa', ParameterSet='1 2 3'",
            "materialName 'Costa'; known are: StVenantKirchhoff, NeoHookean",
        ),
        ("materialName='NeoHookean', ParameterSet='1'", "ParameterSet = [1.0]; NeoHookean has 2 parameters"),
        ("materialName='NeoHookean', ParameterSet='1 -2'", "and a Poisson's ratio of"),
        ("materialName='Ogden', ParameterSet='1 0 3'", "makes a shear modulus of nan kPa"),
    ],
)
def test_hyperelastic_force_fields_become_laws(folder: Path, settings: str, made: Any) -> None:
    """With mu = 192 and lambda = 288 kPa, a bulk modulus of 416: E = mu (3 lambda + 2 mu) / (lambda + mu)."""
    translation = translated(
        folder,
        f"""
        node = body(root)
        node.removeObject(node.TetrahedronFEMForceField)
        node.addObject("TetrahedronHyperelasticityFEMForceField", {settings})
        """,
    )
    if isinstance(made, str):
        assert any(made in line for line in translation.refused)
        return
    assert not translation.refused
    table = translation.tables["soft_bodies"]["body"]
    moduli = table.get("coefficients", table.get("young_modulus"))
    assert (table["law"], moduli, table["poisson_ratio"]) == (made[0], *map(pytest.approx, made[1:]))
    differs = any("% more where a bar" in line or "% less where a bar" in line for line in translation.departures)
    assert differs == ("Stable" not in settings)


@pytest.mark.parametrize("name", MATERIALS)
def test_sofas_energies_and_native_laws_agree_for_small_strains(name: str) -> None:
    """Their difference is of third order in the strains: of strains s it is below 10 mu s^3."""
    parameters = {"MooneyRivlin": (50.0, 46.0, 416.0), "Ogden": (384.0, 3.0, 416.0)}.get(name, (192.0, 288.0))
    made = MATERIALS[name][1](*parameters)
    for strains in np.random.default_rng(1).uniform(-1.0, 1.0, (20, 3)):
        for size in (0.01, 0.03):
            rest = made.energy(np.ones(3)) - made._native(np.ones(3))
            difference = made.energy(1.0 + size * strains) - made._native(1.0 + size * strains) - rest
            assert abs(difference) < 10 * 192 * size**3


def test_inverted_tetrahedron_keeps_its_first_edge(folder: Path) -> None:
    block = make_block((2, 1, 1), SIZE)
    elements = block.elements.copy()
    elements[3] = elements[3][[0, 1, 3, 2]]
    write_volume_mesh(VolumeMesh("one turned", block.nodes, elements), folder / "turned.vtk")
    translation = translated(folder, 'body(root, mesh="turned.vtk")')
    made = mesh_of(translation, folder, "body").elements
    assert made[3].tolist() == elements[3][[1, 0, 2, 3]].tolist()
    assert (np.delete(made, 3, axis=0) == np.delete(elements, 3, axis=0)).all()


@pytest.mark.parametrize(("exact", "held"), [(False, 0), (True, 12)])
def test_body_moves_without_constraint_correction(folder: Path, exact: bool, held: int) -> None:
    translation = translated(folder, "free_motion(root)\nbody(root, correction=False)", exact)
    anchors = translation.tables["soft_bodies"]["body"]["anchors"]
    assert sum(len(anchor["nodes"]) for anchor in anchors) == held
    (line,) = [line for line in translation.departures if "constraint correction" in line]
    assert ("stands still" in line) is exact


@pytest.mark.parametrize(("exact", "selected"), [(False, [0, 1, 3]), (True, [0, 3])])
def test_round_off_of_zero_is_removed(folder: Path, exact: bool, selected: list[int]) -> None:
    """SOFA's loader leaves nodes of a turned block 1e-30 outside the plane y = 0; what is 1e-15 outside is no zero."""
    translation = translated(
        folder,
        """
        node = body(root)
        points = [[100, y, 0] for y in (0.0, -1e-30, -1e-15, 1.0)]
        node.addObject("BoxROI", name="roi", position=points, box=[-1, 0, -1, 101, 1, 1])
        node.addObject("FixedConstraint", indices="@roi.indices")
        """,
        exact,
    )
    assert translation.tables["soft_bodies"]["body"]["anchors"][0]["nodes"] == selected
    said = [line for line in translation.departures if "/body/roi: point 1 lies on a face" in line]
    assert len(said) == (not exact)


CUBE = """
collisions(root)
cube = root.addChild("cube")
{solver}
cube.addObject("MechanicalObject", template="Rigid3", dx=10, ry=90)
cube.addObject("UniformMass", {mass})
cube.addObject("UncoupledConstraintCorrection")
surface(cube, "mesh/cube.obj", mapping="RigidMapping")
"""
SOLVER = 'cube.addObject("EulerImplicitSolver"); cube.addObject("CGLinearSolver", threshold=1e-5)'


@pytest.mark.parametrize(
    ("mass", "exact", "total", "inertia"),
    [
        ("totalMass=0.002", False, 0.002, None),
        ("totalMass=0.002", True, 0.002, np.diag([0.002] * 3)),
        ("vertexMass=[0.03, 20, [1000.0, 0, 0, 0, 900.0, 0, 0, 0, 800.0]]", False, 0.03, np.diag([30.0, 27.0, 24.0])),
        ("mass='0.03 10 1000 0 0 0 1000 0 0 0 1000'", True, 0.03, np.diag([30.0] * 3)),
        ("vertexMass=[1.0, 1.0, [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]]", False, 1.0, None),
    ],
)
def test_rigid_body_takes_inertia_of_its_shape(
    folder: Path, mass: str, exact: bool, total: float, inertia: np.ndarray | None
) -> None:
    translation = translated(folder, CUBE.format(solver=SOLVER, mass=mass), exact)
    assert not translation.refused
    table = translation.tables["rigid_bodies"]["cube"]
    assert table["mass"] == total
    assert table["position"] == [10.0, 0.0, 0.0]
    assert table["rotation"] == pytest.approx([0.0, 90.0, 0.0], abs=1e-12)
    assert ("inertia" in table) == (inertia is not None)
    if inertia is not None:
        assert np.array(table["inertia"]) == pytest.approx(inertia)
    assert any("inertia of its shape" in line for line in translation.departures) == (inertia is None)


@pytest.mark.parametrize(("mass", "lost"), [(0.001, True), (0.5, False)])
def test_a_weight_that_sofa_loses_is_said_to_be_there(folder: Path, mass: float, lost: bool) -> None:
    """SOFA's conjugate gradient does nothing where m (h m g)^2 is below its threshold."""
    create = f"root.gravity = [0, 0, -9810]\n{CUBE.format(solver=SOLVER, mass=f'totalMass={mass}')}"
    assert any("weight" in line for line in translated(folder, create).departures) == lost


def test_rigid_body_without_solver_becomes_obstacle(folder: Path) -> None:
    translation = translated(folder, CUBE.format(solver="", mass="totalMass=1"))
    assert "rigid_bodies" not in translation.tables
    name = translation.tables["obstacles"]["cube"]["surface"]
    translation.files.write(folder)
    from taichisoft.mesh import read_surface

    points, _ = read_surface(folder / name)
    assert points.min(axis=0) == pytest.approx([9.0, -1.0, -1.0])


CAVITY = """
cavity = node.addChild("chamber")
cavity.addObject("MeshSTLLoader", name="loader", filename="{mesh}")
cavity.addObject("MeshTopology", src="@loader", name="topo")
cavity.addObject("MechanicalObject")
cavity.addObject("SurfacePressureConstraint", triangles="@topo.triangles", value=2, {settings})
cavity.addObject("BarycentricMapping", mapForces=False, mapMasses=False)
"""


FLOOR = """
floor = root.addChild("floor")
floor.addObject("MechanicalObject", template="Rigid3")
surface(floor, "block.stl", mapping="RigidMapping")
"""
CABLE = """
free_motion(root)
cable = body(root).addChild("cable")
cable.addObject("MechanicalObject", position="9 9 9  5 0 0  -5 0 0", translation=[0, 1, 0])
cable.addObject("CableConstraint", indices="1 2", {})
cable.addObject("BarycentricMapping")
"""
CABLES = """
free_motion(root)
wires = body(root).addChild("wires")
wires.addObject("MechanicalObject", position="5 0 0  -5 0 0")
for name in {}: wires.addObject("CableConstraint", name=name, indices="0 1")
wires.addObject("BarycentricMapping")
"""


def cavity(settings: str) -> str:
    """A scene with the whole block as an air chamber."""
    return "free_motion(root)\nnode = body(root)\n" + CAVITY.format(mesh="block.stl", settings=settings)


def held(directions: str) -> str:
    """A scene with a block whose points are held along some axes."""
    return f'body(root).addObject("PartialFixedConstraint", indices=[0, 1, 2], fixedDirections="{directions}")'


def response(settings: str) -> str:
    """A scene with another response to contacts."""
    manager = f"root.addObject('RuleBasedContactManager', {settings})"
    return f"collisions(root)\n{manager}\nsurface(body(root), 'block.stl')"


def shown(settings: str) -> str:
    """A scene with a block and a component of its appearance."""
    return f"body(root)\nroot.addObject({settings})"


BODY_TABLE, CHAMBER, CABLE_TABLE = (
    "soft_bodies.body",
    "soft_bodies.body.cavities.chamber",
    "soft_bodies.body.cables.cable",
)
MISSING = object()


@pytest.mark.parametrize(
    ("create", "expected"),
    [
        (held("0 1 0"), {f"{BODY_TABLE}.anchors.0.directions": ["y"]}),
        (held("1 0 1"), {f"{BODY_TABLE}.anchors.0.directions": ["x", "z"]}),
        (held("1 1 1"), {f"{BODY_TABLE}.anchors.0.directions": MISSING}),
        (held("0 0 0"), {f"{BODY_TABLE}.anchors": []}),
        # Bodies whose nodes share a name are named after the nodes above.
        (
            'for i in (1, 2): body(root.addChild(f"Finger{i}"), "Elastic")',
            {"soft_bodies": ["Finger1", "Finger2"]},
        ),
        # Without a solver a body stands still.
        (
            'body(root).removeObject("EulerImplicitSolver")',
            {f"{BODY_TABLE}.anchors.0.nodes": list(range(12))},
        ),
        (
            "collisions(root, mu=0.3)\nsurface(body(root), 'block.stl')",
            {
                "contact.friction": 0.3,
                "contact.alarm_distance": 5.0,
                "contact.contact_distance": 1.0,
                "contact.spacing": 4.0,
            },
        ),
        (response('response="FrictionContact?mu=0.25"'), {"contact.friction": 0.25}),
        (response('response="FrictionContact", rules="0 * FrictionContact?mu=0.1"'), {"contact.friction": 0.8}),
        (response('response="FrictionContactConstraint", responseParams="mu=1e-1"'), {"contact.friction": 0.1}),
        # Without a collision pipeline bodies go through each other.
        (
            CUBE.format(solver=SOLVER, mass="totalMass=1").replace("collisions", "free_motion")
            + f"\nsurface(body(root), 'block.stl')\n{FLOOR}",
            {"rigid_bodies.cube.collides": False, f"{BODY_TABLE}.collides": False, "obstacles": MISSING},
        ),
        (
            "collisions(root)\nnode = body(root)\nsurface(node, 'block.stl', 'outer', group=[1, 2])\n"
            "surface(node, 'open.obj', 'part', group='1')",
            {
                f"{BODY_TABLE}.collision_surface.0.groups": [1, 2],
                f"{BODY_TABLE}.collision_surface.0.open": MISSING,
                f"{BODY_TABLE}.collision_surface.1.groups": [1],
                f"{BODY_TABLE}.collision_surface.1.open": True,
            },
        ),
        *(
            (
                f"collisions(root)\nsurface(body(root), 'block.stl', selfCollision={own})",
                {f"{BODY_TABLE}.self_contact": own or MISSING},
            )
            for own in (True, False)
        ),
        (
            cavity("minPressure=-0.5, maxPressure=1.5"),
            {f"{CHAMBER}.lowest_pressure": -50.0, f"{CHAMBER}.highest_pressure": pytest.approx(150.0)},
        ),
        (
            cavity("flipNormal=True, maxPressure=1.5"),
            {f"{CHAMBER}.lowest_pressure": pytest.approx(-150.0), f"{CHAMBER}.highest_pressure": MISSING},
        ),
        (
            cavity("maxVolumeGrowth=40, minVolumeGrowth=-1e308"),
            {f"{CHAMBER}.highest_volume_growth": 40.0, f"{CHAMBER}.lowest_volume_growth": -1e30},
        ),
        (
            CABLE.format(""),
            {
                f"{CABLE_TABLE}.points": [[5.0, 1.0, 0.0], [-5.0, 1.0, 0.0]],
                f"{CABLE_TABLE}.pull_point_moves": False,
                f"{CABLE_TABLE}.rod": True,
                f"{CABLE_TABLE}.pull_point": [0.0, 0.0, 0.0],
            },
        ),
        (
            CABLE.format("minForce=0, pullPoint='1 2 3'"),
            {
                f"{CABLE_TABLE}.lowest_tension": 0.0,
                f"{CABLE_TABLE}.rod": MISSING,
                f"{CABLE_TABLE}.pull_point": [1.0, 2.0, 3.0],
            },
        ),
        (
            CABLE.format("minForce=-1, maxForce=2.5"),
            {
                f"{CABLE_TABLE}.rod": True,
                f"{CABLE_TABLE}.lowest_tension": -100.0,
                f"{CABLE_TABLE}.highest_tension": 250.0,
            },
        ),
        (CABLE.format("maxForce=1.7976931348623157e308"), {f"{CABLE_TABLE}.highest_tension": 1e30}),
        (
            CABLE.format("maxPositiveDisp=6, maxNegativeDisp=2"),
            {f"{CABLE_TABLE}.highest_pull": 6.0, f"{CABLE_TABLE}.lowest_pull": -2.0},
        ),
        (CABLE.format("hasPullPoint=False"), {f"{CABLE_TABLE}.rod": True, f"{CABLE_TABLE}.pull_point": MISSING}),
        # Cables that share a node keep their own names.
        (CABLES.format(["left", "right"]), {f"{BODY_TABLE}.cables": ["left", "right"]}),
        (CABLES.format(["left"]), {f"{BODY_TABLE}.cables": ["wires"]}),
        (CABLES.format(["a/b", "a"]), {f"{BODY_TABLE}.cables": ["a_b", "a"]}),
        (shown("'BackgroundSetting', color='#1a2B3c'"), {"appearance": {"background": "#1a2b3c"}}),
        (shown("'BackgroundSetting', color='#1a2b3cff'"), {"appearance.background": "#1a2b3c"}),
        (shown("'BackgroundSetting', color=' Gray '"), {"appearance.background": NAMED["gray"]}),
        (shown("'BackgroundSetting', color=[1.2, -0.1, 0.5]"), {"appearance.background": "#ff0080"}),
        (shown("'BackgroundSetting', color='#f80'"), {"appearance.background": "#ff8800"}),
        ("body(root)", {"appearance": MISSING}),
        (shown("'OglSceneFrame', draw=False"), {"appearance": {"frame": False}}),
        (
            shown("'InteractiveCamera', position=[300, 20, 10], lookAt='0 0 5'"),
            {"appearance": {"eye": [300.0, 20.0, 10.0], "target": [0.0, 0.0, 5.0]}},
        ),
        (shown("'InteractiveCamera', position='300 20 10'"), {"appearance": {"eye": [300.0, 20.0, 10.0]}}),
        (shown("'InteractiveCamera', lookAt='0 0 5'"), {"appearance": MISSING}),
        # Of a soft body `showObject` shows the points; what stands still has no axes.
        (
            "collisions(root)\nbody(root).dofs.showObject = True\ncube(root, 'cube', True, showObject=True)\n"
            "cube(root, 'other', True)\ncube(root, 'floor', False, showObject=True)",
            {
                "rigid_bodies.cube.axes": True,
                "rigid_bodies.other.axes": MISSING,
                "obstacles.floor.axes": MISSING,
                f"{BODY_TABLE}.axes": MISSING,
            },
        ),
    ],
)
def test_scenes_become_tables(folder: Path, create: str, expected: dict[str, Any]) -> None:
    """Of a table of which a list is expected, the names."""
    translation = translated(folder, create)
    assert not translation.refused
    for path, value in expected.items():
        item: Any = translation.tables
        for key in path.split("."):
            item = item[int(key)] if isinstance(item, list) else item.get(key, MISSING)
        assert (list(item) if isinstance(item, dict) and isinstance(value, list) else item) == value, path


@pytest.mark.parametrize(("settings", "sign"), [("valueType='pressure'", 1.0), ("flipNormal=True", -1.0)])
def test_walls_that_face_inward_turn_a_pressure_round(folder: Path, settings: str, sign: float) -> None:
    translation = translated(folder, cavity(settings))
    assert list(translation.signs.values()) == [sign]
    assert [name for c, name in translation.names.items() if "Pressure" in c.type_name] == ["body.chamber"]


@pytest.mark.parametrize(
    ("create", "pattern"),
    [
        (
            'body(root).addObject("MooneyRivlinForceField", name="rubber")',
            "MooneyRivlinForceField '/body/rubber' .*scene.py, line .*is not known here; it would be needed for forces "
            "on the bodies$",
        ),
        ('body(root).removeObject("TetrahedronFEMForceField")', "no force field gives"),
        ("body(root).TetrahedronFEMForceField.youngModulus = 0", "youngModulus = 0 leaves its tetrahedra without"),
        (
            CUBE.format(solver=SOLVER, mass="totalMass=1")
            + "\ncube.Collision.addObject('ConstantForceField', forces=[1, 2, 3])",
            "acts on points that follow others by RigidMapping",
        ),
    ],
)
def test_refusals_name_the_component(folder: Path, create: str, pattern: str) -> None:
    (line,) = translated(folder, create).refused
    assert re.search(pattern, line)


FOLDED = "0 0 0  0 1 0  1 0 0  1 1 0  1 0 0.5  1 1 0.5  0 0 0.5  0 1 0.5"


@pytest.mark.parametrize(
    ("settings", "shares"),
    [
        # along the edges from vertex 0: 0, 1, 1, sqrt 2, 1.5; vertex 6 is 0.5 away in space and 2.5 along the surface
        ("method='geodesic', indices=[0], radii=[1.2]", {0: 1.2, 1: 0.2, 2: 0.2}),
        ("method='geodesic', centers=[[0.25, 0, -3]], radii=1.1", {0: 0.85, 2: 0.35, 1: 1.1 - 1.0625**0.5}),
        (
            "method='sphere', indices=[0], radii=[1.2]",
            {0: 1.2, 1: 0.2, 2: 0.2, 4: 1.2 - 1.25**0.5, 6: 0.7, 7: 1.2 - 1.25**0.5},
        ),
        ("method='geodesic', centers=[[0.5, 0.25, 1]], radii=[0.01]", None),
    ],
)
def test_a_cable_pulls_at_areas(folder: Path, settings: str, shares: dict[int, float] | None) -> None:
    """A strip of 1 mm folded over itself, so that its ends are near in space and far along it."""
    translation = translated(
        folder,
        f"""
        free_motion(root)
        cable = body(root).addChild("cable")
        cable.addObject("MeshTopology", name="strip", position="{FOLDED}",
                        triangles="0 2 1  1 2 3  2 4 3  3 4 5  4 6 5  5 6 7")
        cable.addObject("MechanicalObject", src="@strip")
        cable.addObject("CableConstraint", surfaceTopology="@strip", {settings})
        cable.addObject("BarycentricMapping")
        """,
    )
    assert not translation.refused
    (place,) = translation.tables["soft_bodies"]["body"]["cables"]["cable"]["points"]
    if shares is None:
        assert place == pytest.approx([0.5, 0.25, 0.5])
        return
    vertices = np.array(FOLDED.split(), dtype=float).reshape(-1, 3)
    expected = {tuple(vertices[vertex]): share for vertex, share in shares.items()}
    found = dict(zip(map(tuple, place["area"]), place["weights"], strict=True))
    assert found == pytest.approx(expected)
    assert any("weighted means" in line for line in translation.departures)


def test_first_order_dynamics_is_that_of_the_whole_scene(folder: Path) -> None:
    first = "body(root, 'a').EulerImplicitSolver.firstOrder = True"
    translation = translated(folder, first)
    assert translation.tables["time"]["dynamics"] == "overdamped"
    assert translation.effort_of_value == 1.0
    mixed = translated(folder, f"{first}\nbody(root, 'b')")
    assert "all bodies of a scene have inertia, or none has" in mixed.refused[0]
    assert translated(folder, "body(root)").effort_of_value == pytest.approx(100.0)


def test_tetrahedron_container_embeds_by_grid(folder: Path) -> None:
    tables = translated(folder, "body(root)").tables["soft_bodies"]["body"]
    assert "embedding" not in tables
    other = BODY.replace(
        '"MeshTopology", src="@loader", name', '"TetrahedronSetTopologyContainer", src="@loader", name'
    )
    tree = loaded(folder, "body(root)", other)
    assert translate(tree).tables["soft_bodies"]["body"]["embedding"] == "grid"


@pytest.mark.parametrize(
    ("create", "line"),
    [
        (
            "collisions(root)\nsurface(body(root), 'block.stl', selfCollision=True)",
            "touches itself where it is not nearer to itself at rest than twice the contact distance",
        ),
        ("node = body(root)\n" + CAVITY.format(mesh="block.stl", settings=""), "there is no FreeMotionAnimationLoop"),
        (
            "free_motion(root)\nn = body(root)\nn.addObject('CableConstraint', indices=[0, 9], valueType='force', "
            "hasPullPoint=False, maxPositiveDisp=2)",
            "maxPositiveDisp engages where it is reached; in SOFA earlier",
        ),
        (
            "n = body(root)\nn.addObject('BoxROI', name='r', box=[-1]*3+[1]*3)\n"
            "n.addObject('RestShapeSpringsForceField', points='@r.indices')",
            "/body/r: selects its points once",
        ),
        *(
            (shown(f"'BackgroundSetting', color={colour}"), "is not a colour; it gets the usual one")
            for colour in ("'dark red'", "[1, 0]", "'#12'", "[0, 0, float('nan')]")
        ),
    ],
)
def test_a_departure_is_one_line(folder: Path, create: str, line: str) -> None:
    translation = translated(folder, create)
    assert not translation.refused
    assert len([said for said in translation.departures if line in said]) == 1


def test_what_does_not_matter_is_counted(folder: Path) -> None:
    translation = translated(folder, 'for n in "ab": root.addObject("RequiredPlugin", name=n)\nbody(root)')
    assert translation.ignored == {"RequiredPlugin": 2}
    assert not translation.refused


def test_a_controller_of_the_scene_is_no_component(folder: Path) -> None:
    tree = loaded(
        folder,
        "root.addObject(Mine())\nbody(root)",
        f"import Sofa.Core\nclass Mine(Sofa.Core.Controller): pass\n{BODY}",
    )
    assert not translate(tree).refused


NAMES = {
    "EulerImplicitSolver": "EulerImplicit",
    "MeshTopology": "Mesh",
    "MeshOBJLoader": "MeshObjLoader",
    "CollisionResponse": "DefaultContactManager",
    "CollisionPipeline": "DefaultPipeline",
    "BruteForceBroadPhase": "BruteForceDetection",
    "CollisionModel": "",
}


def test_older_names_of_components_mean_the_same(folder: Path) -> None:
    create = CUBE.format(solver=SOLVER, mass="totalMass=0.01") + "\nsurface(body(root), 'block.stl')"
    made = translated(folder, create)
    older, before = create, BODY
    for new, old in NAMES.items():
        older, before = older.replace(new, old), before.replace(new, old)
    again = translate(loaded(folder, older, before))
    assert not made.refused
    assert again.refused == []
    assert again.tables == made.tables
    assert again.files.fingerprint() == made.files.fingerprint()


@pytest.mark.parametrize(
    ("data", "each"),
    [
        ("indices=[0, 1, 3], totalForce=[3, 0, 6]", {0: [1, 0, 2], 1: [1, 0, 2], 3: [1, 0, 2]}),
        ("indices='0 1 3', force='0 5 0'", {0: [0, 5, 0], 1: [0, 5, 0], 3: [0, 5, 0]}),
        ("indices=[2, 0, 5], forces=[[1, 0, 0], [0, 2, 0]]", {2: [1, 0, 0], 0: [0, 2, 0], 5: [0, 2, 0]}),
        ("indices=[2], forces=[[1, 0, 0]], force=[0, 2, 0], totalForce=[0, 0, 3]", {2: [1, 0, 0]}),
        ("indices=[2], force=[0, 2, 0], totalForce=[0, 0, 3]", {2: [0, 2, 0]}),
        ("indices='@roi.indices', totalForce=[0, 0, 8]", {}),
        ("totalForce=[12, 0, 0]", {point: [1, 0, 0] for point in range(12)}),
    ],
)
def test_constant_forces_act_on_points_as_in_sofa(folder: Path, data: str, each: dict[int, list[float]]) -> None:
    """The last of the forces holds for all points after it; a total is shared evenly."""
    translation = translated(
        folder,
        f"""
        node = body(root)
        node.addObject("BoxROI", name="roi", box=[9, -99, -99, 11, 99, 99])
        node.addObject("ConstantForceField", {data})
        """,
    )
    assert not translation.refused
    right = np.flatnonzero(make_block((2, 1, 1), SIZE).nodes[:, 0] == 10.0).tolist()
    if "@roi" in data:
        each = {point: [0, 0, 2] for point in right}
    found = np.zeros((12, 3))
    for table in translation.tables["soft_bodies"]["body"]["forces"]:
        found[table["nodes"]] += np.array(table["force"]) / len(table["nodes"])
    expected = np.zeros((12, 3))
    for point, force in each.items():
        expected[point] = force
    assert found == pytest.approx(expected)
    assert any("the last holds" in line for line in translation.departures) is data.startswith("indices=[2, 0, 5]")


def test_a_static_solver_leads_to_equilibrium(folder: Path) -> None:
    still = """
        node = body(root, "{}")
        node.removeObject("EulerImplicitSolver")
        node.addObject("StaticSolver", newton_iterations=10)
        """
    moving = (
        "state = node.getMechanicalState()\n        state.velocity = [[1, 2, 3]] * len(state.position.value)\n        "
    )
    translation = translated(folder, still.format("a") + moving)
    assert not translation.refused
    assert translation.tables["time"]["dynamics"] == "static"
    assert "velocity" not in translation.tables["soft_bodies"]["a"], "nothing moves at the start in statics"
    (line,) = translated(folder, still.format("a") + "body(root, 'b')").refused
    assert "StaticSolver for some of the bodies; all of a scene are at equilibrium, or none is" in line


# The colours of SOFA scenes arrive in the native tables.


def test_colours_reach_native_tables(folder: Path) -> None:
    translation = translated(
        folder,
        """
        collisions(root)
        root.addObject("BackgroundSetting", color=[0, 0.168627, 0.211765, 1])
        root.addObject("OglSceneFrame", style="Arrows", alignment="TopRight")
        visual(body(root, "finger"), "BarycentricMapping", color="0.0 0.7 0.7 0.6")
        visual(cube(root, "cube", True), "RigidMapping", color=[0.0, 0.1, 0.5])
        visual(cube(root, "floor", False), "RigidMapping", color="red")
        visual(cube(root, "plain", False), "RigidMapping")
        """,
    )
    assert not translation.refused
    tables = translation.tables
    assert tables["soft_bodies"]["finger"]["colour"] == "#00b2b2"
    assert tables["rigid_bodies"]["cube"]["colour"] == "#001a80"
    assert tables["obstacles"]["floor"]["colour"] == "#ff0000"
    assert "colour" not in tables["obstacles"]["plain"]
    assert tables["appearance"] == {"background": "#002b36", "frame": True}
    translation.files.write(folder)
    scene = scene_from_dict(with_files_in(folder, tables))
    assert scene.appearance.background == "#002b36" and scene.obstacles["floor"].colour == "#ff0000"


# What is refused, in which words, and what is not refused since it moves nothing.


@pytest.mark.parametrize(
    "name", ["VisualGrid", "LineAxis", "OglWhatever", "OffExporter", "MomentumMonitor", "SpotLight", "WriteState"]
)
def test_what_concerns_pictures_and_records_is_without_effect(tmp_path: Path, name: str) -> None:
    translation = translate(loaded(tmp_path, f"root.addObject({name!r}, size=10)"))
    assert translation.refused == []
    assert translation.ignored == {name: 1}
    exports = name.endswith("Exporter") or name == "WriteState"
    assert any("`taichisoft recording export`" in line for line in translation.departures) is exports


def test_a_serial_port_exchanges_nothing_and_says_so(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    translation = translate(
        loaded(
            tmp_path,
            """
            import serial.tools.list_ports
            assert serial.tools.list_ports.comports() == []
            port = serial.Serial("/dev/ttyUSB0", 115200, timeout=0.05)
            assert (port.readline(), port.write(b"150")) == (b"", 3)
            root.addObject("SerialPortBridgeGeneric", port="/dev/ttyUSB0", size=3).packetOut = [1, 2, 3]
            """,
        )
    )
    assert translation.refused == []
    assert any("SerialPortBridgeGeneric" in line and "exchanges nothing" in line for line in translation.departures)
    assert "nothing is sent or read" in caplog.text


def test_inverse_solver_is_refused_once(tmp_path: Path) -> None:
    translation = translate(
        loaded(
            tmp_path,
            """
            root.addObject("QPInverseProblemSolver", name="QP")
            root.addObject("PositionEffector")
            root.addObject("CableActuator")
            """,
        )
    )
    (line,) = translation.refused
    assert line.startswith("QPInverseProblemSolver '/QP' (")
    assert "scene.py, line 3): belongs to the inverse solver" in line
    assert "beside CableActuator, PositionEffector" in line
    assert "patented" in line


@pytest.mark.parametrize(("base", "word"), [("ForceField", "force field"), ("DataEngine", "engine")])
def test_own_force_fields_and_engines_are_refused(tmp_path: Path, base: str, word: str) -> None:
    before = f"import Sofa.Core\nclass Own(Sofa.Core.{base}):\n    pass\n"
    assert translate(loaded(tmp_path, "pass", before)).refused == []
    (line,) = translate(loaded(tmp_path, "root.addObject(Own(name='own'))", before)).refused
    assert "'/own' (" in line
    assert "of the scene's own" in line
    assert word in line


def test_a_loop_of_the_scenes_own_is_refused_with_a_way_out(tmp_path: Path) -> None:
    way_out = (
        r"line 4: Sofa.Simulation.animate\(\) is a loop of the scene's own; .*`taichisoft run`.*Sofa.Core.Controller"
    )
    with pytest.raises(SceneError, match=way_out):
        loaded(tmp_path, "import Sofa\nSofa.Simulation.animate(root, 0.01)")
    before = """
    import Sofa.Core
    class Steps(Sofa.Core.Controller):
        def onAnimateBeginEvent(self, event):
            Sofa.Simulation.animate(self, 0.01)
    """
    tree = loaded(tmp_path, "root.addObject(Steps(name='steps'))", before)
    with pytest.raises(ControllerFailed, match=r"line 5: Sofa\.Simulation\.animate"):
        tree.animate_begin(0.01)


def test_components_are_found_by_the_names_of_other_versions(tmp_path: Path) -> None:
    """SOFA 25.12 renamed its constraint solver; scenes ask the root for it by either name."""
    tree = loaded(tmp_path, "root.addObject('BlockGaussSeidelConstraintSolver', maxIterations=7)")
    assert tree.root.GenericConstraintSolver.maxIterations.value == 7
    tree = loaded(tmp_path, "root.addObject('GenericConstraintSolver', name='mine')")
    with pytest.raises(AttributeError):
        tree.root.BlockGaussSeidelConstraintSolver  # noqa: B018


XML = """<?xml version="1.0"?>
<Node name="root" dt="0.02" gravity="0 -9.81 0">
  <DefaultAnimationLoop/>
  <Node name="child">
    <EulerImplicitSolver rayleighStiffness="0.1"/>
    <CGLinearSolver iterations="25" name="solver" tolerance="1e-9" threshold="1e-9"/>
    <RegularGridTopology name="grid" n="4 2 2" min="0 0 0" max="30 10 10"/>
    <Object type="MechanicalObject" name="dofs"/>
    <UniformMass totalMass="0.1"/>
    <FixedConstraint indices="0 4 8 12"/>
    <HexahedronFEMForceField name="FEM" youngModulus="4000" poissonRatio="0.3" method="large"/>
  </Node>
</Node>
"""


def test_a_scene_in_xml_is_read(tmp_path: Path) -> None:
    """Its values are texts, and its components have the lines on which they stand."""
    from taichisoft_sofa.loading import load_tree

    (tmp_path / "scene.scn").write_text(XML)
    tree = load_tree(tmp_path / "scene.scn")
    translation = translate(tree)
    assert not translation.refused
    assert translation.tables["time"]["step"] == 0.02
    assert translation.tables["gravity"] == [0.0, -9.81, 0.0]
    body = translation.tables["soft_bodies"]["child"]
    assert (body["element"], body["rayleigh_stiffness"], body["young_modulus"]) == ("hexahedral", 0.1, 4000.0)
    assert len(body["anchors"][0]["nodes"]) == 4
    assert str(tree.root.child.dofs.place).endswith("scene.scn, line 8")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<Node><A></Node>", "line 1: no scene in XML: mismatched tag"),
        (
            "<Node>\n<include href='a.xml'/></Node>",
            "line 2: includes 'a.xml': no such file",
        ),
        ("<A/>", "line 1: begins with <A>"),
        ("<Node><A><B/></A></Node>", "<B> is inside a component"),
        ("<Node>\n<Wrong/></Node>", "line 2.: is not known here"),
    ],
)
def test_mistakes_in_xml_are_one_line(tmp_path: Path, text: str, message: str) -> None:
    from taichisoft import load_scene

    (tmp_path / "scene.scn").write_text(text)
    with pytest.raises(SceneError, match=message):
        load_scene(tmp_path / "scene.scn")


def test_meshes_are_found_in_the_data_path(tmp_path: Path) -> None:
    from taichisoft_sofa.loading import load_tree

    share = tmp_path / "share" / "mesh"
    share.mkdir(parents=True)
    (share / "one.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    loaded(tmp_path, "root.addObject('MeshOBJLoader', name='loader', filename='mesh/one.obj')", BODY)
    tree = load_tree(tmp_path / "scene.py", data_path=[tmp_path / "share"])
    translate(tree)
    assert len(tree.root.loader.position.value) == 3
    with pytest.raises(SceneError, match="nowhere: no such folder"):
        load_tree(tmp_path / "scene.py", data_path=[tmp_path / "nowhere"])


def test_too_many_bodies_and_levels_are_refused(tmp_path: Path) -> None:
    body = (
        "n = root.addChild('n')\n    n.addObject('MechanicalObject', template='Rigid3')\n    n.addObject('UniformMass')"
    )
    (line,) = translate(loaded(tmp_path, f"for i in range(1001):\n    {body}")).refused
    assert "is one of 1001 bodies; at most 1000 are known here" in line
    with pytest.raises(SceneError, match=r"scene.py: its nodes are nested 252 deep; at most 200 are known here"):
        loaded(tmp_path, "n = root\nfor i in range(251): n = n.addChild('n')")
