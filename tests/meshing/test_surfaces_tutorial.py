"""The surfaces of the PneuNet gripper tutorial, which are not part of the project."""

from pathlib import Path

import numpy as np
import pytest

from taichisoft.mesh import enclosed_volume, read_surface, tetrahedron_volumes
from taichisoft_meshing.file_bodies import SurfacesBody

MESHES = Path(__file__).resolve().parents[2].parent / "shared" / "tutorial-meshes"
OUTER, CAVITY = "pneunetCut.stl", "pneunetCavityCut.stl"
BASE = {"point": [0, 0, 0], "normal": [1, 0, 0]}

pytestmark = pytest.mark.skipif(
    not (MESHES / OUTER).is_file(), reason="needs ../shared/tutorial-meshes, which are not part of the project"
)


@pytest.mark.parametrize(("keep", "cavity"), [(False, [CAVITY]), (True, [CAVITY]), (True, [])])
def test_the_tutorials_finger(keep: bool, cavity: list[str]) -> None:
    """The first file has both surfaces; the cavity that the second one repeats is still one."""
    tables = {"outer": OUTER, "cavity": cavity, "keep_surface": keep, "cavities": 1, "base": BASE}
    tables["mesh"] = {"elements_across_walls": 1}
    mesh = SurfacesBody(tables, MESHES / "finger.toml").mesh(10.0)
    assert tetrahedron_volumes(mesh.nodes, mesh.elements).sum() == pytest.approx(51162.5, rel=1e-8)
    assert enclosed_volume(mesh.nodes, mesh.surface_groups["cavity"]) == pytest.approx(8887.5, rel=1e-9)
    a, b, c = np.moveaxis(mesh.nodes[mesh.surface_groups["base"]], 1, 0)
    assert np.cross(b - a, c - a).sum(axis=0) / 2 == pytest.approx([600, 0, 0], abs=1e-3)
    if keep:
        assert len(mesh.surface_groups["outer"]) + len(mesh.surface_groups["cavity"]) == 2968
        given = read_surface(MESHES / OUTER)[0]
        first = mesh.nodes[: len(given)]
        assert np.array_equal(first[np.lexsort(first.T)], given[np.lexsort(given.T)])
    else:
        assert 550 < len(mesh.nodes) < 700
