"""The output "csv": its columns and numbers from a made-up run, also when the process was killed."""

import csv
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import csv_run
import pytest

from taichisoft import Scene
from taichisoft.control import PAIRS
from taichisoft.errors import TaichisoftError
from taichisoft.running.hooks import find
from taichisoft_outputs.csv_output import BUFFERED_STEPS, CsvOutput


def rows_of(folder: Path) -> list[dict[str, str]]:
    with (folder / "run.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file, strict=True))


def made_up_run(folder: Path, steps: int, **changes: Any) -> list[dict[str, str]]:
    output = CsvOutput(folder)
    output.begin(csv_run.model(), None)
    for step in range(1, steps + 1):
        output.record(None, csv_run.report(step, **changes))
    output.end("completed")
    return rows_of(folder)


def test_numbers_are_in_columns_with_their_units(tmp_path: Path) -> None:
    """One of each kind of figure; test_figures.py has all of a real run."""
    row = made_up_run(tmp_path / "new" / "folder", steps=3)[-1]
    expected = {
        "time [s]": 0.03,
        "restarts": 0.0,
        "pressure right.tip [kPa]": 9.0,
        "pull right.tendon [mm]": -1.5,
        "tip_position left y [mm]": 6.0,
        "bending_angle left [degrees]": 15.0,
        "base_rotation z [degrees]": 3.0,
        "base_torque_in_base x [mN mm]": 15.0,
        "external_force cube z [mN]": 21.0,
        "position ball z [mm]": 4.0,
        "lift ball [mm]": 6.0,  # along x, against gravity, over where the scene has it, also in a run that is resumed
        "normal_force right|cube [mN]": 0.0,  # far apart, so not in the report
        "normal_force cube|floor [mN]": 9.81,
        "contact_area_error left|cube [mm^2]": 2.0,
        "signal error": -3.0,
    }
    assert {name: float(row[name]) for name in expected} == pytest.approx(expected, rel=1e-8)
    assert row["clipped"] == ""


def test_columns_are_pairs_that_can_touch_an_object(tmp_path: Path) -> None:
    row = made_up_run(tmp_path, steps=1)[0]
    pairs = ["left|cube", "left|ball", "right|cube", "right|ball", "cube|ball", "cube|floor", "ball|floor"]
    for quantity in ("normal_force", "friction_force", "slip_speed"):
        assert [name.split()[1] for name in row if name.startswith(quantity)] == pairs
    assert list(row)[:5] == [
        "time [s]",
        "restarts",
        *(f"pressure {c} [kPa]" for c in ("left.air", "right.base", "right.tip")),
    ]
    assert list(row)[-3:] == ["signal set_point", "signal error", "clipped"]


def test_every_step_has_a_row(tmp_path: Path) -> None:
    rows = made_up_run(tmp_path, steps=BUFFERED_STEPS + 7)
    assert [float(row["time [s]"]) for row in rows] == pytest.approx([0.01 * (step + 1) for step in range(len(rows))])
    assert len(rows) == BUFFERED_STEPS + 7


def test_run_without_steps_leaves_names_of_columns(tmp_path: Path) -> None:
    assert made_up_run(tmp_path, steps=0) == []
    assert (tmp_path / "run.csv").read_text().startswith("time [s],restarts,pressure left.air [kPa],")


def test_clipped_requests_and_odd_names_have_columns(tmp_path: Path) -> None:
    (row,) = made_up_run(tmp_path, steps=1, clipped=("left.air", "base_translation"), signals={'a, "b"': 1.5})
    assert (row["clipped"], row['signal a, "b"']) == ("left.air|base_translation", "1.5")


def test_restart_continues_the_file(tmp_path: Path) -> None:
    output = CsvOutput(tmp_path)
    output.begin(csv_run.model(), None)
    output.record(None, csv_run.report(1))
    output.restart(None)
    output.record(None, csv_run.report(1))
    output.end("completed")
    assert [(row["time [s]"], row["restarts"], row["lift cube [mm]"]) for row in rows_of(tmp_path)] == [
        ("0.01", "0", "1"),
        ("0.01", "1", "1"),
    ]


def test_late_signal_has_no_column_and_warns_once(tmp_path: Path) -> None:
    output = CsvOutput(tmp_path)
    output.begin(csv_run.model(), None)
    output.record(None, csv_run.report(1, signals={"error": 1.0}))
    with pytest.warns(UserWarning, match=r"run\.csv: no column for the signal 'late'") as warned:
        for step in (2, 3):
            output.record(None, csv_run.report(step, signals={"late": 2.0}))
    output.end("completed")
    assert len(warned) == 1
    assert [row["signal error"] for row in rows_of(tmp_path)] == ["1", "", ""]


def test_killed_process_leaves_its_rows(tmp_path: Path) -> None:
    """Killed after 100 steps: their rows are in the file, none of them damaged."""
    process = subprocess.Popen(
        [sys.executable, csv_run.__file__, str(tmp_path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == b"ready\n"
    finally:
        process.kill()
        process.communicate()
    rows = rows_of(tmp_path)
    assert [float(row["lift cube [mm]"]) for row in rows] == [step + 1.0 for step in range(2 * BUFFERED_STEPS)]
    assert all(row["clipped"] == "" for row in rows)  # the last column is there


def test_unwritable_folder_is_named(tmp_path: Path) -> None:
    (tmp_path / "run.csv").mkdir()
    with pytest.raises(TaichisoftError, match=r"run\.csv: cannot be written: Is a directory$"):
        made_up_run(tmp_path, steps=1)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
def test_full_disk_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "run.csv").symlink_to("/dev/full")
    with pytest.raises(TaichisoftError, match=r"run\.csv: cannot be written: No space left on device$"):
        made_up_run(tmp_path, steps=1)


def test_pandas_and_numpy_read_it(tmp_path: Path) -> None:
    made_up_run(tmp_path, steps=4)
    pandas = pytest.importorskip("pandas")
    table = pandas.read_csv(tmp_path / "run.csv")
    assert table["lift cube [mm]"].tolist() == [1.0, 2.0, 3.0, 4.0]
    assert (table.drop(columns="clipped").dtypes.map(lambda kind: kind.kind).isin(["i", "f"])).all()


def test_csv_is_an_output() -> None:
    assert find("output", "csv") is CsvOutput


def test_carried_bodies_are_no_objects() -> None:
    """A palm has pairs with what it can touch, a link that is only drawn has none; the run is about the cube."""
    cube = {"box": [1.0, 1.0, 1.0], "follows": "base"}
    bodies = {"link": {**cube, "collides": False}, "palm": cube, "cube": {"box": [1.0, 1.0, 1.0], "mass": 1.0}}
    scene = Scene.model_validate({"rigid_bodies": bodies})
    assert (scene.objects, scene.main_object) == (["cube"], "cube")
    carried = [SimpleNamespace(name=name, collides=name != "link", follows="base") for name in ("link", "palm")]
    cubes = [SimpleNamespace(name="cube", collides=True, follows=None)]
    around = {"soft_bodies": [SimpleNamespace(name="finger")], "obstacles": [SimpleNamespace(name="floor")]}
    pairs = PAIRS.names(SimpleNamespace(rigid_bodies=[*carried, *cubes], **around))  # type: ignore[arg-type]
    assert pairs == [("finger", "palm"), ("finger", "cube"), ("palm", "cube"), ("cube", "floor")]
