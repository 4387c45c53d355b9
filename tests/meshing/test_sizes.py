"""Element sizes of a finger: presets, grading, and layers of elements in its thin walls."""

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fingers import finger_from_dict, sharp_fingers
from hypothesis import given

from taichisoft import VolumeMesh
from taichisoft_meshing.finger_dimensions import ElementSizes, FingerParameters
from taichisoft_meshing.pneunet_finger import (
    PneunetFinger,
    layer_boxes,
    layer_count,
    mesh_finger,
    slot_boxes,
    thin_walls,
    walled_boxes,
)
from taichisoft_meshing.wall_quality import find_walls, radius_ratios

TUTORIAL = PneunetFinger({}, Path("tutorial.toml"))


def across(mesh: VolumeMesh, thickest: float) -> set[int]:
    """Numbers of elements across the walls that are at most so thick [mm]."""
    walls = find_walls(mesh.nodes, mesh.elements)
    return set(walls.elements_across[walls.thickness < thickest].tolist())


@pytest.mark.parametrize(("preset", "nodes"), [("coarse", 550), ("medium", 2000), ("fine", 6000)])
def test_a_preset_gives_the_tutorials_finger_about_so_many_nodes(preset: str, nodes: int) -> None:
    mesh = TUTORIAL.mesh(TUTORIAL.presets[preset])
    assert len(mesh.nodes) == pytest.approx(nodes, rel=0.15)
    assert radius_ratios(mesh.nodes, mesh.elements).min() > 0.2
    assert across(mesh, 3.1) == ({2} if preset == "fine" else {1})


def test_presets_are_multiples_of_the_thinnest_wall() -> None:
    thinner = PneunetFinger({"wall": 1.25}, Path("finger.toml"))
    assert thinner.presets == {name: size / 2 for name, size in TUTORIAL.presets.items()}


def test_elements_are_small_at_the_cavity_and_grow_away_from_it() -> None:
    """Edges grow in the 16 mm of solid silicone at base and tip, by 0.5 mm a millimetre beyond a wall of 3 mm."""
    mesh = mesh_finger(FingerParameters(mesh=ElementSizes(largest=12.0, smallest=4.0)))
    corners = mesh.nodes[mesh.elements]
    edges = np.linalg.norm(corners[:, [0, 0, 0, 1, 1, 2]] - corners[:, [1, 2, 3, 2, 3, 3]], axis=2).mean(axis=1)
    middles = corners.mean(axis=1)
    at_cavity = (middles[:, 0] < -16) & (middles[:, 0] > -99) & (middles[:, 1] > 8.5) & (middles[:, 1] < 22)
    in_tip = middles[:, 0] < -107
    assert np.median(edges[at_cavity]) == pytest.approx(4.0, rel=0.15)
    before_cavity = (middles[:, 0] < -10) & (middles[:, 0] > -12)
    assert np.median(edges[before_cavity]) == pytest.approx(4.0 + 0.5 * 2, rel=0.15)
    assert np.median(edges[in_tip]) > 1.5 * np.median(edges[at_cavity])


@pytest.mark.parametrize(
    ("smallest", "wanted", "layers"),
    [(9.0, 2, 1), (3.01, 2, 1), (3.0, 2, 2), (2.0, 2, 2), (2.01, 3, 2), (2.0, 3, 3), (1.0, 1, 1)],
)
def test_layers_come_when_their_elements_are_not_too_flat(smallest: float, wanted: int, layers: int) -> None:
    """Up to 2.4 times as long as thick: 2.4 * 2.5 mm / 2 = 3 mm for two layers, 2 mm for three."""
    sizes = ElementSizes(largest=2 * smallest, smallest=smallest, elements_across_walls=wanted)
    assert layer_count(FingerParameters(mesh=sizes)) == layers


def test_an_even_mesh_heeds_no_wall() -> None:
    assert layer_count(FingerParameters(mesh=ElementSizes(largest=1.0, smallest=1.0))) == 1


@given(sharp_fingers())
def test_layers_stay_inside_their_walls(tables: dict[str, Any]) -> None:
    """Between the cavity and what is behind each wall; those of neighbouring chambers do not meet."""
    finger = finger_from_dict(tables)
    body, thin = finger.body, thin_walls(finger)
    for walled, box in zip(walled_boxes(finger), layer_boxes(finger, 2 / 3), strict=True):
        below, above = walled.box.lower - box.lower, box.upper - walled.box.upper
        for depth, wall, shared in zip((below, above), walled.walls, walled.shared, strict=True):
            assert (depth >= 0.4 * thin[0]).all()
            assert (depth < np.where(shared, 0.5, 0.75) * wall).all()
        assert (box.lower > [-body.length, 0.0, -body.width / 2]).all()
        assert (box.upper < [0.0, body.height, body.width / 2]).all()
    slots, chambers = slot_boxes(finger), layer_boxes(finger, 2 / 3)[1:]
    assert all(one.lower[0] > other.upper[0] for one, other in pairwise(chambers))
    for slot in (slot for slot in slots if slot.upper[1] > finger.channel.bottom - finger.chambers.height):
        assert all(slot.upper[0] < box.lower[0] or box.upper[0] < slot.lower[0] for box in chambers)


def test_layers_from_both_sides_of_a_wall_leave_a_layer_between_them() -> None:
    """A wall of 1.8 mm between two chambers: each side takes a third of it, half of two thirds."""
    finger = finger_from_dict({"slots": {"count": 0}, "chambers": {"pitch": 6.8}})
    behind, ahead = layer_boxes(finger, 0.5)[1:3]
    assert (behind.lower[0], ahead.upper[0]) == pytest.approx((-21.6, -22.2))


@pytest.mark.parametrize("layers", [2, 3])
def test_every_thin_wall_has_the_layers(layers: int) -> None:
    """The walls are those of sides and back, and between chambers; a report counts 95 % of their area."""
    finger = finger_from_dict(
        {
            "body": {"length": 40.0, "height": 15.0, "width": 12.0, "tip_height": 12.0, "taper_length": 5.0,
                     "base_length": 4.0},
            "channel": {"start": 8.0, "end": 30.0, "bottom": 10.0, "top": 12.0, "width": 8.0},
            "chambers": {"count": 3, "width": 4.0, "pitch": 9.0, "first": 8.0, "height": 5.0, "depth": 8.0},
            "slots": {"count": 1, "first": 14.0, "width": 1.0, "depth": 8.0},
            "stiff_layer": {"thickness": 0.0},
            "mesh": {"largest": 6.0, "smallest": 4.8 / layers, "elements_across_walls": layers},
        }
    )  # fmt: skip
    assert layer_count(finger) == layers
    mesh = mesh_finger(finger)
    assert min(across(mesh, 3.1)) == layers
    assert radius_ratios(mesh.nodes, mesh.elements).min() > 0.15
