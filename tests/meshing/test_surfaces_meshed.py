"""Meshes of gmsh are compared with the bodies that they should be."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from blocks import make_block
from solid_shapes import box, save

from taichisoft import VolumeMesh
from taichisoft.errors import MeshError
from taichisoft.mesh import boundary_triangles, enclosed_volume
from taichisoft_meshing import file_bodies
from taichisoft_meshing.file_bodies import SurfacesBody
from taichisoft_meshing.gmsh_session import GmshFailure, _surfaces, compare_volumes


@pytest.fixture
def block() -> VolumeMesh:
    """27 boxes of 10 mm less the inner one, in tetrahedra: 26000 mm^3 around 1000."""
    return make_block((3, 3, 3), (30.0, 30.0, 30.0), hollow=True)


@pytest.mark.parametrize(
    ("silicone", "cavity", "tolerance", "problem"),
    [
        (26000.1, 1000, 1e-6, r"^block: silicone has 26000 mm\^3 in the mesh instead of 26000.1, 0.00038 % off; try"),
        (26000, 1010, 1e-6, r"^block: cavity has 1000 mm\^3 in the mesh instead of 1010, 0.99 % off; try another"),
        (26000, 1400, None, r"^block: cavity has 1000 mm\^3 in the mesh instead of 1400, 29 % off; try another si"),
    ],
)
def test_a_wrong_volume_is_refused(
    block: VolumeMesh, silicone: float, cavity: float, tolerance: float | None, problem: str
) -> None:
    compare_volumes(block, 26000, [1000], 1e-9)
    with pytest.raises(MeshError, match=problem):
        compare_volumes(block, silicone, [cavity], tolerance)


def test_what_chords_cut_off_is_said(block: VolumeMesh) -> None:
    with pytest.warns(UserWarning, match=r"^block: cavity has 1000 mm\^3 .* 1150, 13 % off: the curved surfaces are"):
        compare_volumes(block, 26000, [1150], None)


def test_surfaces_must_be_the_whole_boundary(block: VolumeMesh) -> None:
    boundary = boundary_triangles(block.elements)
    cavity = block.surface_groups["cavity"]
    outer = boundary[~np.isin(np.sort(boundary), cavity).all(axis=1)]
    shells = _surfaces(block.elements, [outer[:, ::-1], cavity])  # in whatever sense gmsh has them
    assert [enclosed_volume(block.nodes, shell) for shell in shells] == pytest.approx([27000, -1000])
    for wrong in ([outer], [outer, cavity[1:]], [outer, cavity, block.elements[:1, :3]]):
        with pytest.raises(GmshFailure, match="the tetrahedra do not end at the surfaces"):
            _surfaces(block.elements, wrong)


def test_a_surface_that_was_to_be_kept_and_was_not_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """gmsh may put a node on an edge that it cannot have otherwise; here one is moved."""
    meshed = file_bodies.meshed_body

    def moved(*arguments: Any) -> VolumeMesh:
        mesh = meshed(*arguments)
        mesh.nodes[0] += 1e-9
        return mesh

    monkeypatch.setattr(file_bodies, "meshed_body", moved)
    save(box((30, 20, 20)), tmp_path / "body.stl")
    geometry = SurfacesBody({"outer": "body.stl", "cavities": 0, "keep_surface": True}, tmp_path / "body.toml")
    with pytest.raises(
        MeshError, match=r"body.toml: gmsh cannot fill the body without changing its surface; remove keep"
    ):
        geometry.mesh()
