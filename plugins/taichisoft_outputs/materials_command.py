"""The commands `taichisoft materials`, `taichisoft materials fit` and `taichisoft materials plot`."""

from pathlib import Path
from typing import Annotated

import typer

from taichisoft.base import plain, say

HIGHEST_STRETCH = 3.0
LOWEST_STRAIN = 0.05
POISSON_RATIO = 0.499
DENSITY = 1.07e-6

materials = typer.Typer()

MORE = typer.Option("--highest-stretch", help="Stretch up to which points count \\[-].")
LESS = typer.Option("--lowest-strain", help="Strain from which they count: where grips slip, below some 0.05 \\[-].")

COLUMNS = typer.Option(
    "--columns",
    metavar="QUANTITY=COLUMN",
    help="Name or number of the column of strain, stretch, stress, extension or force, with its unit where the name "
    "has none: 'strain=2 (%)' (repeatable).",
)


@materials.callback(invoke_without_command=True)
def list_materials(context: typer.Context) -> None:
    """List the materials that a scene can name, fit one to a tension test, or draw them."""
    if context.invoked_subcommand is not None:
        return
    import rich
    from rich.table import Table

    from taichisoft_outputs.material_files import materials_of_plugins, shipped_materials

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
    tests: Annotated[
        list[Path], typer.Argument(metavar="TEST.csv...", help="Tension tests, a specimen or several in each.")
    ],
    law: Annotated[str, typer.Option(help="Law of elasticity, by its name in scenes.")] = "yeoh",
    terms: Annotated[int, typer.Option(help="Number of terms, of Ogden's law.")] = 1,
    highest_stretch: Annotated[float, MORE] = HIGHEST_STRETCH,
    lowest_strain: Annotated[float, LESS] = LOWEST_STRAIN,
    columns: Annotated[list[str] | None, COLUMNS] = None,
    area: Annotated[
        list[float] | None,
        typer.Option(
            help="Cross-section at rest \\[mm^2], where there is a force; of all, or for each file (repeatable)."
        ),
    ] = None,
    length: Annotated[
        list[float] | None, typer.Option(help="Length at rest \\[mm], where there is an extension.")
    ] = None,
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
    """Fit a law to tension tests; prints coefficients [kPa] with intervals, and the error over the range."""
    import rich

    from taichisoft.base import MODULUS, implausible
    from taichisoft.running import print_warning
    from taichisoft.scene import LAW_NAMES, Material
    from taichisoft_outputs.material_files import MaterialError, write_material
    from taichisoft_outputs.tension_test import draw_materials, fit_law, joined, read_specimens

    pairs = [text.partition("=")[::2] for text in columns or ()]
    named = {quantity.strip(): column.strip() for quantity, column in pairs}
    if len(named) < len(pairs):
        raise MaterialError("--columns: names a quantity twice; specimens side by side need the same names of columns")
    sizes = (_of_each("area", area, len(tests)), _of_each("length", length, len(tests)))
    specimens = [
        specimen.without_slack(slack)
        for test, *size in zip(tests, *sizes, strict=True)
        for specimen in read_specimens(test, named, *size)
    ]
    if loading:
        specimens = [specimen.first_loading() for specimen in specimens]
    measured = joined(specimens)
    if law not in LAW_NAMES:
        raise MaterialError(f"no law is called '{law}'; there are: {', '.join(LAW_NAMES)}")
    found = fit_law(measured.within(lowest_strain, highest_stretch), law, terms)
    try:
        material = Material(
            name=name or tests[0].stem,
            law=found.law,
            coefficients=found.coefficients,
            poisson_ratio=poisson_ratio,
            density=density,
            highest_stretch=float(f"{found.highest_stretch:.3g}"),
            error=float(f"{found.error:.2g}"),
            source=source or measured.source,
        )
    except ValueError as error:
        raise MaterialError(f"density {density:g}, poisson_ratio {poisson_ratio:g}: one is not valid") from error
    for coefficient, value in found.coefficients.items():
        low, high = found.intervals[coefficient]
        typer.echo(f"{coefficient} = {value:.6g} (95 %: {low:.6g} to {high:.6g})")
    typer.echo(
        f"Young's modulus at rest {found.young_modulus:.4g} kPa; up to a stretch of {found.highest_stretch:.3g} "
        f"the error is {100 * found.error:.2f} % of the largest stress, {100 * found.worst:.2f} % at worst"
    )
    cautions = (caution for specimen in specimens for caution in specimen.cautions)
    unit = implausible("Young's modulus at rest", found.young_modulus, MODULUS)
    for caution in filter(None, (*cautions, found.caution, unit)):
        print_warning(rich.get_console(), caution)
    if output is not None:
        write_material(material, output)
        say(output)
    if plot is not None:
        draw_materials({"fit": material}, {"fit": measured}, plot)
        say(plot)


def _of_each(option: str, values: list[float] | None, count: int) -> list[float | None]:
    """A value for each file: its own, or the only one."""
    given: list[float | None] = [*values] if values else [None]
    if len(given) not in (1, count):
        raise typer.BadParameter(f"--{option}: {len(given)} given for {count} files; give one, or one for each")
    return given * count if len(given) == 1 else given


@materials.command()
def plot(
    names: Annotated[list[str] | None, typer.Argument(metavar="[NAME]...", help="Materials  \\[default: all]")] = None,
    data: Annotated[Path | None, typer.Option(help="Folder of the tests (NAME.csv), drawn beside the laws.")] = None,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FILE", help="Picture, .png or .svg.")] = Path(
        "materials.png"
    ),
) -> None:
    """Draw stress over stretch of materials, beside what was measured."""
    from taichisoft_outputs.material_files import MaterialError, find_material, shipped_materials
    from taichisoft_outputs.tension_test import draw_materials, read_tension_test

    chosen = {name: find_material(name) for name in names} if names else shipped_materials()
    if data is not None and not data.is_dir():
        raise MaterialError(f"{data}: no such folder of tests")
    files = {path.stem: path for path in data.glob("*.csv")} if data is not None else {}
    tests = {name: read_tension_test(files[one.name]) for name, one in chosen.items() if one.name in files}
    draw_materials(chosen, tests, output)
    say(output)
