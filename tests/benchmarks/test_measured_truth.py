"""The page of measurements: what it makes of data whose errors are known, and of data that are not there."""

import csv
import math
import tomllib
from pathlib import Path

import numpy as np
import pytest
from blocks import make_block
from conftest import SHARED

from taichisoft import load_scene
from taichisoft.mesh import write_volume_mesh
from taichisoft_benchmarks.errors import BenchmarkError
from taichisoft_benchmarks.measured_truth import (
    BEAM_BODY,
    LOADS,
    Swing,
    beam_frequency,
    case_lines,
    limit_of_meshes,
    main,
    measured_swing,
    measured_swings,
    pulled_stretch,
    rayleigh_damping,
    simulated_swing,
    tension_section,
)
from taichisoft_studies.errors import StudyError
from taichisoft_studies.finger_commands import measured_case
from taichisoft_studies.least_squares import Calibration, Experiment, read_measurement
from taichisoft_studies.study_file import check_study, read_tables

SCENE = """
gravity = [0.0, 0.0, -9810.0]
time = { step = 0.01, duration = 0.2 }
controller = { name = "scripted", settings = { script = "rest" } }
[soft_bodies.block]
mesh = "block.msh"
element = "linear"
density = 1e-6
young_modulus = 100.0
poisson_ratio = 0.3
tip = { box = [[-100.0, -100.0, -100.0], [100.0, 100.0, 100.0]] }
"""
CASE = """
scene = "scene.toml"
[parameters]
"soft_bodies.block.young_modulus" = { start = 100.0, low = 50.0, high = 200.0 }
[[experiments]]
data = "fall.csv"
curves = [{ column = "z_mm", quantity = "tip_positions['block'][2]", scale = 0.5 }]
[[experiments]]
data = "absent.csv"
curves = [{ column = "z_mm", quantity = "tip_positions['block'][2]", scale = 0.5 }]
"""


def test_case_shows_its_deviation_and_errors(tmp_path: Path) -> None:
    """A block falls by g t^2 / 2, by implicit Euler g t h / 2 farther: it is off by what half the step tells."""
    write_volume_mesh(make_block((1, 1, 1), (10.0, 10.0, 10.0)), tmp_path / "block.msh")
    (tmp_path / "scene.toml").write_text(SCENE)
    (tmp_path / "case.toml").write_text(CASE)
    times = np.arange(0.02, 0.2, 0.02)
    with (tmp_path / "fall.csv").open("w", newline="") as file:
        csv.writer(file).writerows([["time", "z_mm"], *([t, -9810.0 * t**2 / 2] for t in times)])
    lines = list(case_lines(tmp_path))
    (text,) = [line for line in lines if line.startswith("| z_mm")]
    column, rows, off, scale, by_step, by_mesh = text.strip("| ").split(" | ")
    expected = 9810.0 * 0.01 / 2 * float(np.sqrt((times**2).mean()))
    assert (column, rows, scale, by_mesh) == ("z_mm", "9", "0.5", "not known")
    assert float(off) == float(by_step) == pytest.approx(expected, rel=5e-3), "three digits are shown"
    assert any("left out" in line and "absent.csv" in line for line in lines)
    assert "block.msh" in lines[-1], "why the error by the mesh is not known"
    with pytest.raises(BenchmarkError, match=r"has no case\.toml"):
        list(case_lines(tmp_path / "nowhere"))


def test_new_case_is_valid_scene_and_study(tmp_path: Path) -> None:
    folder = tmp_path / "case"
    measured_case(folder)
    scene = load_scene(folder / "scene.toml")
    study = check_study(Calibration, read_tables(folder / "case.toml"), "case.toml")
    start = study.parameters["soft_bodies.finger.coefficients.c10"].start
    assert scene.soft_bodies["finger"].coefficients["c10"] == start, "without a fit the scene is what it says"
    (experiment,) = study.experiments
    header = (folder / "positions.csv").read_text().strip().split(",")
    assert {experiment.over_column, *(one.column for one in experiment.curves)} <= set(header)
    with pytest.raises(StudyError, match="no numbers follow the names of the columns"):
        read_measurement(experiment, folder / "positions.csv", "experiments.0")
    geometry = tomllib.loads((folder / "geometry.toml").read_text())
    tip = scene.soft_bodies["finger"].tip
    assert tip is not None and tip.box is not None and tip.box[0][0] < -geometry["body"]["length"] < tip.box[1][0]
    with pytest.raises(StudyError, match="exists already"):
        measured_case(folder)


def test_error_of_pressure_widens_tolerance_of_curve(tmp_path: Path) -> None:
    """y = 3 p: an error of 0.4 kPa is one of 1.2 mm, in quadrature with the 0.5 mm of the position: 1.3 mm."""
    file = tmp_path / "line.csv"
    file.write_text("p,y\n" + "".join(f"{p},{3 * p}\n" for p in range(5)))
    curve = {"column": "y", "quantity": "time", "scale": 0.5}
    measured = read_measurement(
        Experiment(over_column="p", over_error=0.4, curves=(curve,)),  # type: ignore[arg-type]
        file,
        "experiments.0",
    )
    assert measured.scales[0] == pytest.approx(math.hypot(0.5, 1.2), rel=1e-12)


def test_limit_of_meshes_follows_power() -> None:
    """5 - 2 h^1.7 on meshes of sizes 1, 1/2, 1/4: the limit is 5, and the finest lacks 2 / 4^1.7, to round-off."""
    limit, error = limit_of_meshes([5.0 - 2.0 * h**1.7 for h in (1.0, 0.5, 0.25)])
    assert (limit, error) == (pytest.approx(5.0, abs=1e-12), pytest.approx(-2.0 * 0.25**1.7, abs=1e-12))


def test_loaded_beam_swings_as_mass_on_spring() -> None:
    """f = sqrt(k / (m + 33/140 m_beam)) / 2 pi (Rayleigh), k from Euler and Bernoulli, of a beam that hardly sags.

    Within 6 %: Timoshenko's shear takes 3 % of the stiffness and the mesh of seven cells gives 8 % too much.
    """
    stiff = {"law": "neo-hookean", **BEAM_BODY, "young_modulus": 1e5, "poisson_ratio": 0.0}
    beam, modulus = BEAM_BODY["density"] * 100 * 30 * 30, 1e5
    spring = 3 * modulus * 30**4 / 12 / 100**3
    expected = np.sqrt(spring / (LOADS["load101"].mass + 33 / 140 * beam)) / (2 * np.pi)
    assert beam_frequency("load101", (13, 4, 4), stiff) == pytest.approx(expected, rel=0.06)


def test_block_stretches_as_its_law() -> None:
    """Yeoh's stress at a stretch of 2 gives the stretch 2, but for a Poisson's ratio of 0.499, below 0.2 %."""
    c10, c20 = 25.034, 1.8107
    stress = 2 * (2 - 1 / 4) * (c10 + 2 * c20 * (4 + 1 - 3))
    assert pulled_stretch("dragon-skin-10", stress) == pytest.approx(2.0, rel=2e-3)


def test_absent_data_are_left_out_with_note(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("".join(f"<!-- {name} -->\n<!-- end -->\n" for name in ("beam", "ring-down", "tension", "cases")))
    main(tmp_path, None, page)
    assert page.read_text().count("Left out: `beam/`") == 2
    assert "Left out: `materials/`" in page.read_text() and "No case was given" in page.read_text()
    assert list(tension_section(tmp_path))[-1].startswith("\nLeft out: BodyDouble SILK.csv, ")


@pytest.mark.skipif(not (SHARED / "measured").is_dir(), reason="needs the measured data")
def test_page_shows_large_errors() -> None:
    """The law of Dragon Skin 10 gives six times the stress at which its specimen failed; RTV615's was fitted so far."""
    lines = {line.split("`")[1]: line for line in tension_section(SHARED / "measured" / "materials") if "| `" in line}
    assert len(lines) == 19
    assert lines["dragon-skin-10"].endswith("| **6.01** |") and lines["rtv615"].endswith("| 1.01 |")


MEASURED = SHARED / "measured" / "beam"


def oscillation(frequency: float, decay: float) -> Swing:
    time = np.arange(0.0, 2.0, 0.01)
    swinging = 5.0 + 3.0 * np.exp(-decay * time) * np.cos(2 * np.pi * frequency * time)
    return Swing.of(time, swinging, 5.0)


def test_oscillation_gives_frequency_and_decay() -> None:
    """Of one that is exactly so, to 1e-6."""
    simulated = oscillation(4.3, 1.7)
    assert (simulated.frequency, simulated.decay) == (pytest.approx(4.3, rel=1e-6), pytest.approx(1.7, rel=1e-6))


def test_rayleigh_factors_fit_decays() -> None:
    """g = a / 2 + b (2 pi f)^2 / 2 at three frequencies."""
    swings = {
        load: [oscillation(f, 1.0 + 0.0006 * (2 * np.pi * f) ** 2)] for load, f in zip(LOADS, (7, 4, 3), strict=True)
    }
    assert rayleigh_damping(swings) == (pytest.approx(2.0, rel=1e-4), pytest.approx(0.0012, rel=1e-4))


def test_file_without_table_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "take.csv"
    path.write_text("a,b\n1,2\n")
    with pytest.raises(BenchmarkError, match=r"take\.csv: cannot be read as a table of markers"):
        measured_swing(path)


@pytest.mark.skipif(not MEASURED.is_dir(), reason="needs the recorded takes of the beam")
def test_beam_rings_down_as_measured() -> None:
    """Frequency and rest within 5 %, decay within 15 % of the mean of two takes; the tip's way within 15 %.

    The way's is the root mean square over half a second, over the first peak: the phase drifts by 2 % of four periods,
    and the takes begin 4 % apart.
    """
    swings = measured_swings(MEASURED)
    takes = swings["gravity"]
    peak = float(np.mean([take.displacement[0] / take.rest for take in takes]))
    simulated = simulated_swing(peak, rayleigh_damping(swings), 0.5, step=1e-3)
    assert simulated.frequency == pytest.approx(np.mean([take.frequency for take in takes]), rel=0.05)
    assert simulated.frequency == pytest.approx(7.7, rel=0.05)
    assert simulated.rest == pytest.approx(np.mean([take.rest for take in takes]), rel=0.05)
    assert simulated.decay == pytest.approx(np.mean([take.decay for take in takes]), rel=0.15)
    for take in takes:
        early = take.time <= 0.5
        apart = np.interp(take.time[early], simulated.time, simulated.displacement) - take.displacement[early]
        assert np.sqrt((apart**2).mean()) < 0.15 * (take.displacement[0] - take.rest)
