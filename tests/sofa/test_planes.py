"""Planes of penalty forces."""

from pathlib import Path

import pytest
from blocks import make_block
from scenes_of_sofa import BODY, loaded
from test_driven_bodies import run
from test_rigid_parts import folder as folder

from taichisoft import write_volume_mesh
from taichisoft_sofa.translation.translate import translate

FALLEN = """
def createScene(root):
    root.dt = 0.01
    root.gravity = [0, 0, -9810]
    free_motion(root)
    node = body(root, translation=[0, 0, 1])
    node.addObject("PlaneForceField", normal=[0, 0, 2], d=-30, stiffness=100)
"""


def test_a_block_lies_on_a_plane(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Behind n x = d of a normal that is not of length 1 there is nothing of it: it lies at z = -15 mm, and weighs m g.

    The scene has no contacts of its own.
    """
    fallen = run(folder, monkeypatch, FALLEN)
    fallen.steps(60)
    assert fallen.simulation.state.position[:, 2].min() == pytest.approx(-15.0, abs=1e-4)
    weight = fallen.simulation.observe().normal_forces["body", "plane0"]
    assert weight == pytest.approx(0.05 * 9810, rel=1e-3)


@pytest.mark.parametrize(
    ("data", "refusal"),
    [("normal=[0, 0, 0]", "has no direction"), ("normal=[0, 0, 1], bilateral=True", "push from one side")],
)
def test_planes_that_are_not_known(tmp_path: Path, data: str, refusal: str) -> None:
    write_volume_mesh(make_block((1, 1, 1), (20.0, 10.0, 10.0)), tmp_path / "block.vtk")
    refused = translate(loaded(tmp_path, f'body(root).addObject("PlaneForceField", {data})', BODY)).refused
    assert any(refusal in line for line in refused), refused
