"""A finger's dimensions: the tutorial's values, and every wall that must remain."""

import math
from typing import Any

import pytest
from fingers import finger_from_dict, read_finger, refusal

from taichisoft.errors import MeshError
from taichisoft.scene import data_folder
from taichisoft_meshing.finger_dimensions import ElementSizes, FingerParameters

TUTORIAL = data_folder() / "fingers" / "tutorial.toml"


def test_the_defaults_are_the_shipped_tutorials_finger() -> None:
    assert read_finger(TUTORIAL) == FingerParameters()


def test_the_volumes_are_the_tutorials() -> None:
    finger = FingerParameters()
    assert finger.solid_volume == pytest.approx(60050, rel=1e-12)
    assert finger.cavity_volume == pytest.approx(8887.5, rel=1e-12)


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"body": {"length": -115.0}}, "body.length = -115.0: input should be greater than 0"),
        ({"body": {"width": 0}}, "body.width = 0: input should be greater than 0"),
        ({"slots": {"depth": math.nan}}, "slots.depth = nan: input should be a finite number"),
        ({"slots": {"depth": math.inf}}, "slots.depth = inf: input should be a finite number"),
        ({"slots": {"count": -1}}, "slots.count = -1: input should be greater than or equal to 0"),
        ({"slots": {"count": 2.5}}, "slots.count = 2.5: input should be a valid integer"),
        ({"chambers": {"count": 0}}, "chambers.count = 0: input should be greater than or equal to 1"),
        ({"body": {"height": "30"}}, "body.height = '30': input should be a valid number"),
        ({"body": {"height": True}}, "body.height = True: input should be a valid number"),
        ({"body": 30.0}, "body = 30.0: must be a table, [body]"),
    ],
)
def test_a_wrong_value_is_named_with_its_key(tables: dict[str, Any], message: str) -> None:
    assert refusal(tables) == message or refusal(tables).startswith(f"{message}, ")


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"slots": {"dept": 16.5}}, "slots.dept: unknown key; did you mean 'depth'?"),
        ({"chamber": {}}, "chamber: unknown key; did you mean 'chambers'?"),
        (
            {"zzz": 1},
            "zzz: unknown key; valid keys: wall, walls, body, slots, channel, chambers, inlet, stiff_layer, mesh",
        ),
    ],
)
def test_an_unknown_key_names_the_nearest_right_one(tables: dict[str, Any], message: str) -> None:
    assert refusal(tables) == message


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"body": {"tip_height": 30.0}}, "body.tip_height = 30: must be at most 29.9"),
        ({"body": {"taper_length": 115.0}}, "body.taper_length = 115: must be at most 114.9"),
        ({"body": {"length": 99.0}}, "channel.end = 99: must be at most 98.9 (to leave a wall at the tip)"),
        ({"body": {"height": 22.0}}, "channel.top = 22: must be at most 21.9 (to leave a wall at the back)"),
        ({"body": {"width": 15.0}}, "channel.width = 15: must be at most 14.8 (to leave walls at its sides)"),
        (
            {"channel": {"start": 0.05}},
            "channel.start = 0.05: must be at least 0.1 (to leave a wall at the base)",
        ),
        ({"channel": {"end": 16.0}}, "channel.end = 16: must be at least 16.1 (beyond channel.start)"),
        ({"channel": {"top": 19.5}}, "channel.top = 19.5: must be at least 19.6 (above channel.bottom)"),
        ({"channel": {"bottom": 4.05}}, "channel.bottom = 4.05: must be at least 4.1 (to leave a wall above"),
        ({"chambers": {"depth": 20.0}}, "chambers.depth = 20: must be at most 19.8 (to leave walls"),
        (
            {"chambers": {"height": 19.5}},
            "chambers.height = 19.5: must be at most 15.4 (to leave a wall above",
        ),
        ({"chambers": {"pitch": 5.0}}, "chambers.pitch = 5: must be at least 5.1 (beyond chambers.width)"),
        ({"chambers": {"first": 15.0}}, "chambers.first = 15: must be at least 16 (channel.start)"),
        (
            {"chambers": {"count": 8}},
            "chambers.count = 8: the last chamber would end 112 mm from the base, beyond channel.end = 99; "
            "must be at most 7",
        ),
        (
            {"slots": {"first": 0.05}},
            "slots.first = 0.05: must be at least 0.1 (to leave a wall at the base)",
        ),
        ({"slots": {"pitch": 2.5}}, "slots.pitch = 2.5: must be at least 2.6 (beyond slots.width)"),
        (
            {"slots": {"count": 7}},
            "slots.count = 7: the last slot would end 104.411 mm from the base; must end",
        ),
        (
            {"slots": {"depth": 19.5}},
            "slots.depth = 19.5: must be at most 19.4 (to leave a wall below the channel)",
        ),
        (
            {"slots": {"first": 21.05}},
            "slots.depth = 16.5: slot 1 (21.05 to 23.55 mm from the base) cuts into chamber 1, "
            "which begins at 16; must be at most 8.4, or the slots must pass between the chambers",
        ),
        ({"mesh": {"smallest": 19.0}}, "mesh.smallest = 19: must be at most 18 (mesh.largest)"),
        ({"mesh": {"largest": 0.1, "smallest": 0.1}}, "mesh.largest = 0.1: must be at least 0.44"),
    ],
)
def test_a_wall_that_vanishes_is_named_with_what_would_be_valid(tables: dict[str, Any], message: str) -> None:
    assert refusal(tables).startswith(message)


def test_slots_below_the_chambers_may_stand_anywhere() -> None:
    finger = finger_from_dict({"slots": {"first": 16.0, "depth": 8.4}})
    assert finger.slots.depth == 8.4


def test_a_size_replaces_the_largest_and_scales_the_smallest(tmp_path) -> None:
    path = tmp_path / "finger.toml"
    path.write_text("[mesh]\nlargest = 8.0\nsmallest = 4.0\nelements_across_walls = 3\ncurvature = 12\n")
    sizes = read_finger(path, size=6.0).mesh
    assert sizes == ElementSizes(largest=6.0, smallest=3.0, elements_across_walls=3, curvature=12)
    with pytest.raises(MeshError, match=r"mesh\.largest = -1\.0: input should be greater than 0"):
        read_finger(path, size=-1.0)


def test_a_file_that_is_absent_or_no_toml_is_refused_in_one_line(tmp_path) -> None:
    path = tmp_path / "finger.toml"
    with pytest.raises(MeshError, match=r"finger\.toml: no such file; a geometry file \(\.toml\) is needed$"):
        read_finger(path)
    for content in (b"length = \n", b"\xff\xfe"):
        path.write_bytes(content)
        with pytest.raises(MeshError, match=r"finger\.toml: not readable as TOML: [^\n]+$"):
            read_finger(path)
