"""Elements of every kind: patch tests, objectivity, momentum, and tangents that are slopes of the forces."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from blocks import block_hexahedra, make_block
from conftest import Figures, examples
from hypothesis import given
from hypothesis import strategies as st
from scenes import advance, dense_matrix, silicone, simulate, soft_momentum
from scipy.spatial.transform import Rotation

from taichisoft import Model, VolumeMesh, read_volume_mesh, write_volume_mesh
from taichisoft.errors import MeshError
from taichisoft.mechanics import ElasticSystem
from taichisoft.mechanics.elasticity import internal_force
from taichisoft.mechanics.element_kinds import hexahedral_masses
from taichisoft.mesh import boundary_triangles, with_middle_nodes

SIZE = (30.0, 20.0, 10.0)
ELEMENTS = ("linear", "smoothed", "quadratic")
KINDS = (*ELEMENTS, "curved", "hexahedral")
"""The curved ones are quadratic, with the sides inside the block bent."""
EDGES = "edges"
"""Linear elements that turn with their own edges, as SOFA's do."""
YOUNG, POISSON = 500.0, 0.3


@pytest.fixture(scope="module")
def irregular(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A block of 162 tetrahedra, its inner nodes shifted by up to a fifth of a cell."""
    mesh = make_block((3, 3, 3), SIZE)
    inner = np.setdiff1d(np.arange(len(mesh.nodes)), boundary_triangles(mesh.elements))
    nodes = mesh.nodes.copy()
    nodes[inner] += np.random.default_rng(1).uniform(-0.2, 0.2, (len(inner), 3)) * np.array(SIZE) / 3
    path = tmp_path_factory.mktemp("mesh") / "irregular.msh"
    write_volume_mesh(VolumeMesh("irregular", nodes, mesh.elements).check(), path)
    return str(path)


@pytest.fixture(scope="module")
def models(irregular: str) -> dict[str, Model]:
    return {kind: _model(irregular, kind) for kind in (*KINDS, EDGES)}


def _curved(mesh: str) -> str:
    """A file with ten-node tetrahedra beside one with four: middles inside shifted by up to a 25th of a cell."""
    quadratic = with_middle_nodes(read_volume_mesh(mesh))
    middles = np.setdiff1d(quadratic.elements[:, 4:], boundary_triangles(quadratic.elements))
    nodes, path = quadratic.nodes.copy(), Path(mesh).with_name("curved.msh")
    nodes[middles] += np.random.default_rng(4).uniform(-0.04, 0.04, (len(middles), 3)) * np.array(SIZE) / 3
    write_volume_mesh(replace(quadratic, nodes=nodes), path)
    return str(path)


def _of_hexahedra(mesh: str) -> str:
    """A file with the same nodes, and the 27 boxes that the tetrahedra divide."""
    import meshio

    path, nodes = Path(mesh).with_name("hexahedra.vtk"), read_volume_mesh(mesh).nodes
    meshio.write(path, meshio.Mesh(nodes, [("hexahedron", block_hexahedra((3, 3, 3)))]), binary=False)
    return str(path)


def _model(mesh: str, kind: str, **changes: Any) -> Model:
    if kind == "curved":
        mesh, kind = _curved(mesh), "quadratic"
    if kind == "hexahedral":
        mesh = _of_hexahedra(mesh)
    turning = {"element": "linear", "corotation": EDGES} if kind == EDGES else {"element": kind, "corotation": "polar"}
    body = silicone(mesh, **turning, **changes)
    return simulate(soft_bodies={"block": body}).model


def _forces(model: Model, position: np.ndarray) -> np.ndarray:
    assert model.elasticity is not None
    return internal_force(model.elasticity, position)


def _on_boundary(model: Model) -> np.ndarray:
    return (np.abs(model.rest_position) > 0.5 * np.array(SIZE) * (1 - 1e-9)).any(axis=1)


def _random_rotation(seed: int) -> np.ndarray:
    return Rotation.random(rng=np.random.default_rng(seed)).as_matrix()


@pytest.mark.parametrize("kind", [*KINDS, EDGES])
@examples(20)
@given(seed=st.integers(0, 10**6), shift=st.floats(-1e3, 1e3))
def test_a_moved_body_feels_no_force(models: dict[str, Model], kind: str, seed: int, shift: float) -> None:
    """f(R X + t) = 0 for every rotation and shift.

    Tolerance 1e-8 mN: round-off of coordinates of 1e3 mm (1e-13) over cells of 5 mm is a strain of 2e-14, times
    E = 500 kPa on faces of 100 mm^2 gives 1e-9 mN. A strain of 1 % gives 500 mN.
    """
    model = models[kind]
    assert np.abs(_forces(model, model.rest_position @ _random_rotation(seed).T + shift)).max() < 1e-8


@pytest.mark.parametrize("kind", KINDS)
@examples(20)
@given(seed=st.integers(0, 10**6), stretch=st.floats(1e-3, 0.3))
def test_affine_patch(models: dict[str, Model], kind: str, seed: int, stretch: float) -> None:
    """x = F X: the stress is the same everywhere, so no inner node feels a force; 1e-9 of the largest is round-off."""
    strain = np.random.default_rng(seed).uniform(-1, 1, (3, 3)) * stretch
    model, deformation = models[kind], _random_rotation(seed) @ (np.eye(3) + strain)
    force = np.abs(_forces(model, model.rest_position @ deformation.T))
    assert force[~_on_boundary(model)].max() <= 1e-9 * force.max()


def test_affine_patch_with_edge_rotations(models: dict[str, Model], figures: Figures) -> None:
    """The same with each element's rotation from its own edges: only for infinitesimal strains.

    Elements of one strain e take rotations that differ by O(e), which cost a force of O(e^2): at e = 1e-4 less
    than 1e-3 of the largest force, and ten times less of it at a tenth of the strain.
    """
    model, strain, share = models[EDGES], np.random.default_rng(7).uniform(-1, 1, (3, 3)), {}
    for size in (1e-4, 1e-5):
        force = np.abs(_forces(model, model.rest_position @ (np.eye(3) + size * strain).T))
        share[size] = force[~_on_boundary(model)].max() / force.max()
    figures.at_most("inner over largest force at a strain of 1e-4", share[1e-4], 1e-3)
    figures.close("its ratio at a tenth of the strain", share[1e-4] / share[1e-5], 10.0, 0.2)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_hookes_law_on_faces(models: dict[str, Model], kind: str, axis: int) -> None:
    """Stretched by e along one axis and held across: s = (lambda + 2 mu) e along it, lambda e across, no shear.

    The nodes of a face carry its traction times its area; tolerance 1e-11: round-off over e = 1e-3.
    """
    model, stretch = models[kind], 1e-3
    first = YOUNG * POISSON / ((1 + POISSON) * (1 - 2 * POISSON))
    second = YOUNG / (2 * (1 + POISSON))
    deformation = np.eye(3)
    deformation[axis, axis] += stretch
    force = _forces(model, model.rest_position @ deformation)
    for face in range(3):
        on_face = np.isclose(model.rest_position[:, face], SIZE[face] / 2)
        expected = np.zeros(3)
        expected[face] = -(first + 2 * second * (face == axis)) * stretch * np.prod(SIZE) / SIZE[face]
        np.testing.assert_allclose(force[on_face].sum(axis=0), expected, rtol=1e-11, atol=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_forces_turn_with_the_body_and_balance(models: dict[str, Model], kind: str) -> None:
    """f(R x) = R f(x), and neither forces nor torques have a sum, for strains of some 20 % that differ everywhere.

    Tolerance 1e-10 of the largest force, and of it times the size of the block: round-off.
    """
    model, turn = models[kind], _random_rotation(5)
    position = model.rest_position + np.random.default_rng(2).uniform(-0.3, 0.3, model.rest_position.shape)
    force, turned = _forces(model, position), _forces(model, position @ turn.T)
    scale = np.abs(force).max()
    np.testing.assert_allclose(turned, force @ turn.T, rtol=0, atol=1e-10 * scale)
    np.testing.assert_allclose(force.sum(axis=0), 0.0, atol=1e-10 * scale)
    np.testing.assert_allclose(np.cross(position, force).sum(axis=0), 0.0, atol=1e-10 * scale * max(SIZE))


@pytest.mark.parametrize("kind", ELEMENTS)
def test_forces_do_not_depend_on_the_order_of_nodes_in_elements(
    irregular: str, kind: str, tmp_path: Any, models: dict[str, Model]
) -> None:
    """Even permutations of each element's corners change nothing; 1e-9 of the largest force is round-off."""
    model, random = models[kind], np.random.default_rng(3)
    even = np.array([[0, 1, 2, 3], [1, 2, 0, 3], [3, 0, 2, 1], [2, 3, 0, 1], [1, 0, 3, 2]])
    mesh = model.soft_bodies[0].mesh
    order = even[random.integers(0, len(even), len(mesh.elements))]
    path = tmp_path / "renumbered.msh"
    corners = mesh.elements.max(initial=0, where=np.arange(mesh.elements.shape[1]) < 4) + 1
    elements = np.take_along_axis(mesh.elements[:, :4], order, 1)
    write_volume_mesh(VolumeMesh("renumbered", mesh.nodes[:corners], elements).check(), path)
    position = model.rest_position + random.uniform(-0.3, 0.3, model.rest_position.shape)
    force = _forces(model, position)
    np.testing.assert_allclose(_forces(_model(str(path), kind), position), force, atol=1e-9 * np.abs(force).max())


@pytest.mark.parametrize("kind", KINDS)
def test_the_matrix_is_the_slope_of_the_forces_at_rest(models: dict[str, Model], kind: str) -> None:
    """At rest no stress turns, so that -df/dx = K with the rotations frozen; also of f - (h + b) K v along v.

    Central differences of 1e-4 mm over cells of 5 mm have an error of 1e-10, and round-off of 1e-10 of the stiffness.
    """
    model = models[kind]
    assert model.elasticity is not None
    system = ElasticSystem(model.elasticity)
    system.position[:] = model.rest_position
    system.assemble()
    matrix = dense_matrix(system, len(model.rest_position))
    lag = model.elasticity.node_lag[0]
    time_step = model.scene.time.step
    mass = np.repeat(model.elasticity.node_mass, 3)
    random = np.random.default_rng(4)
    for _ in range(5):
        motion = random.uniform(-1, 1, model.rest_position.shape)
        ahead, behind = (_forces(model, model.rest_position + sign * 1e-4 * motion) for sign in (1, -1))
        slope = (ahead - behind) / 2e-4
        pull = (matrix @ motion.ravel() - mass * motion.ravel()) / (time_step * lag)
        np.testing.assert_allclose(-slope.ravel(), pull, atol=1e-7 * np.abs(pull).max())
        system.velocity[:] = motion
        system.assemble()
        np.testing.assert_allclose(system.force.ravel(), -lag * pull, atol=1e-9 * np.abs(lag * pull).max())


@pytest.mark.parametrize("kind", ELEMENTS)
def test_momentum_and_spin_stay(irregular: str, kind: str) -> None:
    """A free body that starts bent keeps its momentum, and does not begin to turn.

    Momentum to round-off; the angular momentum, which implicit Euler keeps to first order in the step, below 1 % of
    what the parts of the body have against each other.
    """
    simulation = simulate(step=0.001, soft_bodies={"block": silicone(irregular, element=kind, corotation="polar")})
    rest = simulation.model.rest_position
    bent = rest + np.column_stack([np.zeros(len(rest)), np.zeros(len(rest)), 0.01 * rest[:, 0] ** 2])
    simulation.restore(simulation.state.changed(position=bent))
    assert simulation.model.elasticity is not None
    mass, largest = simulation.model.elasticity.node_mass, 0.0
    for _ in range(50):
        advance(simulation, 0.001)
        state = simulation.state
        part = mass[:, None] * np.cross(state.position, state.velocity)
        largest = max(largest, np.abs(part).sum())
        assert np.abs(soft_momentum(simulation)).max() < 1e-10
        assert np.abs(part.sum(axis=0)).max() < 0.01 * largest


def test_meshes_that_cannot_be_hexahedral(irregular: str, tmp_path: Path) -> None:
    """Tetrahedra, hexahedra beside tetrahedra, and neighbours whose nodes are numbered from different corners."""
    import meshio

    nodes, boxes = read_volume_mesh(irregular).nodes, block_hexahedra((3, 3, 3))
    turned = boxes.copy()
    turned[4] = turned[4][[1, 2, 3, 0, 5, 6, 7, 4]]
    tetrahedron = ("tetra", boxes[:1, [0, 1, 3, 4]])
    with pytest.raises(MeshError, match=r"has other cells than hexahedra, with soft_bodies\.block\.element"):
        simulate(soft_bodies={"block": silicone(irregular, element="hexahedral")})
    for name, cells, message in (
        ("mixed", [("hexahedron", boxes[1:]), tetrahedron], r"cells that are no tetrahedra \(26 of hexahedron\)"),
        ("turned", [("hexahedron", turned)], "divided along different diagonals of their faces"),
        ("outside", [("hexahedron", boxes + 60)], r"has a node index outside 0\.\.63"),
    ):
        path = tmp_path / f"{name}.vtk"
        meshio.write(path, meshio.Mesh(nodes, cells), binary=False)
        with pytest.raises(MeshError, match=message):
            read_volume_mesh(path)


def test_a_hexahedron_has_the_material_of_most_of_its_parts(tmp_path: Path) -> None:
    """A region that cuts through hexahedra takes those whole of which it has more than half; masses are row sums."""
    import meshio

    mesh, path = make_block((4, 2, 2), (40.0, 20.0, 20.0)), tmp_path / "block.vtk"
    meshio.write(path, meshio.Mesh(mesh.nodes, [("hexahedron", block_hexahedra((4, 2, 2)))]), binary=False)
    regions = [{"box": [[-1.0, -99, -99], [99, 99, 99]], "young_modulus": 50.0}]
    body = silicone(str(path), element="hexahedral", density=1e-6, regions=regions)
    (made,) = simulate(soft_bodies={"block": body}).model.soft_bodies
    assert (made.material.reshape(-1, 6) == made.material[::6, None]).all()
    assert made.material[::6].tolist() == [0] * 8 + [1] * 8
    assert made.node_mass == pytest.approx(hexahedral_masses(made.rest_position, made.elements, 1e-6))
    corners = (np.abs(made.rest_position) == [20, 10, 10]).all(axis=1)
    assert made.node_mass[corners] == pytest.approx(1e-6 * 1000 / 8)
