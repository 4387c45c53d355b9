"""The table [quality] of a geometry file, for every kind."""

from pathlib import Path

import pytest

from taichisoft.errors import MeshError
from taichisoft_meshing.geometry_file import make_geometry, quality_limits
from taichisoft_meshing.mesh_quality import QualityLimits

FILE = Path("finger.toml")


def test_what_a_file_does_not_say_has_defaults() -> None:
    assert quality_limits({}, FILE) == QualityLimits()
    limits = quality_limits({"quality": {"radius_ratio": 0.2, "elements_across_walls": 2}}, FILE)
    assert limits == QualityLimits(radius_ratio=0.2, elements_across_walls=2)


@pytest.mark.parametrize(
    ("table", "problem"),
    [
        ({"radius_ratio": 2.0}, "quality.radius_ratio = 2.0: input should be less than or equal to 1"),
        ({"radius": 0.1}, "quality.radius: unknown key; did you mean 'radius_ratio'?"),
        ({"elements_across_walls": 2.5}, "quality.elements_across_walls = 2.5: input should be a valid integer"),
        ({"shortest_edge": float("nan")}, "quality.shortest_edge = nan: input should be a finite number"),
        ({"smallest_dihedral_angle": True}, "quality.smallest_dihedral_angle = True: input should be a valid number"),
        (3, "quality = 3: must be a table, [quality]"),
    ],
)
def test_what_is_wrong_is_said_with_the_file(table: object, problem: str) -> None:
    with pytest.raises(MeshError) as refused:
        make_geometry("pneunet_finger", {"quality": table}, FILE)
    assert str(refused.value) == f"finger.toml: {problem}"


def test_a_kind_does_not_see_the_table() -> None:
    make_geometry("pneunet_finger", {"quality": {"radius_ratio": 0.2}}, FILE)  # which knows no such key
