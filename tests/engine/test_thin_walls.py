"""What a scene says of its meshes: walls of one element of shipped ones, and volumes that regions have caught."""

import logging
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from blocks import make_block

from taichisoft import load_scene
from taichisoft.mesh import boundary_triangles
from taichisoft.mesh.volume_mesh import share_of_thin_walls
from taichisoft.running.plausibility import say_region_volumes, warn_of_thin_walls
from taichisoft.running.simulation import load_meshes
from taichisoft.scene import scene_from_dict


def said(scene: Any) -> list[str]:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        warn_of_thin_walls(scene, load_meshes(scene))
    return [str(one.message) for one in caught]


@pytest.mark.parametrize(("cells", "share"), [((3, 3, 3), 1.0), ((5, 5, 5), 1.0), ((4, 4, 4), 1.0)])
def test_walls_of_one_cell_are_one_element_thick(cells: tuple[int, int, int], share: float) -> None:
    mesh = make_block(cells, (20.0, 20.0, 20.0), hollow=True)
    assert share_of_thin_walls(mesh, mesh.surface_groups["cavity"]) == share


def test_walls_of_two_cells_are_not() -> None:
    """A hollow of one cell in the middle of a block of five: no edge leads from its sides to the outside."""
    mesh = make_block((5, 5, 5), (20.0, 20.0, 20.0))
    middle = np.abs(mesh.nodes[mesh.elements].mean(axis=1)).max(axis=1) < 2.0
    hollow = mesh.elements[~middle]

    walls = boundary_triangles(hollow)
    inner = walls[np.abs(mesh.nodes[walls]).max(axis=(1, 2)) < 3.0]
    assert share_of_thin_walls(replace(mesh, elements=hollow), inner) == 0.0


def test_shipped_mesh_of_thin_walls_is_warned_of_once() -> None:
    """Three fingers share it; the line says how far smoothed elements bend at the body's Poisson's ratio."""
    (line,) = said(load_scene("gripper-dragon-skin"))
    assert line.startswith("soft_bodies.finger1.mesh: walls of one element")
    assert "at a Poisson's ratio of 0.499 a bar of them alone bends as little as 31% of what is right" in line
    assert said(load_scene("gripper-dragon-skin", ["soft_bodies.finger1.element=quadratic"])) == []
    assert said(load_scene("gripper-dragon-skin")) == []  # once in a process


@pytest.mark.parametrize(
    ("cells", "changes", "told"),
    [
        ((6, 1, 1), {"poisson_ratio": 0.45}, "bends as little as 62% of what is right"),
        ((6, 1, 1), {"poisson_ratio": 0.47}, "bends as little as 52% of what is right"),
        ((6, 1, 1), {"poisson_ratio": 0.3}, ""),
        ((6, 1, 1), {"poisson_ratio": 0.45, "element": "linear"}, ""),  # which has a line of its own
        ((6, 3, 3), {"poisson_ratio": 0.499}, ""),
    ],
)
def test_any_body_of_one_element_is_warned_of(
    block: Callable[..., str], cells: tuple[int, int, int], changes: dict[str, Any], told: str
) -> None:
    """Where it is hardly compressible, with the figure of its Poisson's ratio."""
    table = {"mesh": block(cells, (30.0, 5.0, 5.0)), "density": 1e-6, "young_modulus": 100.0}
    lines = said(scene_from_dict({"soft_bodies": {"bar": {**table, **changes}}}))
    assert len(lines) == bool(told) and all(told in line for line in lines)


def test_volume_that_regions_box_has_caught_is_said(caplog: pytest.LogCaptureFixture) -> None:
    """By the centres of elements: on the coarse mesh a third more than the box has."""
    scene = load_scene("finger-dragon-skin")
    with caplog.at_level(logging.INFO, logger="taichisoft.running"):
        say_region_volumes(scene, load_meshes(scene))
    (line,) = [record.getMessage() for record in caplog.records]
    assert line == ("soft_bodies.finger.regions.0.box: 158 of 1970 elements, 9336 of 51162 mm^3; the box has 7128 mm^3")
    assert Path(scene.soft_bodies["finger"].mesh.file).name == "tutorial-coarse.msh"
