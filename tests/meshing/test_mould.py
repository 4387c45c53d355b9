"""The mould of a finger: what is cast in it is the finger, and its halves can be pulled apart."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from conftest import Figures

from taichisoft.errors import MeshError
from taichisoft_meshing.commands.mould import write_parts
from taichisoft_meshing.finger.finger_parts import write_finger
from taichisoft_meshing.finger.parameters import FingerParameters

WALL = 5.0


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("mould")
    write_finger(FingerParameters(), place, "finger", WALL)
    return place


def part(folder: Path, name: str) -> trimesh.Trimesh:
    return trimesh.load(folder / f"finger{name}.stl")


def test_every_part_is_closed_and_has_the_volume_of_the_drawing(folder: Path, figures: Figures) -> None:
    """box - outside = halves; outside - core = finger: what the mould and its core leave free is the silicone."""
    finger = FingerParameters()
    parts = {name: part(folder, name) for name in ("", "-mould-left", "-mould-right", "-core")}
    assert all(one.is_watertight for one in parts.values())
    body = finger.body
    box = (body.length + WALL) * (body.height + 2 * WALL) * (body.width + 2 * WALL)
    halves = parts["-mould-left"].volume + parts["-mould-right"].volume
    silicone = finger.solid_volume - finger.cavity_volume
    # Between flat faces only the rounding of STL's single precision is missing.
    figures.close("silicone [mm^3]", parts[""].volume, silicone, 1e-5 * silicone)
    figures.close("core [mm^3]", parts["-core"].volume, finger.cavity_volume, 1e-5 * finger.cavity_volume)
    figures.close("free in the mould [mm^3]", box - halves - parts["-core"].volume, silicone, 1e-5 * silicone)


def test_the_halves_mirror_each_other_and_have_no_undercut(folder: Path) -> None:
    """All of the right half that faces along +z, the way it is pulled, is its back: nothing holds the finger there."""
    left, right = part(folder, "-mould-left"), part(folder, "-mould-right")
    np.testing.assert_allclose(left.bounds[:, :2], right.bounds[:, :2])
    np.testing.assert_allclose(-left.bounds[::-1, 2], right.bounds[:, 2], atol=1e-6)
    assert left.volume == pytest.approx(right.volume, rel=1e-6)
    facing = right.face_normals[:, 2] > 1e-6
    np.testing.assert_allclose(right.triangles[facing][:, :, 2], right.bounds[1, 2])


def test_there_is_a_solid_in_the_step_file(folder: Path) -> None:
    assert "BREP_WITH_VOIDS" in (folder / "finger.step").read_text()


def test_other_kinds_are_refused(tmp_path: Path) -> None:
    with pytest.raises(MeshError, match=r"x.toml: kind = 'tendon_finger': there is a mould of the kind pneunet_finger"):
        write_parts("tendon_finger", {}, tmp_path / "x.toml", tmp_path, 5.0)
