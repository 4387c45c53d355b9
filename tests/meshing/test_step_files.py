"""STEP files that are read, and those that are not."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from solid_shapes import write_step

from taichisoft.errors import MeshError
from taichisoft_meshing.cad_body import read_step


def two_voids(occ: Any) -> None:
    """A block of 12000 mm^3 with a ball and a box in it."""
    voids = [(3, occ.addSphere(10, 10, 10, 5)), (3, occ.addBox(20, 8, 8, 4, 4, 4))]
    occ.cut([(3, occ.addBox(0, 0, 0, 30, 20, 20))], voids)


def test_a_body_with_two_voids(tmp_path: Path) -> None:
    solid = read_step(write_step(tmp_path / "body.step", two_voids))
    assert sorted(solid.void_volumes) == pytest.approx([64, 4 / 3 * np.pi * 125], rel=1e-9)
    assert solid.volume == pytest.approx(12000 - sum(solid.void_volumes), rel=1e-9)
    assert solid.extent == pytest.approx([30, 20, 20], abs=1e-5)
    assert not solid.flat


def test_a_file_in_metres_is_taken_to_millimetres(tmp_path: Path) -> None:
    """And one in millimetres is read as such after it."""
    path = write_step(tmp_path / "body.stp", lambda occ: occ.addBox(0, 0, 0, 3, 2, 1))
    millimetres = path.read_text()
    assert "SI_UNIT(.MILLI.,.METRE.)" in millimetres
    metres = tmp_path / "metres.step"
    metres.write_text(millimetres.replace("SI_UNIT(.MILLI.,.METRE.)", "SI_UNIT($,.METRE.)"))
    for _ in range(2):
        assert read_step(metres).volume == pytest.approx(6e9)
        assert read_step(path).volume == pytest.approx(6.0)
    assert read_step(path).flat


def body_in_a_void(occ: Any) -> None:
    occ.cut([(3, occ.addBox(0, 0, 0, 10, 10, 10))], [(3, occ.addBox(2, 2, 2, 6, 6, 6))])
    occ.addBox(4, 4, 4, 2, 2, 2)


@pytest.mark.parametrize(
    ("draw", "problem"),
    [
        (
            lambda occ: [occ.addBox(0, 0, 0, 10, 20, 20), occ.addBox(40, 0, 0, 10, 10, 10)],
            r"has 2 solids, of 4000, 1000 mm\^3, and solid 2 shares no face with those joined to solid 1",
        ),
        (body_in_a_void, r"has 2 solids, of 784, 8 mm\^3, and solid 2 shares no face"),
        (lambda occ: occ.addRectangle(0, 0, 0, 1, 1), "has no solid body, and 1 face; export the body as a solid"),
    ],
)
def test_one_body_of_solids_is_needed(tmp_path: Path, draw: Callable[[Any], object], problem: str) -> None:
    path = write_step(tmp_path / "body.step", draw)
    with pytest.raises(MeshError, match=f"^{path}: {problem}"):
        read_step(path)


def edited(change: Callable[[str], str]) -> Callable[[Path], None]:
    def edit(path: Path) -> None:
        write_step(path, lambda occ: occ.addBox(0, 0, 0, 1, 1, 1))
        text = path.read_text()
        assert change(text) != text
        path.write_text(change(text))

    return edit


@pytest.mark.parametrize(
    ("write", "problem"),
    [
        (lambda path: None, r"no such file; a STEP file \(.step, .stp\) is needed"),
        (lambda path: path.mkdir(), "cannot be read: Is a directory"),
        (lambda path: path.write_text(" \n"), "is not a STEP file: it does not begin with ISO"),
        (
            lambda path: path.write_text("solid body\nendsolid"),
            "is not a STEP file: it does not begin with ISO-10303-21",
        ),
        (lambda path: path.write_text("ISO-10303-21;\nHEADER;\nEND-ISO-10303-21;\n"), "it has no section DATA"),
        (edited(lambda text: text[: len(text) // 2]), "stops too early: it does not end with END-ISO-10303-21"),
        (
            edited(lambda text: text.replace("(0.,0.,0.)", "(0.,NaN,0.)", 1)),
            r"line \d+ has the number NaN, which is not finite",
        ),
        (edited(lambda text: text.replace("CLOSED_SHELL", "OPEN_WORD")), "has no solid body|not readable as STEP"),
    ],
)
def test_files_that_are_no_step_files_are_told(tmp_path: Path, write: Callable[[Path], None], problem: str) -> None:
    path = tmp_path / "body.step"
    write(path)
    with pytest.raises(MeshError, match=f"^{path}: .*({problem})"):
        read_step(path)


def test_another_suffix_is_told(tmp_path: Path) -> None:
    with pytest.raises(MeshError, match=r"body.iges: '.iges' is not a kind of STEP file; valid: .step, .stp$"):
        read_step(tmp_path / "body.iges")


def test_names_that_read_like_numbers_are_names(tmp_path: Path) -> None:
    path = tmp_path / "body.step"
    edited(lambda text: text.replace("MANIFOLD_SOLID_BREP(''", "MANIFOLD_SOLID_BREP('(NaN,inf)'"))(path)
    assert read_step(path).volume == pytest.approx(1.0)
