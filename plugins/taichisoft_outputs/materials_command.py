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
    from taichisoft_outputs.material_files import MaterialError, write_material
    from taichisoft_outputs.tension_test import draw_materials, fit_law, read_tension_test

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
    from taichisoft_outputs.material_files import MaterialError, find_material, shipped_materials
    from taichisoft_outputs.tension_test import draw_materials, read_tension_test

    chosen = {name: find_material(name) for name in names} if names else shipped_materials()
    if data is not None and not data.is_dir():
        raise MaterialError(f"{data}: no such folder of tests")
    files = {path.stem: path for path in data.glob("*.csv")} if data is not None else {}
    tests = {name: read_tension_test(files[one.name]) for name, one in chosen.items() if one.name in files}
    draw_materials(chosen, tests, output)
    say(output)
