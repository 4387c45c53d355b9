"""Regular grids, the cells that topological mappings make of them, engines and their regions."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes_of_sofa import BODY, loaded

from taichisoft import make_model
from taichisoft.errors import SceneError
from taichisoft.mechanics.elasticity import internal_force
from taichisoft.mesh import boundary_quads, count_open_edges, enclosed_volume, tetrahedron_volumes
from taichisoft.scene import scene_from_dict
from taichisoft_sofa.components.engines import cells_inside, in_boxes, in_oriented_boxes, in_spheres
from taichisoft_sofa.components.meshes import split_quads
from taichisoft_sofa.components.topologies import divided
from taichisoft_sofa.scene_reader import with_files_in
from taichisoft_sofa.translation.translate import translate
from taichisoft_sofa.tree.node import Node


def grid(**data: object) -> Node:
    root = Node("root")
    root.addObject("RegularGridTopology", name="grid", **data)
    return root


sizes = st.tuples(*[st.integers(2, 4)] * 3)


@settings(max_examples=20, deadline=None)
@given(sizes, st.booleans())
def test_tetrahedra_fill_a_grid_and_fit_each_other(size: tuple[int, int, int], alternating: bool) -> None:
    """Their volumes sum up to the box; their faces fit if what they leave open is the box's surface alone."""
    made = grid(n=size, min=[-1, 0, 2], max=[3, 1, 5]).grid
    points, hexahedra = made.position.value, made.hexahedra.value
    assert len(points) == np.prod(size)
    tetrahedra = divided(hexahedra, made, alternating)
    volumes = np.abs(tetrahedron_volumes(points, tetrahedra))
    assert volumes.min() > 0.0
    assert volumes.sum() == pytest.approx(4.0 * 1.0 * 3.0)
    faces = np.sort(tetrahedra[:, [[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]]].reshape(-1, 3), axis=1)
    _, count = np.unique(faces, axis=0, return_counts=True)
    assert count.max() <= 2
    nx, ny, nz = (n - 1 for n in size)
    assert (count == 1).sum() == 4 * (nx * ny + ny * nz + nz * nx)
    skin = split_quads(boundary_quads(hexahedra))
    assert enclosed_volume(points, skin) == pytest.approx(12.0)
    assert count_open_edges(skin) == 0


def test_points_of_a_grid_run_along_x_first() -> None:
    made = grid(nx=3, ny=2, nz=2, xmin=-1, xmax=1, ymin=0, ymax=5, zmin=0, zmax=7, p0=[10, 0, 0]).grid
    assert made.position.value[:4].tolist() == [[10, 0, 0], [11, 0, 0], [12, 0, 0], [10, 5, 0]]
    assert made.hexahedra.value.tolist() == [[0, 1, 4, 3, 6, 7, 10, 9], [1, 2, 5, 4, 7, 8, 11, 10]]
    assert grid(n=[1, 1, 1], min=[1, 2, 3], max=[3, 6, 9]).grid.position.value.tolist() == [[2, 4, 3]]
    with pytest.raises(SceneError, match="cellWidth is not known"):
        grid(cellWidth=3).grid.position.value.max()
    assert grid(n=[3, 2, 1]).grid.quads.value.tolist() == [[0, 1, 4, 3], [1, 2, 5, 4]]
    assert grid(n=[3, 1, 1]).grid.edges.value.tolist() == [[0, 1], [1, 2]]


@pytest.mark.parametrize("mapped", [True, False])
def test_a_grid_is_a_body_of_tetrahedra_with_a_surface(tmp_path: Path, mapped: bool) -> None:
    """With a mapping, or since a force field of tetrahedra divides hexahedra itself."""
    mapping = """
        node.addObject("TetrahedronSetTopologyContainer", name="tetras", position="@grid.position")
        node.addObject("Hexa2TetraTopologicalMapping", input="@grid", output="@tetras", swapping=True)
    """
    translation = translate(
        loaded(
            tmp_path,
            f"""
        collisions(root)
        node = root.addChild("beam")
        node.addObject("EulerImplicitSolver")
        node.addObject("SparseLDLSolver")
        node.addObject("RegularGridTopology", name="grid", n=[4, 2, 2], min=[0, 0, 0], max=[30, 10, 10])
        {mapping.strip() if mapped else "pass"}
        node.addObject("MechanicalObject", name="dofs", src="@grid")
        node.addObject("UniformMass", totalMass=0.1)
        node.addObject("TetrahedronFEMForceField", youngModulus=100, poissonRatio=0.3)
        node.addObject("FixedConstraint", indices=[0, 4, 8, 12])
        skin = node.addChild("skin")
        skin.addObject("QuadSetTopologyContainer", name="quads")
        skin.addObject("Hexa2QuadTopologicalMapping", input="@../grid", output="@quads")
        tri = skin.addChild("tri")
        tri.addObject("TriangleSetTopologyContainer", name="triangles")
        tri.addObject("Quad2TriangleTopologicalMapping", input="@../quads", output="@triangles")
        tri.addObject("MechanicalObject", position="@../../dofs.position")
        tri.addObject("TriangleCollisionModel")
        tri.addObject("IdentityMapping", input="@../../dofs")
        node.addObject("LinearSolverConstraintCorrection")
        """.replace("\n    \n", "\n"),
            BODY,
        )
    )
    assert translation.refused == []
    part = translation.soft["beam"]
    assert len(part.elements) == 18
    assert tetrahedron_volumes(part.body.position[part.points], part.elements).sum() == pytest.approx(3000.0)
    (surface,) = part.body.surfaces.values()
    assert enclosed_volume(surface.points, surface.triangles) == pytest.approx(3000.0)


@pytest.mark.parametrize("size", [[0, 2, 2], [2, 2], [1000, 1000, 1000]])
def test_a_grid_without_points_or_with_too_many_is_an_error(size: list[int]) -> None:
    with pytest.raises(Exception, match=r"RegularGridTopology '/grid'.*(n = |must be above 0)"):
        _ = grid(n=size).grid.position.value


BEAM = """
    root.gravity = [0, 0, 0]
    free_motion(root)
    beam = root.addChild("beam")
    for kind in ("EulerImplicitSolver", "SparseLDLSolver", "LinearSolverConstraintCorrection"):
        beam.addObject(kind)
    beam.addObject({grid})
    beam.addObject("MechanicalObject")
    beam.addObject("UniformMass", totalMass=0.1)
    beam.addObject("HexahedronFEMForceField", youngModulus=300, poissonRatio=0.45)
"""


def test_hexahedra_of_a_grid_become_hexahedral_elements(tmp_path: Path) -> None:
    """Stretched by a force on its end, a bar of hexahedra is longer by F L / (E A): the test of a patch."""
    made = '"RegularGridTopology", n=[5, 3, 3], min=[0, 0, 0], max=[40, 10, 10]'
    held = """
    beam.addObject("BoxROI", name="end", box=[-1, -1, -1, 0.1, 11, 11])
    beam.addObject("PartialFixedConstraint", indices="@end.indices", fixedDirections=[1, 0, 0])
    beam.addObject("PartialFixedConstraint", indices=[0], fixedDirections=[0, 1, 1])
    beam.addObject("PartialFixedConstraint", indices=[4], fixedDirections=[0, 1, 1])
    """
    translation = translate(loaded(tmp_path, BEAM.format(grid=made) + held, BODY))
    assert not translation.refused
    table = translation.tables["soft_bodies"]["beam"]
    assert (table["element"], table["corotation"], table["young_modulus"]) == ("hexahedral", "polar", 300.0)
    translation.files.write(tmp_path)
    model = make_model(scene_from_dict(with_files_in(tmp_path, translation.tables)))
    position = model.rest_position.copy()
    stretch = 1e-4
    position *= 1.0 + stretch * np.array([1.0, -0.45, -0.45])
    assert model.elasticity is not None
    force = internal_force(model.elasticity, position)
    end = np.isclose(model.rest_position[:, 0], 40.0)
    assert -force[end, 0].sum() == pytest.approx(300.0 * 100.0 * stretch, rel=1e-6)
    assert np.abs(force[:, 1:]).max() < 1e-6 * np.abs(force[end, 0].sum())


def test_sparse_grid_encloses_surface(tmp_path: Path) -> None:
    """A ball of 10 mm in cells of 2.04 mm: all cells whose centres are inside, none that is wholly outside, no hole."""
    ball = trimesh.creation.icosphere(subdivisions=3, radius=10.0)
    ball.export(tmp_path / "ball.stl")
    made = '"SparseGridTopology", n=[11, 11, 11], fileTopology="ball.stl"'
    tree = loaded(tmp_path, BEAM.format(grid=made), BODY)
    translation = translate(tree)
    assert not translation.refused
    grid = next(one for one in tree.components() if one.type_name == "SparseGridTopology")
    points, cells = np.array(grid.position.value), np.array(grid.hexahedra.value)
    assert np.ptp(points, axis=0) == pytest.approx([20.4] * 3, rel=1e-3)
    distances = np.linalg.norm(points[cells], axis=2)
    assert (distances.min(axis=1) < 10.0).all()
    assert len(cells) * 2.04**3 > 4 / 3 * np.pi * 10**3
    centres = points[cells].mean(axis=1)
    whole = np.round((np.stack(np.meshgrid(*[np.arange(-9.18, 9.2, 2.04)] * 3), axis=-1)).reshape(-1, 3), 2)
    inside = {tuple(one) for one in np.round(whole[np.linalg.norm(whole, axis=1) < 9.8], 1).tolist()}
    assert inside <= {tuple(one) for one in np.round(centres, 1).tolist()}


# Engines that compute data of a scene.


def engine(kind: str, **data: Any) -> Any:
    return Node("root").addObject(kind, name="engine", **data)


@pytest.mark.parametrize("turn", [[0, 0, 90], [0, 0, np.sqrt(0.5), np.sqrt(0.5)]])
def test_points_are_scaled_then_turned_then_shifted(turn: list[float]) -> None:
    """And the inverse undoes it."""
    how = {"translation": [10, 0, 0], "rotation": turn, "scale": [2, 3, 1]}
    there = engine("TransformEngine", input_position=[[1, 0, 0], [0, 1, 5]], **how).output_position.value
    assert np.array(there) == pytest.approx(np.array([[10, 2, 0], [7, 0, 5]]), abs=1e-12)
    back = engine("TransformEngine", input_position=there, inverse=True, **how).output_position.value
    assert np.array(back) == pytest.approx(np.array([[1, 0, 0], [0, 1, 5]]), abs=1e-12)


def test_lists_of_values_and_indices() -> None:
    mapper = engine("IndexValueMapper", inputValues=[1, 2], indices=[0, 3], value=9, defaultValue=5)
    assert list(mapper.outputValues.value) == [9, 2, 5, 9]
    assert list(engine("ValuesFromIndices", **{"in": [4, 5, 6], "indices": [2, 0]}).out.value) == [6, 4]
    assert np.array(engine("PointsFromIndices", position=np.eye(3), indices=[2]).indices_position.value).tolist() == [
        [0, 0, 1]
    ]
    for operation, merged in {"union": [1, 2, 3], "intersection": [2], "difference": [1]}.items():
        assert list(engine("MergeSets", in1=[1, 2], in2=[2, 3], op=operation).out.value) == merged


@pytest.mark.parametrize(
    ("kind", "data", "output", "message"),
    [
        ("TransformEngine", {"input_position": [[0, 0, 0]], "rotation": [1, 2]}, "output_position", "has 2 numbers"),
        (
            "PointsFromIndices",
            {"position": [[0, 0, 0]], "indices": [1]},
            "indices_position",
            "names row 1; there are 1",
        ),
        ("MergeSets", {"in1": [1], "op": "join"}, "out", "op 'join'; valid: union, intersection"),
    ],
)
def test_mistakes_are_one_line(kind: str, data: dict[str, Any], output: str, message: str) -> None:
    with pytest.raises(SceneError, match=message):
        getattr(engine(kind, **data), output).value  # noqa: B018


def test_a_link_to_what_a_device_has_not_sent_is_no_value() -> None:
    """SOFA's default holds where nothing has been written: no points, here of an object of points."""
    root = Node("root")
    root.addObject("CommunicationController", name="receiver", job="receiver", nbDataField=1)
    state = root.addObject("MechanicalObject", name="points", position="@receiver.data1")
    assert len(state.position.value) == 0


# Regions of SOFA's ROI engines: closed, several at once, cells by all corners or by their middle.


POINTS = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [3.0, 3.0, 3.0]])


def test_box_includes_its_faces() -> None:
    inside = in_boxes([[1.0, 1.0, 0.0, 0.0, 0.0, 0.0]])
    assert inside(POINTS).tolist() == [True, True, True, False, False]
    assert inside(np.array([[0.5, 0.5, -1e-30]])).tolist() == [False]


def test_several_boxes_are_joined() -> None:
    inside = in_boxes([[-1, -1, -1, 0.5, 0.5, 0.5], [2, 2, 2, 4, 4, 4]])
    assert inside(POINTS).tolist() == [True, False, False, False, True]


def test_an_oriented_box_reaches_half_its_depth_to_each_side() -> None:
    # A square of edge 2 in the plane x = z, with its middle at the origin.
    s = np.sqrt(0.5)
    box = [-s, -1.0, -s, s, -1.0, s, s, 1.0, s, 0.5]
    inside = in_oriented_boxes([box])
    along, normal = np.array([s, 0.0, s]), np.array([s, 0.0, -s])
    points = np.array([0.99 * along, 1.01 * along, 0.24 * normal, -0.24 * normal, 0.26 * normal, [0.0, 0.99, 0.0]])
    assert inside(points).tolist() == [True, False, True, True, False, True]


def test_one_radius_stands_for_all_spheres() -> None:
    inside = in_spheres([[0.0, 0.0, 0.0], [3.0, 3.0, 2.0]], [1.0])
    assert inside(POINTS).tolist() == [True, True, True, True, True]
    assert in_spheres([[0.0, 0.0, 0.0]], [0.9])(POINTS).tolist() == [True, False, False, False, False]


@pytest.mark.parametrize(("strict", "found"), [(True, []), (False, [0])])
def test_a_cell_belongs_by_all_its_corners_or_by_its_middle(strict: bool, found: list[int]) -> None:
    inside = in_boxes([[0.2, 0.2, 0.2, 0.3, 0.3, 0.3]])
    assert cells_inside(POINTS, np.array([[0, 1, 2, 3], [1, 2, 3, 4]]), inside, strict).tolist() == found
