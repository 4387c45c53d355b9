"""`taichisoft mould`: what to cast a finger in, and whether it can be printed and opened."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from taichisoft.base import WorkerLost, atomic_file, call_apart, require
from taichisoft.errors import GoalMissed, MeshError
from taichisoft_meshing import mesh_command
from taichisoft_meshing.mould_check import CheckedPart

if TYPE_CHECKING:
    from taichisoft.scene import Material

# A picture of each part of a mould, from above and from below, with the places that the check found.

SIZE = (900, 640)
"""Width and height of each of the two views [pixels]."""
PRINTED, SILICONE, HELD, THIN = (0.55, 0.66, 0.76), (0.86, 0.80, 0.68), (0.80, 0.10, 0.10), (0.95, 0.60, 0.05)
"""Colours of what is printed and of silicone, of what an undercut holds, and of walls too thin to print."""
INK, LETTERS = (0.1, 0.12, 0.14), 22.0
"""Colour [-] and height [pixels] of the letters."""
TIME_LIMIT = 300.0
"""Longest time that the pictures may take [s]."""


def draw_parts(parts: Sequence[CheckedPart]) -> list[Path]:
    """Draw each part to a PNG beside its STL file.

    Raises:
        PackageMissing: Open3D is not installed.
        MeshError: nothing can be drawn here, or a file cannot be written.
    """
    require("pictures of a mould", "open3d")
    from PIL import Image

    try:
        images = call_apart(
            "taichisoft_meshing.mould_command:draw_views",
            [(part.corners, _colours(part)) for part in parts],
            time_limit=TIME_LIMIT,
        )
    except (WorkerLost, OSError, RuntimeError) as error:
        raise MeshError(f"the parts cannot be drawn: {error}; `taichisoft doctor` says what is missing") from error
    from taichisoft_outputs.drawing.overlay import paint_caption

    files = [part.file.with_suffix(".png") for part in parts]
    for image, file, part in zip(images, files, parts, strict=True):
        picture = Image.fromarray(image)
        size = " x ".join(f"{length:.1f}" for length in np.ptp(part.corners, axis=(0, 1)))
        paint_caption(picture, [file.stem, f"{size} mm", "from above and from below"], INK, LETTERS)
        with atomic_file(file, MeshError) as partial:
            picture.save(partial, format="png")
    return files


def draw_views(parts: Sequence[tuple[np.ndarray, np.ndarray]]) -> list[np.ndarray]:
    """What the drawing process does: two views of each part, beside each other, dtype uint8.

    Args:
        parts: corners [mm], shape (count, 3, 3), and colours of the triangles [-], (count, 3), of each part.
    """
    from taichisoft_outputs.drawing.camera import fit_camera, scene_axes, seen_from_front
    from taichisoft_outputs.drawing.drawer import antialias
    from taichisoft_outputs.drawing.painting import KEY_LIGHT, shade
    from taichisoft_outputs.drawing.stage import EMPTY, Stage
    from taichisoft_outputs.drawing.surface_painter import draw_lines

    stage = Stage(SIZE)  # a process can have only one
    images = []
    for corners, colours in parts:
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
        views = []
        for up in (np.array([0.0, 1.0, 0.0]), np.array([0.0, -1.0, 0.0])):
            key = np.array(KEY_LIGHT) @ scene_axes(up)
            camera = fit_camera(corners.reshape(-1, 3), up, "iso", SIZE[0] / SIZE[1])
            front = seen_from_front(camera, corners)
            points, triangles = corners[front].reshape(-1, 3), np.arange(3 * front.sum()).reshape(-1, 3)
            shown = shade(colours[front], normals[front], key / np.linalg.norm(key), up)
            for name, of_triangle in (("part", shown), ("normals", 0.5 + 0.5 * normals[front])):
                stage.put(name, points, triangles, np.repeat(of_triangle, 3, axis=0))
            image = stage.image(camera, ["part"])
            draw_lines(image, stage.image(camera, ["normals"]))
            image[(image == EMPTY).all(axis=2)] = 255
            views.append(antialias(image))
        images.append(np.concatenate(views, axis=1))
    return images


def _colours(part: CheckedPart) -> np.ndarray:
    colours = np.tile(PRINTED if part.printed else SILICONE, (len(part.corners), 1))
    colours[part.thin] = THIN
    for undercut in part.undercuts:
        colours[undercut.triangles] = HELD
    return colours


Silicone = Annotated[
    str | None,
    typer.Option(metavar="NAME", help="Material of which mass and mixing are said: see `taichisoft materials`."),
]
Stiff = Annotated[
    str | None, typer.Option(metavar="NAME", help="Material of the stiff layer; that of --silicone if not given.")
]


def mould(
    files: Annotated[list[str], mesh_command.FILE],
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
    set_: mesh_command.Set = None,
) -> None:
    """Write the mould of a finger as STEP and STL, and check it.

    It is for two castings, as PneuNets are made. Of any other body it is the negative in two halves, with its
    undercuts listed. The exit code is 1 where a part does not come off, cannot be printed, or does not fit.
    """
    from taichisoft_meshing.mesh_process import write_mould_apart
    from taichisoft_meshing.mesh_set import prepare_folder

    if surfaces:
        job = mesh_command.surfaces_job(files, set_, {})
    elif len(files) == 1:
        job = mesh_command.geometry_job(files[0], set_, {})
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
    from taichisoft_outputs.materials_command import find_material

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
    from taichisoft_meshing.mesh_quality import summary
    from taichisoft_meshing.mould_check import check_mould, read_mould_record

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
