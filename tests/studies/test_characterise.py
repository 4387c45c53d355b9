"""`taichisoft characterise`: curves of a finger at rest, and the files that show them."""

import csv
import re

import numpy as np
import pytest

import taichisoft
from taichisoft_studies.characteristics import (
    Characteristics,
    equilibrium_count,
    find_characteristics,
    trust_line,
    write_datasheet,
)
from taichisoft_studies.errors import StudyError
from taichisoft_studies.finger_commands import characterise as command

PRESSURES = [0.0, 12.0, 24.0]


@pytest.fixture(scope="module")
def found():
    """A finger without gravity, and how many equilibria it took."""
    scene = taichisoft.load_scene("finger-inflated", ["gravity=[0.0, 0.0, 0.0]"])
    counted = []
    return find_characteristics(scene, None, PRESSURES, 2, counted.append), len(counted), scene


def test_finger_bends_and_presses(found):
    """A block where the finger rests freely bears nothing; held further back, the tip presses harder."""
    curves, count, _ = found
    assert count == equilibrium_count(3, 2) == 3 + 2 + 1
    assert curves.blocked.tolist() == [0, 1]
    assert curves.bending[0] == pytest.approx(0.0, abs=1e-6)
    assert (np.diff(curves.bending) > 5.0).all() and (np.diff(curves.volumes) > 0.0).all()
    assert curves.forces[0, 0] == curves.forces[1, 1] == 0.0
    assert np.isnan(curves.forces[1, 0])
    assert 0.0 < curves.forces[1, 2] < curves.forces[0, 2]
    # At small angles a finger is a spring that pressure moves: the force goes with the way that the block takes.
    held_back = curves.travel[2] - curves.travel[curves.blocked]
    assert curves.forces[0, 2] / held_back[0] == pytest.approx(curves.forces[1, 2] / held_back[1], rel=0.25)
    assert curves.stiffness[2] == pytest.approx(curves.forces[1, 2] / held_back[1])
    assert np.isnan(curves.stiffness[0])


def test_syringe_obeys_boyles_law(found):
    """p V of the air in chamber and syringe, absolute, is the same before and after."""
    curves, _, _ = found
    before = 101.325 * (curves.volumes[0] + curves.air)
    np.testing.assert_allclose((101.325 + curves.pressures) * curves.volumes, before)
    assert curves.air[0] == 0.0 and curves.air[2] > curves.volumes[2] - curves.volumes[0]


def test_interrupted_search_goes_on(found, tmp_path, monkeypatch):
    """Killed after four of six equilibria, and one file damaged: the curves have the same bits."""
    curves, count, scene = found
    ended = []

    def killed(line):
        ended.append(line)
        if len(ended) == 4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        find_characteristics(scene, None, PRESSURES, 2, killed, tmp_path)
    kept = sorted(tmp_path.glob("*.npz"), key=lambda path: path.stat().st_mtime_ns)
    assert len(kept) == 4
    kept[1].write_bytes(kept[1].read_bytes()[:100])
    searched, equilibrium = [], taichisoft.equilibrium
    monkeypatch.setattr(taichisoft, "equilibrium", lambda *given: searched.append(given) or equilibrium(*given))
    again = find_characteristics(scene, None, PRESSURES, 2, folder=tmp_path)
    assert len(searched) == count - 3
    np.testing.assert_array_equal(again.forces, curves.forces)
    np.testing.assert_array_equal(again.bending, curves.bending)
    find_characteristics(scene, None, [*PRESSURES[:2], 25.0], 1, folder=tmp_path)
    assert len(searched) == count - 3 + 2  # another last pressure alone, free and held


def test_free_bend_is_the_equilibrium(found):
    curves, _, scene = found
    rest = taichisoft.equilibrium(taichisoft.Simulation(scene), taichisoft.Control(pressure={"finger.cavity": 24.0}))
    assert curves.bending[2] == pytest.approx(np.degrees(rest.observation.bending_angles["finger"]), abs=1e-3)


def test_datasheet_has_table_picture_and_page(found, tmp_path):
    curves, _, scene = found
    finer = Characteristics(
        curves.pressures,
        1.1 * curves.bending,
        curves.travel,
        curves.volumes,
        curves.blocked,
        0.8 * curves.forces,
        curves.atmosphere,
    )
    table, picture, page = write_datasheet(tmp_path / "new", scene, curves, finer, "a finer mesh")
    with table.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["pressure [kPa]"]) for row in rows] == PRESSURES
    assert float(rows[2]["force held at 12 kPa [mN]"]) == pytest.approx(curves.forces[1, 2], rel=1e-4)
    assert rows[0]["bending [degrees]"] == "0" and rows[0]["force held at 12 kPa [mN]"] == ""
    said = trust_line(curves, finer, "a finer mesh")
    assert said == "With a finer mesh, bending differs by up to 9.1 % of its largest value, and forces by up to 25.0 %."
    text = page.read_text(encoding="utf-8")
    assert "held at 0 degrees, 0 kPa" in text
    assert said in text and "growth of the chambers" in text and "air from a syringe at 101.3 kPa" in text
    assert text.count("<svg") == 2, "on a phone one column of plots is below the other"
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert "nothing is known of the error" in trust_line(curves, None, "")


def test_datasheet_shows_no_round_off(found, tmp_path):
    """A finger that hardly bends and does not press: zeros, and differences of 0 %."""
    curves, _, scene = found
    small = 4.1e-14 * np.ones(3)
    still = Characteristics(
        curves.pressures, small, curves.travel, 8e3 + small, curves.blocked, 0.0 * curves.forces, curves.atmosphere
    )
    _, _, page = write_datasheet(tmp_path, scene, still, still, "a finer mesh")
    shown = re.sub(
        r"<svg.*?</svg>|<style.*?</style>|<pre>.*?</pre>", "", page.read_text(encoding="utf-8"), flags=re.DOTALL
    )
    assert not re.search(r"\de-\d|nan", shown), shown
    assert "<b>0 degrees</b>" in shown and "<b>0 mN</b>" in shown and "by up to 0.0 %." in shown


def test_impossible_characteristics_are_refused(tmp_path):
    with pytest.raises(StudyError, match=r"--body cube: no soft body .* there are: finger"):
        find_characteristics(taichisoft.load_scene("finger-inflated"), "cube", PRESSURES, 1)
    with pytest.raises(StudyError, match=r"no soft body with a cavity is called so; there are: $"):
        find_characteristics(taichisoft.load_scene("cable-gripper"), None, PRESSURES, 1)
    for pressure in (0.0, np.nan):
        with pytest.raises(StudyError, match="must be a number of kPa other than 0"):
            command("finger-inflated", pressure)
    with pytest.raises(StudyError, match=r"--pressure -200: must be at least the vacuum's -101.325 kPa"):
        command("finger-inflated", -200.0)
    with pytest.raises(StudyError, match=r"4 kPa: the scene's limits hold 'finger.cavity' at 3 kPa"):
        find_characteristics(
            taichisoft.load_scene("finger-inflated", ["limits.highest_pressure=3"]), None, [0.0, 4.0], 1
        )
