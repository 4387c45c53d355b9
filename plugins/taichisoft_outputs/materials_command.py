"""The commands `taichisoft materials`, `taichisoft materials fit` and `taichisoft materials plot`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, product
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any

import numpy as np
import tomli_w
import typer

from taichisoft.base import plain, require, say
from taichisoft.running import provided
from taichisoft.runtime import RUBBER_LAWS, RubberLaw
from taichisoft.scene import Law, Material, data_folder, find_file, initial_shear_modulus, read_material
from taichisoft_outputs.tension_test import MaterialError, TensionTest

# Shipped materials, materials of plug-ins, and files of materials.


def shipped_materials() -> dict[str, Material]:
    """The materials that ship, by the name that a scene uses, in alphabetical order."""
    return {path.stem: read_material(path) for path in sorted((data_folder() / "materials").glob("*.toml"))}


def materials_of_plugins() -> dict[str, Material]:
    """The materials that plug-ins provide, by name.

    Raises:
        PluginError: two plug-ins claim one name.
        MaterialError: one is not valid.
    """
    found = {}
    for name, table in provided("material").items():
        try:
            found[name] = Material.model_validate(dict(table))
        except ValueError as error:
            raise MaterialError(f"material '{name}' of a plug-in: {' '.join(str(error).split())}") from error
    return found


def find_material(name: str) -> Material:
    """The material of a plug-in, a shipped material, or a material by its file.

    Raises:
        MaterialError: there is none, or it is not valid.
    """
    of_plugins = materials_of_plugins()
    if name in of_plugins:
        return of_plugins[name]
    try:
        return read_material(find_file(name, "materials", (".toml",), error=MaterialError))
    except ValueError as error:
        raise MaterialError(str(error)) from error


def write_material(material: Material, path: Path) -> None:
    """Write the file of a material, with five digits of its coefficients.

    Raises:
        MaterialError: the file cannot be written.
    """
    table = material.model_dump(mode="json", exclude_none=True)
    table["coefficients"] = {name: float(f"{value:.5g}") for name, value in material.coefficients.items()}
    try:
        path.write_text(tomli_w.dumps(table), encoding="utf-8")
    except OSError as error:
        raise MaterialError(f"{path}: cannot be written: {error.strerror}") from error


# Nominal stress of incompressible rubber pulled along one axis, by each law; Hooke's is E (l - 1).


def nominal_stress(law: Law, coefficients: Mapping[str, float], stretch: np.ndarray) -> np.ndarray:
    """Force over the area at rest [kPa], shape (count,), at stretches of that shape."""
    if law == "hooke":
        return coefficients["young_modulus"] * (stretch - 1.0)
    return RUBBER_LAWS[law].tension(coefficients, stretch)


# Stress over stretch: what was measured, and what laws make of it.

FORMATS = (".png", ".svg")


def draw_materials(
    materials: Mapping[str, Material], tests: Mapping[str, TensionTest], path: Path, columns: int = 4
) -> None:
    """A panel for each material: points of its test where there is one, its law up to its highest stretch.

    Raises:
        MaterialError: the picture's format is unknown.
    """
    if path.suffix.lower() not in FORMATS:
        raise MaterialError(f"{path}: a picture must end in {' or '.join(FORMATS)}")
    require("a plot of materials", "matplotlib")
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib.figure import Figure

    columns = min(columns, len(materials))
    rows = -(-len(materials) // columns)
    figure = Figure(figsize=(3.2 * columns, 2.4 * rows), layout="constrained")
    panels: Sequence[Any] = list(figure.subplots(rows, columns, squeeze=False).flat)
    for panel, (name, material) in zip(panels, materials.items(), strict=False):
        _draw(panel, material, tests.get(name))
        panel.set_title(material.name, fontsize=9)
    for panel in panels[len(materials) :]:
        panel.set_axis_off()
    figure.supxlabel("stretch [-]", fontsize=9)
    figure.supylabel("force over area at rest [kPa]", fontsize=9)
    with matplotlib.rc_context({"svg.hashsalt": "taichisoft"}):  # the same file every time
        figure.savefig(path, dpi=120, metadata={"Date": None} if path.suffix.lower() == ".svg" else None)


def _draw(panel: Any, material: Material, test: TensionTest | None) -> None:
    if test is not None:
        shown = test.stretch <= 1.15 * material.highest_stretch
        panel.plot(test.stretch[shown], test.stress[shown], ".", color="0.6", markersize=3, label="measured")
    stretch = np.linspace(1.0, material.highest_stretch, 100)
    stress = nominal_stress(material.law, material.coefficients, stretch)
    panel.plot(stretch, stress, color="C0", linewidth=1.2, label=material.law)
    panel.legend(fontsize=7, frameon=False)
    panel.tick_params(labelsize=7)


# Fitting the coefficients of a law to a tension test, by least squares of the nominal stress.

HOOKE_STRAIN = 0.2
"""Strain up to which Hooke's law is fitted: at 0.2 the neo-Hookean stress lies 15 % below E e."""
POINTS_PER_COEFFICIENT = 5
"""Points that a coefficient needs, so that their errors of measurement cancel out."""


@dataclass(frozen=True)
class LawFit:
    """A law with coefficients.

    Attributes:
        law, coefficients: as in a material's file.
        highest_stretch: up to which it was fitted [-].
        error: root mean square of the misfit over the largest stress [-].
        worst: largest misfit over the largest stress [-].
        points: number of points that it was fitted to.
    """

    law: Law
    coefficients: dict[str, float]
    highest_stretch: float
    error: float
    worst: float
    points: int

    @property
    def caution(self) -> str:
        """A line where the points are too few for the coefficients; empty otherwise."""
        count = len(self.coefficients)
        if self.points >= POINTS_PER_COEFFICIENT * count:
            return ""
        return (
            f"{self.points} points for {count} coefficients: with less than {POINTS_PER_COEFFICIENT * count} the curve "
            "follows the errors of the points, and its error says little; measure more, or take a law of fewer"
        )

    @property
    def young_modulus(self) -> float:
        """At rest, of incompressible rubber [kPa]."""
        return 3.0 * initial_shear_modulus(self.law, self.coefficients)


def fit_law(test: TensionTest, law: Law, terms: int = 1) -> LawFit:
    """Fit a law to all points of a test; Hooke's law to the points of small strain.

    Args:
        test: points, see `TensionTest.within`.
        law: its name.
        terms: number of terms, of a law that has several.

    Raises:
        MaterialError: the law has fewer terms, or the best coefficients do not describe a rubber.
    """
    if law == "hooke":
        test = test.within(0.0, 1.0 + HOOKE_STRAIN)
        coefficients = _fit_linear(test, law, ["young_modulus"])
    else:
        coefficients = _fit_rubber(test, law, RUBBER_LAWS[law], terms)
    _refuse_no_rubber(test, law, coefficients)
    misfit = nominal_stress(law, coefficients, test.stretch) - test.stress
    scale = np.abs(test.stress).max()
    error, worst = np.sqrt((misfit**2).mean()) / scale, np.abs(misfit).max() / scale
    return LawFit(law, coefficients, float(test.stretch.max()), float(error), float(worst), len(test.stretch))


def _fit_rubber(test: TensionTest, law: Law, rubber: RubberLaw, terms: int) -> dict[str, float]:
    if rubber.terms == 1:
        terms = 1
    elif not 1 <= terms <= rubber.terms:
        raise MaterialError(f"law '{law}' has 1 to {rubber.terms} terms, not {terms}")
    units = {
        name: one.unit
        for term in range(terms)
        for name, one in zip(rubber.term_names(term), rubber.coefficients, strict=True)
    }
    moduli = [name for name, unit in units.items() if unit == "kPa"]
    if len(moduli) < len(units):
        return _fit_search(test, law, rubber, terms, moduli)
    for count in range(len(moduli), 0, -1):
        coefficients = _fit_linear(test, law, moduli[:count])
        if not rubber.last_not_negative or coefficients[moduli[count - 1]] >= 0.0:
            break
    return coefficients


def _fit_linear(
    test: TensionTest, law: Law, moduli: list[str], pure_numbers: Mapping[str, float] = MappingProxyType({})
) -> dict[str, float]:
    """Linear least squares: for given pure numbers the stress is in proportion to each modulus."""
    each = [nominal_stress(law, {**pure_numbers, modulus: 1.0}, test.stretch) for modulus in moduli]
    found = np.linalg.lstsq(np.column_stack(each), test.stress, rcond=None)[0]
    return dict(zip(moduli, found.tolist(), strict=True))


def _fit_search(test: TensionTest, law: Law, rubber: RubberLaw, terms: int, moduli: list[str]) -> dict[str, float]:
    """The pure numbers by a search from many starts, in all combinations; for each try the moduli follow."""
    from scipy.optimize import least_squares

    searched = [one for one in rubber.coefficients if one.unit == "-"]
    first = len(rubber.coefficients) - len(searched)
    names = [name for term in range(terms) for name in rubber.term_names(term)[first:]]

    def coefficients(values: np.ndarray) -> dict[str, float]:
        pure_numbers = dict(zip(names, values.tolist(), strict=True))
        return pure_numbers | _fit_linear(test, law, moduli, pure_numbers)

    def misfit(values: np.ndarray) -> np.ndarray:
        stress = nominal_stress(law, coefficients(values), test.stretch)
        return (stress - test.stress) / np.abs(test.stress).max()

    bounds = np.tile([one.searched for one in searched], (terms, 1)).T
    tries = [
        least_squares(misfit, np.ravel(start), bounds=bounds, xtol=1e-12, ftol=1e-12, gtol=1e-12)
        for start in combinations(product(*(one.starts for one in searched)), terms)
    ]
    best = min(tries, key=lambda one: one.cost).x.reshape(terms, -1)
    found = coefficients(np.array(sorted(best.tolist())).ravel())
    return {name: found[name] for name in rubber.names if name in found}


def _refuse_no_rubber(test: TensionTest, law: Law, coefficients: dict[str, float]) -> None:
    """Refuse what is not stiff at rest, or gives way in tension within the range of the fit."""
    stretch = np.linspace(1.0, test.stretch.max(), 200)
    stress = nominal_stress(law, coefficients, stretch)
    if initial_shear_modulus(law, coefficients) <= 0.0:
        raise MaterialError(f"{test.source}: the best fit of law '{law}' has no stiffness at rest; take another law")
    if (np.diff(stress) <= 0.0).any():
        at = stretch[int(np.argmax(np.diff(stress) <= 0.0))]
        raise MaterialError(
            f"{test.source}: the best fit of law '{law}' gives way at a stretch of {at:.3g}; take another law, or less"
        )


HIGHEST_STRETCH = 3.0
LOWEST_STRAIN = 0.05
POISSON_RATIO = 0.499
DENSITY = 1.07e-6

materials = typer.Typer()

MORE = typer.Option("--highest-stretch", help="Stretch up to which points count \\[-].")
LESS = typer.Option("--lowest-strain", help="Strain from which they count: where grips slip, below some 0.05 \\[-].")


@materials.callback(invoke_without_command=True)
def list_materials(context: typer.Context) -> None:
    """List the materials that a scene can name, fit one to a tension test, or draw them."""
    if context.invoked_subcommand is not None:
        return
    import rich
    from rich.table import Table

    found = shipped_materials() | materials_of_plugins()
    table = Table()
    for heading in ("name", "law", "Young's modulus at rest [kPa]", "fitted up to a stretch of", "error [%]"):
        table.add_column(plain(heading))
    for name, one in found.items():
        young = 2.0 * (1.0 + one.poisson_ratio) * one.shear_modulus
        error = "" if one.error is None else f"{100 * one.error:.2f}"
        table.add_row(plain(name), plain(one.law), f"{young:.3g}", f"{one.highest_stretch:.3g}", error)
    rich.get_console().print(table)
    for source in sorted({one.source for one in found.values()}):
        say(source)


@materials.command()
def fit(
    test: Annotated[Path, typer.Argument(metavar="TEST.csv", help="A tension test: strain or stretch, and stress.")],
    law: Annotated[str, typer.Option(help="Law of elasticity, by its name in scenes.")] = "yeoh",
    terms: Annotated[int, typer.Option(help="Number of terms, of Ogden's law.")] = 1,
    highest_stretch: Annotated[float, MORE] = HIGHEST_STRETCH,
    lowest_strain: Annotated[float, LESS] = LOWEST_STRAIN,
    loading: Annotated[bool, typer.Option("--loading", help="Only points that are strained as never before.")] = False,
    slack: Annotated[float, typer.Option(help="Strain at which the specimen begins to be pulled \\[-].")] = 0.0,
    density: Annotated[float, typer.Option(help="Density of the material \\[kg/mm^3].")] = DENSITY,
    poisson_ratio: Annotated[float, typer.Option(help="Poisson's ratio of the material \\[-].")] = POISSON_RATIO,
    name: Annotated[str | None, typer.Option(help="What it is called  \\[default: the file's name]")] = None,
    source: Annotated[str | None, typer.Option(help="Where the test comes from  \\[default: the file's name]")] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE.toml", help="Material's file, for scenes.")
    ] = None,
    plot: Annotated[Path | None, typer.Option(metavar="FILE.png", help="Picture of the fit, .png or .svg.")] = None,
) -> None:
    """Fit a law to a tension test; prints coefficients [kPa] and the error over the range."""
    import rich

    from taichisoft.base import MODULUS, implausible
    from taichisoft.running import print_warning
    from taichisoft.scene import LAW_NAMES, Material
    from taichisoft_outputs.tension_test import MaterialError, read_tension_test

    measured = read_tension_test(test).without_slack(slack)
    if loading:
        measured = measured.first_loading()
    if law not in LAW_NAMES:
        raise MaterialError(f"no law is called '{law}'; there are: {', '.join(LAW_NAMES)}")
    found = fit_law(measured.within(lowest_strain, highest_stretch), law, terms)
    try:
        material = Material(
            name=name or test.stem,
            law=found.law,
            coefficients=found.coefficients,
            poisson_ratio=poisson_ratio,
            density=density,
            highest_stretch=float(f"{found.highest_stretch:.3g}"),
            error=float(f"{found.error:.2g}"),
            source=source or test.name,
        )
    except ValueError as error:
        raise MaterialError(f"density {density:g}, poisson_ratio {poisson_ratio:g}: one is not valid") from error
    for coefficient, value in found.coefficients.items():
        typer.echo(f"{coefficient} = {value:.6g}")
    typer.echo(
        f"Young's modulus at rest {found.young_modulus:.4g} kPa; up to a stretch of {found.highest_stretch:.3g} "
        f"the error is {100 * found.error:.2f} % of the largest stress, {100 * found.worst:.2f} % at worst"
    )
    unit = implausible("Young's modulus at rest", found.young_modulus, MODULUS)
    for caution in filter(None, (*measured.cautions, found.caution, unit)):
        print_warning(rich.get_console(), caution)
    if output is not None:
        write_material(material, output)
        say(output)
    if plot is not None:
        draw_materials({"fit": material}, {"fit": measured}, plot)
        say(plot)


@materials.command()
def plot(
    names: Annotated[list[str] | None, typer.Argument(metavar="[NAME]...", help="Materials  \\[default: all]")] = None,
    data: Annotated[Path | None, typer.Option(help="Folder of the tests (NAME.csv), drawn beside the laws.")] = None,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FILE", help="Picture, .png or .svg.")] = Path(
        "materials.png"
    ),
) -> None:
    """Draw stress over stretch of materials, beside what was measured."""
    from taichisoft_outputs.tension_test import MaterialError, read_tension_test

    chosen = {name: find_material(name) for name in names} if names else shipped_materials()
    if data is not None and not data.is_dir():
        raise MaterialError(f"{data}: no such folder of tests")
    files = {path.stem: path for path in data.glob("*.csv")} if data is not None else {}
    tests = {name: read_tension_test(files[one.name]) for name, one in chosen.items() if one.name in files}
    draw_materials(chosen, tests, output)
    say(output)
