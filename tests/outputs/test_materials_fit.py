"""Fits of laws to tension tests: known coefficients come back, and what is drawn and listed is what ships."""

import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from taichisoft.scene import initial_shear_modulus, read_material
from taichisoft_outputs.material_files import MaterialError, shipped_materials
from taichisoft_outputs.materials_command import materials
from taichisoft_outputs.tension_test import (
    TensionTest,
    fit_law,
    nominal_stress,
    read_specimens,
    read_tension_test,
    shear_stress,
)

STRETCH = np.linspace(1.02, 3.0, 120)
RUBBERS = [
    ("neo-hookean", {"mu": 60.0}),
    ("mooney-rivlin", {"c10": 20.0, "c01": 8.0}),
    ("yeoh", {"c10": 40.0, "c20": -2.0, "c30": 0.4}),
    ("ogden", {"mu1": 30.0, "alpha1": 2.4}),
    ("ogden", {"mu1": -5.0, "alpha1": -3.0, "mu2": 20.0, "alpha2": 3.5}),
    ("ogden", {"mu1": -8.0, "alpha1": -4.0, "mu2": 30.0, "alpha2": 1.5, "mu3": 0.5, "alpha3": 6.0}),
]


def written(folder: Path, text: str) -> Path:
    path = folder / "test.csv"
    path.write_text(text)
    return path


@pytest.mark.parametrize(("law", "coefficients"), RUBBERS, ids=lambda value: value if isinstance(value, str) else None)
def test_the_coefficients_of_a_made_up_rubber_come_back(law: str, coefficients: dict[str, float]) -> None:
    """The stress of a law at 120 stretches up to 3, fitted by the same law: within 0.1 %."""
    test = TensionTest("made", STRETCH, nominal_stress(law, coefficients, STRETCH))
    found = fit_law(test, law, len(coefficients) // 2)  # type: ignore[arg-type]
    assert found.coefficients == pytest.approx(coefficients, rel=1e-3)
    assert found.error < 1e-6


@pytest.mark.parametrize(("law", "coefficients"), RUBBERS, ids=lambda value: value if isinstance(value, str) else None)
def test_the_slope_at_rest_is_youngs_modulus(law: str, coefficients: dict[str, float]) -> None:
    """Incompressible: dP/dl = 3 mu at l = 1. Central difference over 1e-4: tolerance 1e-6."""
    low, high = nominal_stress(law, coefficients, np.array([1.0 - 1e-4, 1.0 + 1e-4]))
    shear_modulus = initial_shear_modulus(law, coefficients)  # type: ignore[arg-type]
    assert (high - low) / 2e-4 == pytest.approx(3.0 * shear_modulus, rel=1e-6)


@pytest.mark.parametrize(("law", "coefficients"), RUBBERS, ids=lambda value: value if isinstance(value, str) else None)
def test_the_stress_is_the_derivative_of_the_energy(law: str, coefficients: dict[str, float]) -> None:
    """W(l, l^-1/2, l^-1/2), differenced over 1e-5: tolerance 1e-7."""

    def energy(stretch: np.ndarray) -> np.ndarray:
        first, second = stretch**2 + 2.0 / stretch - 3.0, 2.0 * stretch + stretch**-2 - 3.0
        if law == "ogden":
            terms = range(1, len(coefficients) // 2 + 1)
            pairs = [(coefficients[f"mu{p}"], coefficients[f"alpha{p}"]) for p in terms]
            return sum(mu / a * (stretch**a + 2.0 * stretch ** (-a / 2.0) - 3.0) for mu, a in pairs)
        if law == "neo-hookean":
            return 0.5 * coefficients["mu"] * first
        powers = coefficients["c10"] * first + coefficients.get("c20", 0.0) * first**2
        return powers + coefficients.get("c30", 0.0) * first**3 + coefficients.get("c01", 0.0) * second

    difference = (energy(STRETCH + 1e-5) - energy(STRETCH - 1e-5)) / 2e-5
    np.testing.assert_allclose(nominal_stress(law, coefficients, STRETCH), difference, rtol=1e-7)


@pytest.mark.parametrize(("law", "coefficients"), RUBBERS, ids=lambda value: value if isinstance(value, str) else None)
def test_shear_stress_is_twice_the_modulus_rule(law: str, coefficients: dict[str, float]) -> None:
    """Simple shear has I1 = I2 = 3 + g^2, so (Rivlin) its stress is 2 (W1 + W2) g; of Ogden's law mu g at small g."""
    shear = np.linspace(0.01, 1.5, 30)
    stress = shear_stress(law, coefficients, shear)  # type: ignore[arg-type]
    if law == "ogden":
        assert stress[0] / shear[0] == pytest.approx(initial_shear_modulus(law, coefficients), rel=2e-3)
        return
    first = coefficients.get("c10", coefficients.get("mu", 0.0) / 2.0) + coefficients.get("c01", 0.0)
    first += 2.0 * coefficients.get("c20", 0.0) * shear**2 + 3.0 * coefficients.get("c30", 0.0) * shear**4
    np.testing.assert_allclose(stress, 2.0 * first * shear, rtol=1e-9)


def test_intervals_hold_the_truth_in_19_of_20_draws() -> None:
    """Independent errors of 1 kPa, 400 draws: the share is 95 % with a standard error of 1.1 %."""
    random, held = np.random.default_rng(4), 0
    for _ in range(400):
        stress = nominal_stress("mooney-rivlin", {"c10": 20.0, "c01": 8.0}, STRETCH)
        found = fit_law(TensionTest("", STRETCH, stress + random.standard_normal(len(STRETCH))), "mooney-rivlin")
        low, high = found.intervals["c10"]
        held += low < 20.0 < high
    assert 0.91 < held / 400 < 0.99


def test_force_of_several_specimens_is_read_by_columns(tmp_path: Path) -> None:
    """Two specimens side by side, the second shorter; a force of 2 N on 10 mm^2 is 200 kPa, 30 mm on 60 mm are 50 %."""
    text = "Weg (mm);Kraft (N);Weg (mm);Kraft (N)\n30,0;2,0;30,0;3,0\n60,0;4,0;;\n"
    first, second = read_specimens(written(tmp_path, text), {}, area=10.0, length=60.0)
    np.testing.assert_allclose(np.column_stack([first.stretch, first.stress]), [[1.5, 200.0], [2.0, 400.0]])
    np.testing.assert_allclose(np.column_stack([second.stretch, second.stress]), [[1.5, 300.0]])
    named = {"extension": "1 (mm)", "force": "Kraft B (kN)"}
    (named_one,) = read_specimens(written(tmp_path, "A,Kraft B\n30,0.002\n"), named, area=10.0, length=60.0)
    assert (named_one.stretch[0], named_one.stress[0]) == pytest.approx((1.5, 200.0))


@pytest.mark.parametrize(
    ("columns", "sizes", "expected"),
    [
        ({"strian": "1"}, {}, "columns strian: must be one of stretch, strain"),
        ({"strain": "3 (%)"}, {}, "columns strain=3 (%): "),
        ({"strain": ""}, {}, "columns strain=: "),
        ({"strain": "1 (mm)", "stress": "2 (kPa)"}, {}, "'A (mm)' needs a unit: %"),
        ({"strain": "1 (%)", "force": "2 (N)"}, {}, "columns force: needs area"),
        ({"strain": "1 (%)", "force": "2 (N)"}, {"area": 0.0}, "area 0: must be above 0"),
        (
            {"extension": "1 (mm)", "force": "2 (N)"},
            {"area": 1.0, "length": float("nan")},
            "length nan: must be above 0",
        ),
    ],
)
def test_wrong_columns_are_refused_in_one_line(
    tmp_path: Path, columns: dict[str, str], sizes: dict[str, float], expected: str
) -> None:
    with pytest.raises(MaterialError) as error:
        read_specimens(written(tmp_path, "A,B\n1,2\n"), columns, **sizes)
    assert expected in str(error.value) and "\n" not in str(error.value)


def test_hookes_law_is_fitted_to_small_strains_alone() -> None:
    """E of a straight line up to a strain of 0.2, whatever comes beyond."""
    strain = STRETCH - 1.0
    stress = np.where(strain <= 0.2, 90.0 * strain, 1e4)
    assert fit_law(TensionTest("made", STRETCH, stress), "hooke").coefficients == pytest.approx({"young_modulus": 90.0})


def test_a_fit_gives_way_nowhere() -> None:
    """Yeoh's best last coefficient here is negative: it is left out, and the stress rises at every stretch."""
    stress = nominal_stress("ogden", {"mu1": 30.0, "alpha1": 3.0}, STRETCH)
    found = fit_law(TensionTest("made", STRETCH, stress), "yeoh")
    assert "c30" not in found.coefficients
    assert (np.diff(nominal_stress("yeoh", found.coefficients, np.linspace(1.0, 9.0, 500))) > 0.0).all()
    falling = TensionTest("made", STRETCH, 10.0 * np.sin(2.0 * (STRETCH - 1.0)))
    with pytest.raises(MaterialError, match=r"made: the best fit of law 'yeoh' (gives way|has no stiffness)"):
        fit_law(falling, "yeoh")


def test_a_test_is_read_with_its_unit_and_its_header(tmp_path: Path) -> None:
    """Engineering columns win over true ones; lines above the names of the columns are ignored."""
    path = written(
        tmp_path,
        "Speed (mm/min);450;;\n;;;\nTime (s);True Strain;Engineering Strain;Engineering Stress (MPa)\n"
        "0.1;9;0.5;0.2\n0.2;9;1.0;0.4\n",
    )
    test = read_tension_test(path)
    np.testing.assert_allclose(test.stretch, [1.5, 2.0])
    np.testing.assert_allclose(test.stress, [200.0, 400.0])
    stretched = read_tension_test(written(tmp_path, "stretch,stress [kPa]\n1.5,20\n"))
    assert (stretched.stretch[0], stretched.stress[0]) == (1.5, 20.0)


@pytest.mark.parametrize(
    "text",
    [
        "strain (%),stress (kPa)\n50,200\n100,400\n",
        "Strain [%]\tStress [kPa]\n50\t200\n100\t400\n",
        "Strain %,Stress (kPa)\n50,200\n100,400\n",
        "Engineering strain (percent),Stress (kPa)\n50,200\n100,400\n",
        '"Strain (%)","Stress (MPa)"\n"50","0.2"\n"100","0.4"\n',
        '"Strain (engineering) (%)";"Stress, at rest (MPa)"\n50;0,2\n100;0,4\n',
        '"Stress (MPa)","Strain (mm/mm)"\n"0,2","0,5"\n"0,4","1,0"\n',
        "Strain rate (1/s);Strain (-);Stress (N/mm²)\n7;0,5;0,2\n7;1;0,4\n",
        "strain;stress (Pa)\n0,5;200.000,0\n1,0;400.000,0\n",
        "strain;stress (Pa)\n0.5;200,000\n1.0;400,000\n",
        "Dehnung (%);Spannung (MPa)\n50,0;0,2\n100,0;0,4\n",
        "Tensile strain,Tensile stress\n(mm/mm),(MPa)\n0.5,0.2\n1,0.4\n",
        "Probe 1\nDehnung;Spannung\n%;MPa\n50;0,2\n100;0,4\n",
        "Déformation [%];Contrainte [bar]\n50;2,0\n100;4,0\n",
        "Allongement (%);Contrainte (MPa)\n50,0;0,2\n100,0;0,4\n",
        "Zwick;2024,5\nSpeed (mm/min),450\nstretch,stress (kPa)\n+1.5,2e2\n2,4E+2\n",
    ],
)
def test_units_quotes_and_decimal_commas_are_understood(tmp_path: Path, text: str) -> None:
    """All are the same two points."""
    test = read_tension_test(written(tmp_path, text))
    np.testing.assert_allclose(test.stretch, [1.5, 2.0])
    np.testing.assert_allclose(test.stress, [200.0, 400.0])


STRAIN = np.linspace(0.0, 1.0, 60)


def fitted(folder: Path, strain: np.ndarray, stress: np.ndarray, *options: str) -> tuple[float, str]:
    """Young's modulus of a neo-Hookean fit [kPa], and what is printed beside it."""
    rows = "".join(f"{one:.6f},{value:.6f}\n" for one, value in zip(strain.tolist(), stress.tolist(), strict=True))
    path = written(folder, "strain,stress (kPa)\n" + rows)
    result = CliRunner().invoke(materials, ["fit", str(path), "--law", "neo-hookean", *options])
    assert result.exit_code == 0, result.output
    return float(result.output.split("modulus at rest ")[1].split(" kPa")[0]), " ".join(result.output.split())


def test_unloading_is_told_and_loading_fitted_on_request(tmp_path: Path) -> None:
    """Rubber of 100 kPa that is a third softer on its way back, in one cycle and in two: fits lie between."""
    load = nominal_stress("neo-hookean", {"mu": 100.0 / 3.0}, 1.0 + STRAIN)
    strain = np.concatenate([STRAIN, STRAIN[::-1]])
    stress = np.concatenate([load, 0.7 * load[::-1]])
    for cycles in (1, 2):
        both, said = fitted(tmp_path, np.tile(strain, cycles), np.tile(stress, cycles))
        assert both < 90.0 and "the strain falls back from 1, and" in said and "--loading" in said
        first, said = fitted(tmp_path, np.tile(strain, cycles), np.tile(stress, cycles), "--loading")
        assert first == pytest.approx(100.0, abs=0.1) and "warning" not in said
    assert fitted(tmp_path, STRAIN[::-1], load[::-1])[1].count("warning") == 0  # a table from its end


def test_stress_in_another_unit_is_told(tmp_path: Path) -> None:
    load = nominal_stress("neo-hookean", {"mu": 1e5 / 3.0}, 1.0 + STRAIN)
    assert "100000 Pa are 100 kPa" in fitted(tmp_path, STRAIN, load)[1]


@pytest.mark.parametrize(("slack", "told"), [(0.05, True), (-0.04, True), (0.0, False), (0.01, False)])
def test_slack_is_told_and_taken_off_on_request(tmp_path: Path, slack: float, told: bool) -> None:
    load = nominal_stress("neo-hookean", {"mu": 100.0 / 3.0}, 1.0 + STRAIN)
    modulus, said = fitted(tmp_path, STRAIN + slack, load)
    assert ("the stress begins at a strain of" in said) == told == (abs(modulus - 100.0) > 2.0)
    modulus, said = fitted(tmp_path, STRAIN + slack, load, "--slack", str(slack))
    assert modulus == pytest.approx(100.0, abs=0.1) and "warning" not in said


@pytest.mark.parametrize(("count", "warned"), [(10, True), (14, True), (15, False)])
def test_too_few_points_for_the_coefficients_are_warned_of(tmp_path: Path, count: int, warned: bool) -> None:
    """Yeoh's law has three."""
    stretch = np.linspace(1.1, 3.0, count)
    stress = nominal_stress("yeoh", {"c10": 40.0, "c20": 1.0, "c30": 0.1}, stretch)
    rows = "".join(f"{one},{value}\n" for one, value in zip(stretch.tolist(), stress.tolist(), strict=True))
    result = CliRunner().invoke(materials, ["fit", str(written(tmp_path, "stretch,stress (kPa)\n" + rows))])
    assert result.exit_code == 0
    assert ("warning: " in result.output) == warned
    assert (f"{count} points for 3 coefficients" in result.output) == warned


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("strain,stress (kPa)\n50,200\n300,400\n", "line 1: 'strain' reaches 300: is it in per cent?"),
        ("strain (mm),stress (kPa)\n5,2\n", "line 1: 'strain (mm)' needs a unit: %, percent, per cent, none, -, 1"),
        ("strain (true),stress (kPa)\n5,2\n", "line 1: 'strain (true)' needs a unit"),
        ("stretch (%),stress (kPa)\n150,2\n", "line 1: 'stretch (%)' needs a unit: none, -, 1, mm/mm, m/m"),
        ("strain rate,stress (kPa)\n1,2\n", "no line names a column 'strain'"),
        ("strain;stress (kPa)\n0.5;1,23\n", "line 2: '0.5;1,23' lacks a number"),
        ("strain;stress (kPa)\n0,5;1.23,4\n", "line 2: '0,5;1.23,4' lacks a number"),
        ("time,force\n1,2\n", "no line names a column 'strain' or 'stretch' and one 'stress (MPa)'"),
        (
            "Results\n\nTime,Extension,Load\n(s),(mm),(N)\n0,0.1,2\n",
            "has 'Time (s)', 'Extension (mm)', 'Load (N)': length and area of the specimen at rest divide the",
        ),
        ("Weg (mm);Kraft (N)\n0,1;2,0\n", "line 1 has 'Weg (mm)', 'Kraft (N)': length and area"),
        ("strain,true stress (kPa)\n0.1,2\n", "'true stress (kPa)': true stress is over the area of the moment"),
        ("true strain,stress (kPa)\n0.1,2\n", "a true strain is the logarithm of the stretch"),
        ("0.1,2\n0.2,3\n", "its columns have no names"),
        ("strain,stress\n1,2\n", "line 1: 'stress' needs a unit: pa, hpa, kpa, mpa"),
        ("strain,stress (MPa)\n1,x\n", "line 2: '1,x' lacks a number"),
        ("strain,stress (MPa)\n1,nan\n", "line 2: a value is not finite"),
        ("strain,stress (MPa)\n", "no numbers follow"),
        ("stretch,stress (kPa)\n" + "".join(f"{0.1 * k},{k}\n" for k in range(9)), "falls to 0: a stretch is length"),
    ],
)
def test_what_is_wrong_with_a_test_is_said_in_one_line(tmp_path: Path, text: str, expected: str) -> None:
    with pytest.raises(MaterialError) as error:
        read_tension_test(written(tmp_path, text))
    assert expected in str(error.value)
    assert "\n" not in str(error.value)


def test_the_command_writes_a_material_that_a_scene_can_name(tmp_path: Path) -> None:
    stress = nominal_stress("yeoh", {"c10": 40.0, "c20": 1.0, "c30": 0.1}, STRETCH)
    rows = "".join(f"{one - 1.0},{value}\n" for one, value in zip(STRETCH.tolist(), stress.tolist(), strict=True))
    path = written(tmp_path, "strain,stress (kPa)\n" + rows)
    file, picture = tmp_path / "mine.toml", tmp_path / "fit.png"
    result = CliRunner().invoke(materials, ["fit", str(path), "-o", str(file), "--plot", str(picture)])
    assert result.exit_code == 0, result.output
    assert "Young's modulus at rest 240 kPa" in result.output
    found = read_material(file)
    assert found.coefficients == pytest.approx({"c10": 40.0, "c20": 1.0, "c30": 0.1}, rel=1e-3)
    assert (found.law, found.highest_stretch, found.source) == ("yeoh", 3.0, "test.csv")
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_specimens_of_two_files_are_fitted_together(tmp_path: Path) -> None:
    """One rubber, 10 and 20 mm^2 thick: each file has its own area and encoding, and the modulus has an interval."""
    stress = nominal_stress("neo-hookean", {"mu": 50.0}, STRETCH)
    for name, area, encoding in (("a", 10.0, "cp1252"), ("b", 20.0, "utf-16")):
        pairs = zip(STRETCH.tolist(), (area * stress / 1e3).tolist(), strict=True)
        text = "".join(f"{100.0 * (one - 1.0):.5f};{force:.6f}\n" for one, force in pairs).replace(".", ",")
        (tmp_path / f"{name}.csv").write_text("Dehnung (%);Prüfkraft\n" + text, encoding=encoding)
    command = ["fit", str(tmp_path / "a.csv"), str(tmp_path / "b.csv"), "--law", "neo-hookean"]
    command += ["--columns", "force=Prüfkraft (N)", "--area", "10"]
    result = CliRunner().invoke(materials, [*command, "--area", "20"])
    assert result.exit_code == 0, result.output
    assert re.search(r"mu = 50 \(95 %: (49\.99\d*|50) to (50|50\.00\d*)\)", result.output), result.output
    refused = CliRunner().invoke(materials, [*command, "--area", "20", "--area", "30"])
    assert refused.exit_code == 2 and "3 given for 2 files" in refused.output
    twice = CliRunner().invoke(materials, [*command, "--columns", "force=2"])
    assert isinstance(twice.exception, MaterialError) and "names a quantity twice" in str(twice.exception)


def test_shipped_materials_name_their_source() -> None:
    """19 silicones; each names the database and its licence, is stiff at rest and gives way at no stretch up to 10."""
    shipped = shipped_materials()
    assert len(shipped) == 19
    listed = CliRunner().invoke(materials, []).output
    for name, material in shipped.items():
        assert name in listed
        assert "Open Database License" in material.source
        assert material.error is not None and material.error < 0.025
        stress = nominal_stress(material.law, material.coefficients, np.linspace(1.0, 10.0, 1000))
        assert (np.diff(stress) > 0.0).all()


def test_what_ships_is_what_the_command_fits(shared: Path) -> None:
    """To the five digits that the file has."""
    tests = shared / "measured" / "materials"
    for material in shipped_materials().values():
        measured = read_tension_test(tests / f"{material.name}.csv")
        found = fit_law(measured.within(0.05, 3.0), "yeoh")
        assert found.coefficients == pytest.approx(material.coefficients, rel=1e-4)
