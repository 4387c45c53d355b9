"""A recording as VTU files for ParaView, or its surfaces as glTF.

`body` numbers the bodies in the order of the scene: soft bodies, rigid bodies, obstacles. Quantities have units in
their names, as columns of `run.csv` have.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree
from xml.sax.saxutils import escape

import numpy as np

from taichisoft.base import atomic_file
from taichisoft.control import FIGURES, In
from taichisoft.errors import TaichisoftError
from taichisoft.mechanics import ACTUATOR_KINDS, ActuatorKind, Plane, Stretches
from taichisoft_outputs.drawing.colouring import PLAIN, body_colours
from taichisoft_outputs.drawing.stage import square_of_plane
from taichisoft_outputs.recording.reader import RecordedSurface, Recording
from taichisoft_outputs.stress import recorded_stress, von_mises

if TYPE_CHECKING:
    from meshio import Mesh

NOTHING: Mapping[str, Any] = MappingProxyType({})

# Grids for ParaView by meshio (.vtu), and lists of such files with times (.pvd).

CELL_TYPES = {1: "vertex", 2: "line", 3: "triangle", 4: "tetra", 10: "tetra10"}
"""meshio's names of cells by their numbers of points."""


def make_grid(
    points: np.ndarray,
    cells: Sequence[np.ndarray],
    point_data: Mapping[str, np.ndarray] = NOTHING,
    cell_data: Mapping[str, np.ndarray] = NOTHING,
) -> "Mesh":
    """Points and cells with data on them, as files have them: real numbers in single precision, flags as bytes.

    Args:
        points: positions, shape (point_count, 3).
        cells: point indices of cells of one type after the other, each of shape (count, points_per_cell).
        point_data: arrays by name, each (point_count,) or (point_count, components).
        cell_data: arrays by name, each (cell_count,) or (cell_count, components).
    """
    from meshio import Mesh

    ends = np.cumsum([len(block) for block in cells])[:-1]
    blocks = [(CELL_TYPES[block.shape[1]], block.astype(np.int64)) for block in cells]
    of_cells = {name: np.split(values, ends) for name, values in _as_stored(cell_data).items()}
    return Mesh(points.astype(np.float32), blocks, _as_stored(point_data), of_cells)


def _as_stored(arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Arrays by the names that XML can have: meshio writes names as they are."""
    types = {"b": np.uint8, "f": np.float32}
    return {
        escape(name, {'"': "&quot;"}): values.astype(types.get(values.dtype.kind, values.dtype))
        for name, values in arrays.items()
    }


def write_vtu(path: Path, grid: "Mesh") -> None:
    """Write a grid; the file's folder is made."""
    with atomic_file(path) as partial:
        path.parent.mkdir(parents=True, exist_ok=True)
        grid.write(partial, "vtu")


def write_pvd(path: Path, files: Sequence[tuple[float, Path]]) -> None:
    """Write the list that ParaView opens: times [s] and files, which are named relative to the list's folder."""
    root = ElementTree.Element("VTKFile", type="Collection", version="1.0", byte_order="LittleEndian")
    collection = ElementTree.SubElement(root, "Collection")
    for time, file in files:
        place = file.relative_to(path.parent).as_posix()
        ElementTree.SubElement(collection, "DataSet", timestep=f"{time:.12g}", part="0", file=place)
    with atomic_file(path) as partial:
        path.parent.mkdir(parents=True, exist_ok=True)
        ElementTree.ElementTree(root).write(partial, encoding="utf-8", xml_declaration=True)


# Grids of an instant for ParaView: soft bodies, cavities, cables, surfaces of the other bodies, and contacts.

PLANE_SIZE = 4.0
"""Half the side of the square that stands for a plane, in radii of the bodies [-]."""
ROWS, COLUMNS = [0, 1, 2, 0, 1, 0], [0, 1, 2, 1, 2, 2]
"""Rows and columns of a symmetric tensor in the order of VTK: xx, yy, zz, xy, yz, xz."""

GridMaker = Callable[[int], "Mesh"]
"""Makes the grid of an instant."""


def grid_makers(recording: Recording) -> dict[str, GridMaker]:
    """The functions that make the grids of an instant, by the names of the grids; only those that show something."""
    scene = recording.scene
    makers: dict[str, GridMaker] = {}
    if recording.soft_bodies:
        makers["soft_bodies"] = _soft_bodies(recording)
    for kind in ACTUATOR_KINDS:
        actuators = recording.actuators.names_of(kind)
        walls = [surface for surface in recording.surfaces if surface.kind == kind.name]
        if walls:
            columns = {
                one.name: _named(one) for one in FIGURES if one.per.kind is kind and In.RECORDING in one.recorded
            }
            makers[kind.plural] = _surfaces(recording, walls, kind.name, actuators, columns)
        elif actuators and kind.drawn == "lines":
            makers[kind.plural] = _lines(recording, kind)
    others = [surface for surface in recording.surfaces if surface.kind in ("rigid", "obstacle")]
    others += [_square(plane, recording) for plane in recording.planes]
    if others:
        names = [*scene.soft_bodies, *scene.rigid_bodies, *scene.obstacles]
        makers["rigid_bodies"] = _surfaces(recording, others, "body", names)
    makers["contacts"] = lambda instant: _contacts(*recording.contacts(instant))
    return makers


def _soft_bodies(recording: Recording) -> GridMaker:
    """The elements of all soft bodies, with curved sides where they have ten nodes: their motion, stress, material."""
    bodies = recording.soft_bodies
    stresses = recorded_stress(recording)
    stretches = [Stretches(body.rest_position, body.elements) for body in bodies]
    material = np.concatenate([body.material for body in bodies])
    rest_position = np.vstack([body.rest_position for body in bodies])
    cells = [body.elements + body.nodes.start for body in bodies]
    # Soft bodies are the first of all bodies, so that their places are their numbers.
    numbers = np.arange(len(bodies), dtype=np.int32)
    first_node = np.cumsum([0, *(len(body.rest_position) for body in bodies)])
    first_cell = np.cumsum([0, *(len(body.elements) for body in bodies)])
    point_groups = [(first, body.surface_groups.items()) for first, body in zip(first_node, bodies, strict=False)]
    cell_groups = [(first, body.element_groups.items()) for first, body in zip(first_cell, bodies, strict=False)]
    names = _material_names(recording)
    of_material = [(0, [(name, np.flatnonzero(material == column))]) for column, name in enumerate(names)]
    points = {"body": np.repeat(numbers, np.diff(first_node)), **_members("surface", first_node[-1], point_groups)}
    fixed = {
        "body": np.repeat(numbers, np.diff(first_cell)),
        **_members("group", first_cell[-1], cell_groups),
        **_members("material", first_cell[-1], of_material),
    }

    def grid(instant: int) -> "Mesh":
        position = recording.row("position", instant)
        # A quadratic element is `parts` tetrahedra, each with a stress and a stretch.
        parted = [one.reshape(-1, body.parts, 3, 3) for one, body in zip(stresses(instant), bodies, strict=True)]
        stress = np.concatenate([one.mean(axis=1) for one in parted])
        largest = [
            one.largest(position[body.nodes]).reshape(-1, body.parts).max(axis=1)
            for one, body in zip(stretches, bodies, strict=True)
        ]
        moving = {"displacement [mm]": position - rest_position, "velocity [mm/s]": recording.velocity(instant)}
        present = {
            "stress [kPa]": stress[:, ROWS, COLUMNS],
            "von_mises [kPa]": von_mises(stress),
            "largest_stretch": np.concatenate(largest),
            "young_modulus [kPa]": recording.row("young_modulus", instant)[material],
        }
        return make_grid(position, cells, moving | points, present | fixed)

    return grid


def _material_names(recording: Recording) -> list[str]:
    """What each column of `young_modulus` is made of: the silicone's name, or that of the body or region."""
    settings = [one for body in recording.soft_bodies for one in recording.scene.soft_bodies[body.name].materials]
    named = zip(settings, recording.materials, strict=True)
    return [column if one.material is None else one.material.name for one, column in named]


def _members(
    prefix: str, count: int, groups: Iterable[tuple[int, Iterable[tuple[str, np.ndarray]]]]
) -> dict[str, np.ndarray]:
    """Whether each of `count` items belongs to a group, by "prefix_group".

    Args:
        groups: of each body the number of its first item, and names and items, counted from that, of its groups.
    """
    members: dict[str, np.ndarray] = {}
    for first, of_body in groups:
        for name, items in of_body:
            members.setdefault(f"{prefix}_{name}", np.zeros(count, dtype=bool))[first + np.ravel(items)] = True
    return members


def _surfaces(
    recording: Recording,
    surfaces: Sequence[RecordedSurface],
    kind: str,
    names: Sequence[str],
    columns: Mapping[str, str] = NOTHING,
) -> GridMaker:
    """Several surfaces as triangles.

    Args:
        surfaces: surfaces, each with one of the names.
        kind: name of the cell data with the index of the surface's name.
        names: names in the order in which they are numbered.
        columns: columns of the recording with a value for each name, and what they are called as cell data.
    """
    indices = np.array([names.index(surface.name) for surface in surfaces], dtype=np.int32)
    numbers = np.repeat(indices, [len(surface.triangles) for surface in surfaces])

    def grid(instant: int) -> "Mesh":
        vertices = [surface.vertices(instant) for surface in surfaces]
        first = np.cumsum([0, *map(len, vertices)])
        cells = [surface.triangles + start for surface, start in zip(surfaces, first, strict=False)]
        values = {shown: recording.row(name, instant)[numbers] for name, shown in columns.items()}
        return make_grid(np.vstack(vertices), cells, cell_data={kind: numbers, **values})

    return grid


def _lines(recording: Recording, kind: ActuatorKind) -> GridMaker:
    """Actuators as lines from point to point, with the effort along each line, and the coordinate of its actuator."""
    counts = [len(line.owner) for line in recording.lines(kind)]
    after = np.arange(sum(counts))
    after = np.delete(after, np.cumsum([0, *counts[:-1]]))  # no cell leads to the first point of a line
    cells = np.stack([after - 1, after], axis=1)
    numbers = np.repeat(np.arange(len(counts), dtype=np.int32), np.array(counts) - 1)

    def grid(instant: int) -> "Mesh":
        cell_data = {kind.name: numbers, _named(kind.effort): np.concatenate(recording.segment_efforts(kind, instant))}
        if kind.coordinate.observed:
            cell_data[_named(kind.coordinate)] = recording.row(kind.coordinate.name, instant)[numbers]
        return make_grid(np.vstack(recording.line_points(kind, instant)), [cells], cell_data=cell_data)

    return grid


def _contacts(points: np.ndarray, forces: np.ndarray) -> "Mesh":
    """A vertex at each contact [mm], with the force [mN] on the second body of its pair."""
    return make_grid(points, [np.arange(len(points))[:, None]], point_data={"force [mN]": forces})


def _named(figure: Any) -> str:
    return f"{figure.name} [{figure.unit}]"


def _square(plane: Plane, recording: Recording) -> RecordedSurface:
    """A piece of an infinite plane, large enough to be seen below everything; its front is that of the plane."""
    everything = np.vstack([surface.vertices(0) for surface in recording.surfaces])
    corners, triangles = square_of_plane(plane, everything, [], PLANE_SIZE)
    return RecordedSurface(plane.name, "obstacle", triangles, lambda instant: corners)


# Exporting a recording to ParaView, instant by instant.


class ExportError(TaichisoftError):
    """A recording cannot be exported as asked."""


def export_vtu(recording: Recording, instants: Iterable[int], folder: Path) -> list[Path]:
    """Write a .vtu file per instant and grid, and for each grid the .pvd file that ParaView opens.

    Args:
        instants: indices in the order of time; an iterator may show progress.
        folder: gets "soft_bodies.pvd", "soft_bodies/00000.vtu" and so on.

    Returns:
        The .pvd files.
    """
    makers = grid_makers(recording)
    times = recording.times
    written: dict[str, list[tuple[float, Path]]] = {name: [] for name in makers}
    try:
        for instant in instants:
            for name, make in makers.items():
                path = folder / name / f"{instant:05d}.vtu"
                write_vtu(path, make(instant))
                written[name].append((float(times[instant]), path))
    finally:  # complete files can be opened also after a full disk or an interruption
        for name, files in written.items():
            write_pvd(folder / f"{name}.pvd", files)
    return [folder / f"{name}.pvd" for name in makers]


def export_glb(recording: Recording, instants: Iterable[int], folder: Path) -> list[Path]:
    """Write the surfaces of each instant as a binary glTF file, in metres and with the scene's up as y, as glTF wants.

    Each surface is a mesh with its name and its colour in the scene.

    Args:
        instants: indices in the order of time; an iterator may show progress.
        folder: gets "00000.glb" and so on.
    """
    from trimesh import Scene, Trimesh, transform_points
    from trimesh.geometry import align_vectors
    from trimesh.visual import TextureVisuals
    from trimesh.visual.material import PBRMaterial

    own = body_colours(recording.scene)
    to_metres = align_vectors(recording.scene.up, [0.0, 1.0, 0.0])
    to_metres[:3] *= 1e-3
    surfaces = [*recording.surfaces, *(_square(plane, recording) for plane in recording.planes)]
    written = []
    for instant in instants:
        drawn = Scene()
        for surface in surfaces:
            colour = [*own.get(surface.name, np.array(PLAIN[surface.kind])), 1.0]
            material = PBRMaterial(name=surface.name, baseColorFactor=colour, roughnessFactor=0.8, doubleSided=True)
            vertices = transform_points(surface.vertices(instant), to_metres)
            mesh = Trimesh(vertices, surface.triangles, process=False)
            mesh.visual = TextureVisuals(material=material)
            drawn.add_geometry(mesh, node_name=surface.name, geom_name=surface.name)
        path = folder / f"{instant:05d}.glb"
        with atomic_file(path) as partial:
            folder.mkdir(parents=True, exist_ok=True)
            partial.write_bytes(drawn.export(file_type="glb"))
        written.append(path)
    return written


EXPORTS: Mapping[str, Callable[[Recording, Iterable[int], Path], list[Path]]] = {"vtu": export_vtu, "glb": export_glb}
"""By the name of the format."""


def chosen_instants(recording: Recording, every: int | None, times: Sequence[float] | None) -> list[int]:
    """Frames to export, in the order of time: the nearest to `times` [s], or each `every`-th since the last start."""
    if times:
        if every is not None:
            raise ExportError("--every and --time choose instants in two ways; give one of them")
        return sorted({recording.instant_at(time) for time in times})
    if every is not None and every < 1:
        raise ExportError(f"--every {every}: must be 1 or more; 10 takes each tenth recorded instant")
    return list(range(recording.last_start, recording.instant_count, every or 1))
