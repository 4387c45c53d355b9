"""mesh-report.png: the mesh cut open."""

from pathlib import Path

import numpy as np
import pytest
from blocks import make_block

from taichisoft import VolumeMesh
from taichisoft.errors import MeshError
from taichisoft.mesh import SectionPlane
from taichisoft_meshing.mesh_quality import QualityLimits, measure
from taichisoft_meshing.report_picture import CAVITY, CUT, cut_open, draw_report


def hollow() -> VolumeMesh:
    """Wall of 10 mm around a hollow of 80 x 30 x 10 mm."""
    return make_block((10, 5, 3), (100.0, 50.0, 30.0), hollow=True)


def test_the_cut_shows_the_silicone_and_the_wall_of_the_cavity() -> None:
    mesh = hollow()
    cut = cut_open(mesh, measure(mesh).surfaces)
    sides = cut.corners[:, 1:, :2] - cut.corners[:, :1, :2]
    areas = np.linalg.det(sides) / 2
    assert (areas > 0).all()  # what faces the eye, the right way round
    seen = {side: areas[cut.side == side].sum() for side in (CUT, CAVITY)}
    assert seen[CUT] == pytest.approx(100 * 50 - 80 * 30, rel=1e-9), "a plane section of true size, no whole elements"
    assert cut.plane == "z = 0 mm"
    assert seen[CAVITY] == pytest.approx(80 * 30, rel=1e-9), "seen straight on, so that the axes hold for all of it"
    assert (cut.facing > 0).all()
    assert cut.corners.min(axis=(0, 1))[0] == pytest.approx(-50)
    assert cut.corners.max(axis=(0, 1))[0] == pytest.approx(50)


def test_near_faces_are_painted_over_far_ones() -> None:
    mesh = hollow()
    cut = cut_open(mesh, measure(mesh).surfaces, SectionPlane.parse("x+y+z<0"))
    assert (np.diff((cut.side == CUT).astype(int)) >= 0).all(), "nothing stands before the section"
    heights = cut.corners[cut.side != CUT][..., 2].mean(axis=1)
    assert (np.diff(heights) >= 0).all() and len(np.unique(heights.round(6))) > 1


@pytest.mark.parametrize(
    ("plane", "area", "axes"),
    [
        ("y=5", 100 * 30 - 80 * 10, [[1, 0, 0], [0, 0, 1]]),
        ("x<30", 50 * 30 - 30 * 10, [[0, 1, 0], [0, 0, 1]]),
        ("x>30", 50 * 30 - 30 * 10, [[0, -1, 0], [0, 0, 1]]),
        ("y+z=0", 100 * 30 * 2**0.5 - 80 * 10 * 2**0.5, [[1, 0, 0], [0, 0.5**0.5, -(0.5**0.5)]]),
    ],
)
def test_any_plane_may_cut(plane: str, area: float, axes: list[list[float]]) -> None:
    """The section has its true area; the eye is on the side of what is left out, or where both axes point onward."""
    mesh = hollow()
    cut = cut_open(mesh, measure(mesh).surfaces, SectionPlane.parse(plane))
    a, b, c = np.moveaxis(cut.corners[cut.side == CUT][..., :2], 1, 0)
    assert np.linalg.det(np.stack([b - a, c - a], axis=1)).sum() / 2 == pytest.approx(area, rel=1e-9)
    np.testing.assert_allclose(cut.axes, axes, atol=1e-12)
    with pytest.raises(MeshError, match=r"section y = 99 mm: does not cut the mesh, which spans \[-50.0, "):
        cut_open(mesh, measure(mesh).surfaces, SectionPlane.parse("y=99"))


@pytest.mark.parametrize(
    "mesh", [hollow(), make_block((1, 1, 1), (1e-2, 1e-2, 1e-2)), make_block((9, 1, 1), (900, 9, 9))]
)
def test_the_picture_is_neither_empty_nor_black(mesh: VolumeMesh, tmp_path: Path) -> None:
    from matplotlib.image import imread

    path = tmp_path / "mesh-report.png"
    draw_report(mesh, measure(mesh), QualityLimits(), r"a $\name$ with_signs", path)
    picture = imread(path)[..., :3]
    assert picture.shape[:2] == (880, 1210)
    assert picture[[0, -1]].min() == picture[:, [0, -1]].min() == 1.0  # nothing is cut off at the border
    drawn = (picture < 0.99).any(axis=-1)
    assert 0.05 < drawn.mean() < 0.6
    assert (picture.max(axis=-1) < 0.1).mean() < 0.05
    upper, lower = drawn[:480], drawn[520:]
    assert upper.mean() > 0.03
    assert lower[:, :600].mean() > 0.01 < lower[:, 600:].mean()
    assert list(tmp_path.iterdir()) == [path]
