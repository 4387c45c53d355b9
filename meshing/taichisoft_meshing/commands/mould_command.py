"""`taichisoft mould`: what to cast a finger in, and whether it can be printed and opened."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from taichisoft.errors import GoalMissed, MeshError
from taichisoft_meshing.commands import mesh_options

if TYPE_CHECKING:
    from taichisoft.scenes import Material

Silicone = Annotated[
    str | None,
    typer.Option(metavar="NAME", help="Material of which mass and mixing are said: see `taichisoft materials`."),
]
Stiff = Annotated[
    str | None, typer.Option(metavar="NAME", help="Material of the stiff layer; that of --silicone if not given.")
]


def mould(
    files: Annotated[list[str], mesh_options.FILE],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder of the files.")],
    surfaces: Annotated[
        bool, typer.Option("--surfaces", help="FILEs are surfaces (STL, OBJ, PLY): their negative is made.")
    ] = False,
    wall: Annotated[float | None, typer.Option(help="Thickness around the silicone \\[mm]: 6.")] = None,
    draft: Annotated[float | None, typer.Option(help="Angle by which faces lean \\[degrees]: 1.")] = None,
    printable: Annotated[float | None, typer.Option(help="Least thickness that prints \\[mm]: 1.")] = None,
    parting: Annotated[str | None, typer.Option(metavar="z=0", help="Parting plane of a negative.")] = None,
    silicone: Silicone = None,
    stiff: Stiff = None,
    set_: mesh_options.Set = None,
) -> None:
    """Write the mould of a finger as STEP and STL, and check it.

    It is for two castings, as PneuNets are made. Of any other body it is the negative in two halves, with its
    undercuts listed. The exit code is 1 where a part does not come off, cannot be printed, or does not fit.
    """
    from taichisoft_meshing.mesh_process import write_mould_apart
    from taichisoft_meshing.mesh_set import prepare_folder

    if surfaces:
        job = mesh_options.surfaces_job(files, set_, {})
    elif len(files) == 1:
        job = mesh_options.geometry_job(files[0], set_, {})
    else:
        raise MeshError(f"{files[1]}: one file is taken at a time; several need --surfaces")
    materials = _materials(silicone, stiff)
    prepare_folder(output)
    form = {"wall": wall, "draft": draft, "printable": printable, "parting": parting}
    write_mould_apart(job, output, {key: value for key, value in form.items() if value is not None})
    _report(output, materials)


def mould_check(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Folder that `taichisoft mould` wrote.")],
    silicone: Silicone = None,
    stiff: Stiff = None,
) -> None:
    """Check a mould as its STL files are now, and draw each part; the exit code is 1 when something is wrong.

    Every part comes off in its direction, parts and silicone fill the block, and walls are thick enough to print.
    """
    _report(folder, _materials(silicone, stiff))


def _materials(silicone: str | None, stiff: str | None) -> dict[str, "Material | None"]:
    from taichisoft_outputs.materials.material_files import find_material

    soft = None if silicone is None else find_material(silicone)
    return {"soft": soft, "stiff": soft if stiff is None else find_material(stiff)}


def _report(folder: Path, materials: dict[str, "Material | None"]) -> None:
    """Check, draw and print a mould.

    Raises:
        GoalMissed: something is wrong with it.
    """
    from rich.console import Console
    from rich.table import Table

    from taichisoft.running import print_line, print_warning
    from taichisoft_meshing.mould.mould_check import check_mould, read_mould_record
    from taichisoft_meshing.mould.part_pictures import draw_parts
    from taichisoft_meshing.quality.quality_limits import summary

    console, record = Console(), read_mould_record(folder)
    casts = check_mould(folder)
    negative = record.get("kind") == "negative"
    title = f"negative, parted at {record.get('parting')}" if negative else "mould"
    table = Table(title=f"{record['name']}: {title}", title_justify="left")
    for heading in ("part", "comes off", "volume cm^3", "least wall mm", "undercuts"):
        table.add_column(heading, justify="left" if heading in ("part", "comes off") else "right")
    for cast in casts:
        for part in cast.parts:
            wall = "" if part.thickness == float("inf") else f"{part.thickness:.2f}"
            way, undercuts = _direction(part.comes_off), str(len(part.undercuts)) if part.comes_off is not None else ""
            table.add_row(part.file.stem, way, f"{part.volume / 1000:.2f}", wall, undercuts)
    console.print(table)
    for cast, written in zip(casts, record["casts"], strict=True):
        print_line(console, f"{cast.name}: parts and silicone fill the block to {abs(cast.unfilled):.1e}")
        for pour in written["pours"]:
            print_line(console, f"  pour {pour_line(pour, materials[pour['silicone']])}")
    draw_parts([part for cast in casts for part in cast.parts])
    print_line(console, f"written to {folder}, with a picture of each part")
    problems = [problem for cast in casts for problem in cast.problems]
    for problem in problems:
        print_warning(console, problem)
    if problems:
        raise GoalMissed(f"{folder}: {summary(problems)}")


def pour_line(pour: dict[str, Any], material: "Material | None") -> str:
    """What to weigh for one pour, in words."""
    volume = pour["mm3"]
    line = f"{pour['what']}: {volume / 1000:.1f} cm^3"
    if material is None:
        return f"{line} of {pour['silicone']} silicone"
    grams = 1000 * material.density * volume
    line += f" of {material.name}, {grams:.1f} g"
    mixing = material.mixing
    if mixing is None:
        return f"{line}; its file has no mixing ratio: see the maker's data sheet"
    whole, unit = (volume / 1000, "cm^3") if mixing.by == "volume" else (grams, "g")
    share = mixing.a / (mixing.a + mixing.b)
    return f"{line}: {whole * share:.1f} {unit} of A and {whole * (1 - share):.1f} {unit} of B, by {mixing.by}"


def _direction(way: Any) -> str:
    """A direction in words: "+y"."""
    if way is None:
        return "stays"
    axis = max(range(3), key=lambda one: abs(way[one]))
    return f"{'+' if way[axis] > 0 else '-'}{'xyz'[axis]}"
