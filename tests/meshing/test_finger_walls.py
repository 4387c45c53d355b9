"""Walls by their thickness, fillets, inlet, stiff layer and base: positions that follow, and refusals."""

from typing import Any

import pytest
from fingers import finger_from_dict, refusal

from taichisoft_meshing.finger_dimensions import FingerParameters
from taichisoft_meshing.pneunet_finger import thin_walls


def test_the_tutorials_thin_walls() -> None:
    """Sides, slots to chambers (2.59 and 2.91: the slots are not quite in the middle), slots to channel."""
    assert sorted(set(thin_walls(FingerParameters()).round(6))) == [2.5, 2.5894, 2.9106, 3.0]


@pytest.mark.parametrize("tables", [{"wall": 2.0}, {"walls": {"side": 2.0}}])
def test_the_side_wall_takes_the_place_of_the_cavitys_width(tables: dict[str, Any]) -> None:
    finger = finger_from_dict({**tables, "chambers": {"depth": 15.0}})
    assert (finger.chambers.depth, finger.channel.width) == (16.0, 16.0)
    assert finger.body.width == 20.0
    assert thin_walls(finger)[0] == 2.0


def test_the_tutorials_thicknesses_give_the_tutorials_positions() -> None:
    walls = {"side": 2.5, "back": 8.0, "floor": 8.5, "web": 3.0}
    finger = finger_from_dict({"walls": walls})
    assert finger.model_copy(update={"walls": FingerParameters().walls}) == FingerParameters()


def test_each_thickness_decides_its_positions() -> None:
    finger = finger_from_dict({"walls": {"back": 6.0, "floor": 7.0, "web": 2.0, "slot": 2.0}})
    assert (finger.channel.bottom, finger.channel.top) == (21.5, 24.0)
    assert finger.chambers.height == 14.5
    assert finger.slots.depth == 19.5
    assert (finger.slots.first, finger.slots.width, finger.slots.pitch) == (23.0, 4.0, 13.0)


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"wall": 0.0}, "wall = 0.0: input should be greater than 0"),
        ({"wall": -2.0}, "wall = -2.0: input should be greater than 0"),
        ({"wall": float("nan")}, "wall = nan: input should be a finite number"),
        ({"wall": 10.0}, "wall = 10: must be at most 9.95 (to leave a cavity in body.width)"),
        ({"wall": 0.05}, "channel.width = 19.9: must be at most 19.8 (to leave walls at its sides)"),
        ({"wall": 2.0, "walls": {"side": 2.0}}, "wall = 2: is short for walls.side, which is given too"),
        ({"walls": {"side": 12.0}}, "walls.side = 12: must be at most 9.95"),
        ({"walls": {"back": 28.0}}, "walls.back = 28: must be at most 27.4 (to leave room for the channel)"),
        ({"walls": {"floor": 19.5}}, "walls.floor = 19.5: must be at most 19.4 (to leave chambers below channel.b"),
        ({"walls": {"web": 19.5}}, "walls.web = 19.5: must be at most 19.4 (to leave slots below channel.bottom)"),
        ({"walls": {"slot": 4.0}}, "walls.slot = 4: must be at most 3.95 (to leave slots between the chambers)"),
        ({"walls": {"web": 2.0}, "slots": {"count": 0}}, "walls.web = 2: there are no slots, slots.count = 0"),
        ({"walls": {"sides": 2.0}}, "walls.sides: unknown key; did you mean 'side'?"),
        ({"slots": {"fillet_radius": 1.25}}, "slots.fillet_radius = 1.25: must be at most 1.2 (below half of slots"),
        ({"slots": {"fillet_radius": -1.0}}, "slots.fillet_radius = -1.0: input should be greater than or equal"),
        ({"chambers": {"fillet_radius": 2.5}}, "chambers.fillet_radius = 2.5: must be at most 2.45 (below half of"),
        (
            {"chambers": {"fillet_radius": 2.0, "height": 2.0}},
            "chambers.fillet_radius = 2: must be at most 1.9 (below chambers.height)",
        ),
        ({"inlet": {"diameter": 2.5}}, "inlet.diameter = 2.5: must be at most 2.3 (to open into the near end of"),
        ({"inlet": {"diameter": 2.0, "plug": 16.0}}, "inlet.plug = 16: must be at most 15.9 (to leave a bore"),
        ({"inlet": {"diameter": 2.0, "plug": 0.0}}, "inlet.plug = 0.0: input should be greater than 0"),
        ({"body": {"base_length": 16.0}}, "body.base_length = 16: must be at most 15.9 (to end before the channel)"),
        (
            {"body": {"base_length": 12.0}, "slots": {"first": 10.0, "depth": 5.0}},
            "body.base_length = 12: must be at most 9.9 (to end before the slots)",
        ),
        ({"stiff_layer": {"start": 100.0}}, "stiff_layer.end = 100: must be at least 100.1 (beyond stiff_layer.st"),
        ({"stiff_layer": {"end": 116.0}}, "stiff_layer.end = 116: must be at most 115 (body.length)"),
        ({"stiff_layer": {"thickness": 8.0}}, "stiff_layer.thickness = 8: must be at most 7.5 (body.height"),
        ({"stiff_layer": {"bottom": 30.0}}, "stiff_layer.bottom = 30: must be at most 29.9 (below body.height)"),
        ({"stiff_layer": {"width": 21.0}}, "stiff_layer.width = 21: must be at most 20 (body.width)"),
        ({"mesh": {"largest": 0.0}}, "mesh.largest = 0.0: input should be greater than 0"),
        ({"mesh": {"largest": -4.0}}, "mesh.largest = -4.0: input should be greater than 0"),
        ({"mesh": {"smallest": float("nan")}}, "mesh.smallest = nan: input should be a finite number"),
        ({"mesh": {"largest": 116.0}}, "mesh.largest = 116: must be at most 115 (body.length: elements larger th"),
        (
            {"mesh": {"elements_across_walls": 0}},
            "mesh.elements_across_walls = 0: input should be greater than or equal to 1",
        ),
    ],
)
def test_what_leaves_no_room_is_named_with_what_would_be_valid(tables: dict[str, Any], message: str) -> None:
    assert refusal(tables).startswith(message)


def test_what_is_absent_need_not_fit() -> None:
    """A layer of no thickness, a bore of no diameter and fillets of no slots may have any other dimension."""
    finger_from_dict({"stiff_layer": {"thickness": 0.0, "end": 500.0}, "inlet": {"plug": 99.0}})
    finger_from_dict({"slots": {"count": 0, "fillet_radius": 9.0}})
