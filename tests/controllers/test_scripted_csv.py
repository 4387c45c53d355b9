"""Scripts as comma-separated values: the same as their TOML, and what is refused, with line and column."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_up import controller_of, follow, pressures, refusal, write

from taichisoft.errors import SceneError
from taichisoft_controllers.script_file import read_keyframes
from taichisoft_controllers.scripted_controller import scripted_controller

CSV = """\
# two fingers close, one after the other
time [s], pressure left [kPa], pressure right [kPa], base_translation z [mm], base_rotation x [degrees]
0.2,      0,                   0,                    0,                       0

1.2,      50,                  0,                    0,                       0
1.7,      50,                  4e1,                  30.5,                    90
"""
TOML = """
[[keyframes]]
time = 0.2
pressure = { left = 0.0, right = 0.0 }
[[keyframes]]
time = 1.2
pressure = { left = 50.0, right = 0.0 }
[[keyframes]]
time = 1.7
pressure = { left = 50.0, right = 40.0 }
base_translation = [0.0, 0.0, 30.5]
base_rotation = [90.0, 0.0, 0.0]
"""


@pytest.mark.parametrize("interpolation", [None, "smooth"])
def test_a_csv_asks_for_the_same_as_its_toml(tmp_path: Path, interpolation: str | None) -> None:
    one = follow(controller_of(tmp_path, CSV, "script.csv", interpolation=interpolation), 2.0)
    other = follow(controller_of(tmp_path, TOML, interpolation=interpolation), 2.0)
    assert one.keys() == other.keys()
    for time, control in one.items():
        assert control.pressure == other[time].pressure
        np.testing.assert_array_equal(control.base_translation, other[time].base_translation)
        np.testing.assert_array_equal(control.base_rotation, other[time].base_rotation)


@pytest.mark.parametrize(
    "content",
    [
        "time,pressure\n0,7\n",
        "\ufefftime,pressure\r\n0,7\r\n",
        'pressure [kPa],"time [s]"\n"7",0',
        "time ,pressure[kPa]\n 0 , 7 ",
    ],
)
def test_what_programs_and_people_write_is_read(tmp_path: Path, content: str) -> None:
    """With a byte-order mark and line ends as from Excel, columns in any order, quotes, blanks."""
    assert pressures(follow(controller_of(tmp_path, content, "script.csv"), 0.0)[0.0]) == [7.0] * 3


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "needs a first line with the names of the columns, as in: time,pressure"),
        ("# only a comment", "needs a first line"),
        ("time,pressure", "keyframes = []: at least 1 is needed"),
        ("tme,pressure\n0,1", "column 'tme': unknown; did you mean 'time'?"),
        ("time,pressure,base_x\n0,1,1", "column 'base_x': unknown; "),
        ("time;pressure\n0;1", "column 'time;pressure': unknown; "),
        ("time,pressure [bar]\n0,1", "column 'pressure [bar]': its unit is kPa, not bar"),
        ("time [ms],pressure\n0,1", "column 'time [ms]': its unit is s, not ms"),
        ("# a\ntime,time,pressure\n0,1,1", "there are 2 columns 'time'; keep one"),
        ("time,pressure,pressure left\n0,1,1", "the columns 'pressure' and 'pressure left' exclude each other"),
        ("pressure\n1", "the column 'time' is missing; columns are: pressure"),
        ("time\n1", "keyframes.0: needs at least one of pressure, valve, pull, tension"),
        ("time,pressure\n\n0", "0: has 1 cells; 2 are needed, one for each column"),
        ("time,pressure\n0,1,2", "0,1,2: has 3 cells; 2 are needed"),
        ("time,pressure\n0,", "0,: each cell must be a number, as in 0.5"),
        ("time,pressure\n0,high", "0,high: each cell must be a number, as in 0.5"),
        ("time,pressure\n0,nan", "keyframes.0.pressure = nan: input should be a finite number"),
        ("time,pressure\n1,1\n0.5,1", "the times of the keyframes must increase; they are [1.0, 0.5]"),
        ("time,pressure\n-1,1", "keyframes.0.time = -1.0: input should be greater than or equal to 0"),
        ("time,pressure\n0,\0", "each cell must be a number"),
    ],
)
def test_a_wrong_csv_is_refused_in_one_line(tmp_path: Path, content: str, message: str) -> None:
    assert message in refusal(write(tmp_path, content, "script.csv"))


def test_a_finger_that_there_is_not_is_refused_before_the_run(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"keyframes\.0\.pressure: no finger or cavity is called 'lift'; did you mean"):
        controller_of(tmp_path, "time,pressure lift,pressure right\n0,1,1", "script.csv")


def test_a_file_that_is_no_text_is_named(tmp_path: Path) -> None:
    path = tmp_path / "script.csv"
    path.write_bytes(b"time,pressure\n\xff\xfe")
    with pytest.raises(SceneError, match=r"script\.csv: not readable as CSV: "):
        scripted_controller(path)


@given(st.text() | st.text("time,prsu \n0123456789.\"'[]#kPa", max_size=60).map("time,pressure\n".__add__))
def test_whatever_is_in_it_only_a_scene_error_comes_out(text: str) -> None:
    try:
        tables = read_keyframes(text)
    except SceneError:
        return
    assert set(tables) == {"keyframes"}
