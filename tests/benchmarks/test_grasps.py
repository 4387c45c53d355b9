"""The study of grasps: its objects, its table, and cases that fail."""

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from taichisoft import make_model
from taichisoft.scene import scene_from_dict
from taichisoft_benchmarks.errors import BenchmarkError
from taichisoft_benchmarks.studies import grasp_measure, grasps, settling
from taichisoft_benchmarks.studies.grasp_measure import MeasuredGrasp
from taichisoft_benchmarks.studies.grasped_objects import AXIS, BOTTOM, OBJECTS
from taichisoft_benchmarks.studies.grasps import all_grasps

FIGURES = {
    "lift": 99.0, "creep": 0.004, "margin": 5.4, "steps": 650, "unconverged": 3,
    "sweeps_median": 11.0, "sweeps_most": 115, "penetration": 1e-5,
}  # fmt: skip


@pytest.mark.parametrize("name", sorted(OBJECTS))
def test_an_object_has_its_mass_and_stands_in_the_middle_of_the_gripper(name: str, tmp_path: Path) -> None:
    """Its lowest point is one contact distance above the floor; a cube may be put aside."""
    tables = OBJECTS[name](0.03, False, tmp_path)
    model = make_model(scene_from_dict({**tables, "gravity": [-9810, 0, 0]}))
    vertices = np.vstack([model.surfaces.carriers.local])
    if model.rigid_bodies:
        vertices = np.vstack([_placed(body) for body in model.rigid_bodies])
        centre = np.average([body.start_position for body in model.rigid_bodies], axis=0)
        aside = 10.0 if "off centre" in name else 0.0
        assert model.rigid_mass.sum() == pytest.approx(0.03)
        assert centre[1:] == pytest.approx([AXIS[0], AXIS[1] + aside], abs=4.0 if name == "mug" else 1e-6)
    assert vertices[:, 0].min() == pytest.approx(BOTTOM, abs=1e-6)


def _placed(body: object) -> np.ndarray:
    turn = trimesh.transformations.quaternion_matrix(body.start_rotation)[:3, :3]  # type: ignore[attr-defined]
    return body.vertices @ turn.T + body.start_position  # type: ignore[attr-defined,no-any-return]


def test_every_grasp_has_a_file_of_its_own() -> None:
    names = [grasp.name for element in ("linear", "smoothed", "quadratic") for grasp in all_grasps(element)]
    assert len(set(names)) == len(names)
    assert "cylinder-lying-exact-30g-80kPa-0.6" in names


@pytest.mark.parametrize(
    ("changed", "held"),
    [({}, "yes"), ({"lift": 0.0}, "no"), ({"creep": 0.02}, "no"), ({"lift": 120.0}, "no")],
    ids=["held", "left behind", "creeps", "squeezed out"],
)
def test_what_rises_with_the_base_and_stays_is_held(changed: dict[str, float], held: str) -> None:
    shown = grasps.grasp_row(MeasuredGrasp("cube"), {**FIGURES, **changed}).split(" | ")
    assert shown[5] == held
    assert shown[8:10] == ["3 of 650", "11, 115"]


def test_a_grasp_that_hangs_is_a_row(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its process is ended after the time limit, and the table says so in a row as wide as the others."""
    monkeypatch.setattr(grasp_measure, "TIME_LIMIT", 0.01)
    grasps.measure_all([MeasuredGrasp("cube")], tmp_path)
    (figures,) = grasps.read_all(all_grasps(), tmp_path).values()
    assert figures == {"problem": "no answer within 0.01 s"}
    lines = grasps.table({MeasuredGrasp("cube"): figures, MeasuredGrasp("ball"): FIGURES}).splitlines()
    assert len({line.count("|") for line in lines}) == 1


def test_the_page_is_filled_with_what_was_kept(tmp_path: Path) -> None:
    """`--only none` measures nothing."""
    (tmp_path / f"{MeasuredGrasp('torus').name}.json").write_text(json.dumps(FIGURES))
    page = tmp_path / "page.md"
    page.write_text("before\n<!-- grasps -->\nold\n<!-- end -->\nafter\n")
    grasps.main(page, only="none", results=tmp_path)
    text = page.read_text()
    assert "| torus | 30 | 80 | 0.6 |" in text and "old" not in text
    assert text.startswith("before\n") and text.endswith("<!-- end -->\nafter\n")


def test_other_elements_have_a_table_of_their_own(tmp_path: Path) -> None:
    """The fingers and the soft cube are of the element, under lower pressures; the other table stays as it is."""
    (grasp,) = (one for one in all_grasps("smoothed") if one.object == "soft cube")
    scene = grasp_measure.scene_of(grasp, tmp_path)
    assert {body.element for body in scene.soft_bodies.values()} == {"smoothed"}
    assert grasp.pressure == pytest.approx(36.0)
    (tmp_path / f"{grasp.name}.json").write_text(json.dumps(FIGURES))
    page = tmp_path / "page.md"
    page.write_text("<!-- grasps -->\nold\n<!-- end -->\n<!-- grasps smoothed -->\nolder\n<!-- end -->\n")
    grasps.main(page, only="none", results=tmp_path, element="smoothed")
    text = page.read_text()
    assert text.startswith("<!-- grasps -->\nold\n<!-- end -->\n<!-- grasps smoothed -->\n| object")
    assert "| soft cube | 30 | 36 | 0.6 |" in text and "older" not in text


def test_a_page_without_the_mark_is_refused(tmp_path: Path) -> None:
    (tmp_path / "page.md").write_text("nothing\n")
    with pytest.raises(BenchmarkError, match="has no line <!-- grasps -->"):
        grasps.main(tmp_path / "page.md", results=tmp_path)


def test_the_base_rises_by_its_lift_no_faster_than_it_may() -> None:
    times = np.linspace(-0.1, 0.5, 601)
    rise = np.array([grasp_measure._rise(time) for time in times])
    assert (rise[times <= 0.0] == 0.0).all()
    assert rise[-1] == pytest.approx(grasp_measure.LIFT)
    assert np.diff(rise).max() / 1e-3 == pytest.approx(grasp_measure.SPEED, rel=1e-6)


@pytest.mark.parametrize(
    ("before", "last", "shown"), [(np.e * 0.02, 0.02, "1.00"), (0.1, 0.2, "none"), (1e-3, 1e-9, "at rest")]
)
def test_what_settles_has_a_time_constant(before: float, last: float, shown: str) -> None:
    """Creep that falls by a factor of e in a second has one of a second; what grows has none."""
    hold = settling.Hold(MeasuredGrasp("cube"))
    row = settling.hold_row(hold, [1.0, 0.5, 0.2, 0.1, 0.1, before, last], 0.0).split(" | ")
    assert len(row) == len(settling.HEADINGS)
    assert row[-2] == shown
