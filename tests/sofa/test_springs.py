"""Springs between points of soft bodies, rigid bodies and fixed places, against m g / k."""

from pathlib import Path

import pytest
from blocks import make_block
from scenes_of_sofa import BODY, loaded
from test_driven_bodies import run
from test_rigid_parts import folder as folder

from taichisoft import write_volume_mesh
from taichisoft_sofa.translation.translate import translate

MASS = 0.05
HUNG = """
def createScene(root):
    root.dt = 0.01
    root.gravity = [0, 0, -9810]
    free_motion(root)
    node = body(root)
    post = root.addChild("post")
    post.addObject("MechanicalObject", name="points", position=[[9, 9, 60], [0, 5, 60]])
    tool = root.addChild("tool")
    for kind in ("EulerImplicitSolver", "SparseLDLSolver", "LinearSolverConstraintCorrection"):
        tool.addObject(kind)
    tool.addObject("MechanicalObject", name="frame", template="Rigid3", position=[0, -5, -50, 0, 0, 0, 1])
    tool.addObject("UniformMass", totalMass=0.01)
    points = np.array(node.loader.position.value)
    top, low = (int(np.argmin(np.linalg.norm(points - place, axis=1))) for place in ([0, 5, 15], [0, -5, -15]))
    node.addObject("StiffSpringForceField", object1="@../post/points", object2="@dofs", spring=[1, top, 50, 0, 40])
    node.addObject("StiffSpringForceField", object1="@dofs", object2="@../tool/frame", indices1=[low], indices2=[0],
                   stiffness=20, damping=0)
"""


def test_a_block_and_what_hangs_on_it_hang_by_their_weights(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """At rest the springs are longer than at rest by weight / k: (0.05 + 0.01) g / 50 mN/mm, and 0.01 g / 20 mN/mm."""
    hung = run(folder, monkeypatch, HUNG)
    hung.steps(250)
    lengths, tensions = (
        list(values.values())
        for values in (hung.simulation.observe().cable_lengths, hung.simulation.observe().cable_tensions)
    )
    assert lengths == pytest.approx([40 + 0.06 * 9810 / 50, 35 + 0.01 * 9810 / 20], rel=5e-3)
    assert tensions == pytest.approx([0.06 * 9810, 0.01 * 9810], rel=1e-2)


def test_springs_of_a_mesh_join_the_corners_of_its_cells(tmp_path: Path) -> None:
    """Six tetrahedra of a box have 19 edges; the stiffness is by relative stretch, so that it is the cable's own."""
    write_volume_mesh(make_block((1, 1, 1), (20.0, 10.0, 10.0)), tmp_path / "block.vtk")
    field = 'body(root).addObject("MeshSpringForceField", tetrahedraStiffness=30, tetrahedraDamping=1, {})'
    translation = translate(loaded(tmp_path, field.format("noCompression=True"), BODY))
    assert not translation.refused
    cables = translation.tables["soft_bodies"]["body"]["cables"]
    assert len(cables) == 19
    assert {(one["axial_stiffness"], one["rod"]) for one in cables.values()} == {(30.0, False)}
    assert set(translation.springs.values()) == {0.0}
    assert any("no damping" in line for line in translation.departures)


@pytest.mark.parametrize(
    ("data", "refusal"),
    [
        ("spring=[0, 1, 50, 0]", "spring has 4 numbers; they are not rows of five"),
        ("spring=[0, 99, 50, 0, 1]", "names point 99; there are 8"),
        ("indices1=[0, 1], indices2=[2]", "indices1 has 2 points, indices2 1"),
        ("spring=[3, 3, 50, 0, 1]", "joins points 3 and 3 at one place"),
        ("object1='@../nowhere', spring=[0, 1, 1, 0, 1]", "'@../nowhere' leads to no MechanicalObject"),
    ],
)
def test_springs_that_make_no_sense(tmp_path: Path, data: str, refusal: str) -> None:
    write_volume_mesh(make_block((1, 1, 1), (20.0, 10.0, 10.0)), tmp_path / "block.vtk")
    refused = translate(loaded(tmp_path, f'body(root).addObject("StiffSpringForceField", {data})', BODY)).refused
    assert any(refusal in line for line in refused), refused
