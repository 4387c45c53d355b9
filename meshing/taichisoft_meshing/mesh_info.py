"""`taichisoft mesh info`: the figures of any mesh or surface that can be read, and the faces of a STEP body."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer
from rich.console import Group

from taichisoft.base import atomic_file, require
from taichisoft.errors import GoalMissed, MeshError
from taichisoft_meshing import mesh_command
from taichisoft_meshing.cad_body import CadBody
from taichisoft_meshing.mesh_quality import aligned_table

if TYPE_CHECKING:
    from rich.console import Console

    from taichisoft.mesh import SectionPlane, VolumeMesh

# The tables that `taichisoft mesh info` prints of a body from CAD.


def body_tables(body: CadBody) -> Group:
    """The solids of a body from CAD, its faces with the numbers that geometry files name, its cavities and openings."""

    def place(point: np.ndarray) -> str:
        return ", ".join(f"{value:.4g}" for value in np.round(point, 3) + 0.0)

    solids = [(f"{one.number}", one.name, f"{one.volume:.1f}") for one in body.solids]
    of_void = {face: f"cavity {number}" for number, void in enumerate(body.voids, 1) for face in void}
    of_void |= {face: f"opening {number}" for number, one in enumerate(body.openings, 1) for face in one.faces}
    of_void |= dict.fromkeys(body.flat_end, "base, unless another is named")
    faces = [
        (
            f"{face.number}",
            " | ".join(map(str, face.solids)),
            f"{face.area:.1f}",
            place(face.centre),
            "curved" if face.normal is None else place(face.normal),
            of_void.get(face.number, ""),
        )
        for face in body.faces
    ]
    air = [(f"cavity {number}", f"{volume:.1f}", "closed") for number, volume in enumerate(body.void_volumes, 1)]
    air += [(f"opening {number}", f"{one.volume:.1f}", str(one)) for number, one in enumerate(body.openings, 1)]
    return Group(
        aligned_table(body.path.name, (">solid", "name", ">volume [mm³]"), solids),
        aligned_table("", (">face", "solids", ">area [mm²]", "centre [mm]", "normal", ""), faces),
        *([aligned_table("", ("air", ">volume [mm³]", ""), air)] * bool(air)),
    )


# The picture of a body from CAD with the numbers of its faces, seen from two opposite corners.

EYES = ((1.0, -1.4, 0.9), (-1.0, 1.4, -0.9))
"""Directions from the body to the two eyes: every face of a block is seen by one of them."""
TRIED = 6  # triangles of a face, those near its middle and those near the eye, that are tried as its number's place


def draw_faces(body: CadBody, path: Path) -> None:
    """Draw a body with its faces in many colours, each with its number where it is seen.

    Raises:
        MeshError: the file cannot be written.
    """
    require("a picture of faces", "matplotlib")
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 11.0), dpi=110, facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    for axes, eye in zip(figure.subplots(2, 1), EYES, strict=True):
        _draw(axes, body, np.array(eye))
    size = " x ".join(f"{length:.4g}" for length in body.extent)
    shown = {text.get_text() for axes in figure.axes for text in axes.texts}
    hidden = [str(face.number) for face in body.faces if str(face.number) not in shown]
    rest = f"; not seen: {', '.join(hidden)}" if hidden else ""
    figure.suptitle(f"{body.path.name}: {len(body.faces)} faces, {size} mm{rest}".replace("$", r"\$"), wrap=True)
    with atomic_file(path, MeshError) as partial:
        figure.savefig(partial, format="png", metadata={"Software": None})


def _draw(axes: Any, body: CadBody, eye: np.ndarray) -> None:
    from matplotlib import colormaps
    from matplotlib.collections import PolyCollection

    towards = eye / np.linalg.norm(eye)
    right = np.cross([0.0, 0.0, 1.0], towards)
    right /= np.linalg.norm(right)
    view = np.column_stack([right, np.cross(towards, right), towards])
    corners = (body.nodes @ view)[body.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    facing = normals[:, 2] / np.linalg.norm(normals, axis=1)
    skin = np.isin(body.face_of, list(body.outside))
    seen = np.flatnonzero(skin & (facing > 1e-6))
    seen = seen[np.argsort(corners[seen, :, 2].mean(axis=1), kind="stable")]
    colours = colormaps["tab20"]((body.face_of[seen] * 7 % 20) / 20 + 0.025)
    colours[:, :3] = 0.45 + 0.55 * colours[:, :3] * (0.6 + 0.4 * facing[seen, None])
    axes.add_collection(
        PolyCollection(list(corners[seen, :, :2]), facecolors=colours, edgecolors="face", linewidths=0.4)
    )
    axes.autoscale_view()
    axes.set(aspect="equal", xticks=[], yticks=[], frame_on=False)
    box = {"boxstyle": "round,pad=0.15", "facecolor": "white", "edgecolor": "none", "alpha": 0.8}
    for face in np.unique(body.face_of[seen]).tolist():
        place = _visible_place(corners, seen, np.flatnonzero(body.face_of[seen] == face))
        if place is not None:
            axes.text(*place, str(face), ha="center", va="center", fontsize=9, bbox=box)
    span = np.ptp(corners[seen, :, :2].reshape(-1, 2), axis=0).max()
    origin = corners[seen, :, :2].reshape(-1, 2).min(axis=0) - 0.08 * span
    for name, axis in zip("xyz", view[:, :2], strict=True):
        ends = np.array([origin, origin + 0.08 * span * axis]).T
        axes.plot(*ends, color="#404040", linewidth=1.5)
        axes.text(*(origin + 0.1 * span * axis), name, color="#404040", ha="center", va="center")


def _visible_place(corners: np.ndarray, seen: np.ndarray, its: np.ndarray) -> np.ndarray | None:
    """The centre of a triangle that nothing covers, best near the middle of its face; None where there is none.

    Args:
        corners: of all triangles: to the right, up, and towards the eye [mm], shape (triangle_count, 3, 3).
        seen: triangles that face the eye.
        its: which of these are of the face.
    """
    centres = corners[seen[its]].mean(axis=1)
    middle = centres[:, :2].mean(axis=0)
    nearest = np.argsort(np.linalg.norm(centres[:, :2] - middle, axis=1), kind="stable")
    a, b, c = np.moveaxis(corners[seen], 1, 0)
    highest = np.argsort(-centres[:, 2], kind="stable")
    for number in (*nearest[:TRIED], *highest[:TRIED]):
        p = centres[number]
        shares = np.column_stack([_doubled(p, b, c), _doubled(a, p, c), _doubled(a, b, p)])
        shares = shares / _doubled(a, b, c)[:, None]
        depth = (shares * corners[seen][:, :, 2]).sum(axis=1)
        covered = (shares > -1e-9).all(axis=1) & (depth > p[2] + 1e-6 * np.abs(corners).max())
        if not covered.any():
            place: np.ndarray = p[:2]
            return place
    return None


def _doubled(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Twice the signed areas of triangles in the plane of the picture [mm^2]."""
    u, v = b - a, c - a
    area: np.ndarray = u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]
    return area


def mesh_info(
    file: Annotated[
        str,
        typer.Argument(
            metavar="FILE",
            help="Mesh (.msh, .vtk, .vtu), surface (.stl, .obj, .ply), STEP body (.step, .stp), or a shipped mesh.",
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            help="File for the figures (.json), or for a picture of a mesh or of a body's faces (.png).",
        ),
    ] = None,
    section: mesh_command.Section = None,
) -> None:
    """Show the figures of a mesh or surface (exit code 1 when it is not fit), or the faces of a STEP body."""
    from rich.console import Console  # --help need not wait for any of these

    from taichisoft.errors import MeshError
    from taichisoft.mesh import SURFACE_SUFFIXES, VOLUME_SUFFIXES, require_suffix
    from taichisoft.running import print_line
    from taichisoft.scene import find_file
    from taichisoft_meshing.geometry_file import STEP_SUFFIXES
    from taichisoft_meshing.mesh_quality import summary
    from taichisoft_meshing.mesh_set import prepare_folder

    suffixes = (*VOLUME_SUFFIXES, *SURFACE_SUFFIXES, *STEP_SUFFIXES)
    path = require_suffix(find_file(file, "meshes", suffixes, error=MeshError), "mesh or surface", suffixes)
    plane = mesh_command.section_plane(section)
    if plane is not None and path.suffix.lower() not in VOLUME_SUFFIXES:
        raise MeshError(f"--section {section}: has no effect on {path}; only meshes (.msh, .vtk, .vtu) are cut open")
    surface = path.suffix.lower() in SURFACE_SUFFIXES
    if output is not None:
        require_suffix(output, "report", (".json",) if surface else (".json", ".png"))
        prepare_folder(output.parent, output)
    console = Console()
    if path.suffix.lower() in STEP_SUFFIXES:
        problems = _show_body(console, path, output)
    else:
        problems = _show_surface(console, path, output) if surface else _show_mesh(console, path, output, plane)
    if output is not None:
        print_line(console, f"written to {output}")
    if problems:
        raise GoalMissed(f"{path}: {summary(problems)}")


def _show_mesh(console: "Console", path: Path, output: Path | None, section: "SectionPlane | None") -> list[str]:
    """Print and write the figures of a mesh; returns its problems."""
    from taichisoft.errors import MeshError
    from taichisoft.mesh import read_unchecked_mesh
    from taichisoft.running import print_warning
    from taichisoft_meshing.mesh_quality import QualityLimits, cautions, faults, measure, mesh_tables, missed_limits
    from taichisoft_meshing.mesh_record import mesh_figures, write_record
    from taichisoft_meshing.report_picture import draw_report

    mesh = read_unchecked_mesh(path)
    refused = []
    try:
        mesh.check()
    except MeshError as error:
        if not _can_be_measured(mesh):
            raise
        refused = [str(error).removeprefix(f"{path}: ")]
    quality, limits = measure(mesh), QualityLimits()
    problems, remarks = refused + faults(quality), cautions(quality) + missed_limits(quality, limits)
    console.print(mesh_tables(path.name, quality, limits))
    for remark in remarks:
        print_warning(console, remark)
    if output is not None and output.suffix.lower() == ".png":
        draw_report(mesh, quality, limits, path.name, output, section)
    elif output is not None:
        figures = mesh_figures(mesh, quality)
        write_record({"file": path.name, **figures, "problems": problems, "remarks": remarks}, output)
    return problems


def _can_be_measured(mesh: "VolumeMesh") -> bool:
    import numpy as np

    from taichisoft.mesh import LARGEST

    inside = (mesh.elements >= 0).all() and (mesh.elements < len(mesh.nodes)).all()
    return bool(mesh.elements.size and inside and (np.abs(mesh.nodes) <= LARGEST).all())


def _show_surface(console: "Console", path: Path, output: Path | None) -> list[str]:
    """Print and write the figures of a surface; returns its problems."""
    import numpy as np

    from taichisoft.base import SIZE, implausible
    from taichisoft.mesh import read_surface
    from taichisoft.running import print_warning
    from taichisoft_meshing.mesh_quality import surface_table
    from taichisoft_meshing.mesh_record import surface_figures, write_record
    from taichisoft_meshing.wall_quality import connected_pieces, measure_surface

    vertices, triangles = read_surface(path)
    surface = measure_surface(path.stem, vertices, triangles)
    pieces, extent = len(connected_pieces(triangles, len(vertices))), np.ptp(vertices, axis=0)
    problems = [f"is not closed: {surface.open_edges} edges do not join two triangles"] if surface.open_edges else []
    console.print(surface_table(path.name, surface, pieces, extent))
    if caution := implausible("its longest side", float(extent.max()), SIZE):
        print_warning(console, caution)
    if output is not None:
        figures = {**surface_figures(surface), "volume_mm3": surface.volume, "pieces": pieces}
        record = {"file": path.name, **figures, "extent_mm": extent.tolist(), "problems": problems}
        write_record(record, output)
    return problems


def _show_body(console: "Console", path: Path, output: Path | None) -> list[str]:
    """Print the solids, faces and openings of a STEP body, and write or draw them."""
    from taichisoft.running import print_warning
    from taichisoft_meshing.mesh_process import read_step_apart
    from taichisoft_meshing.mesh_record import body_figures, write_record

    body = read_step_apart(path)
    console.print(body_tables(body))
    if body.doubt:
        print_warning(console, body.doubt)
    if output is not None and output.suffix.lower() == ".png":
        draw_faces(body, output)
    elif output is not None:
        write_record({"file": path.name, **body_figures(body)}, output)
    return []
