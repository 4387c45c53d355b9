"""Grids of a frame for ParaView: soft bodies, cavities, cables, surfaces of the other bodies, and contacts.

`body` numbers the bodies in the order of the scene: soft bodies, rigid bodies, obstacles. Quantities have units in
their names, as columns of `run.csv` have.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np

from taichisoft.actuators import ACTUATOR_KINDS, ActuatorKind
from taichisoft.bodies import Plane, Stretches
from taichisoft_outputs.drawing.planes import square_of_plane
from taichisoft_outputs.paraview.vtu_file import Grid
from taichisoft_outputs.recording.reader import RecordedSurface, Recording
from taichisoft_outputs.stress import recorded_stress, von_mises

PLANE_SIZE = 4.0
"""Half the side of the square that stands for a plane, in radii of the bodies [-]."""
ROWS, COLUMNS = [0, 1, 2, 0, 1, 0], [0, 1, 2, 1, 2, 2]
"""Rows and columns of a symmetric tensor in the order of VTK: xx, yy, zz, xy, yz, xz."""

NO_COLUMNS: Mapping[str, str] = MappingProxyType({})

GridMaker = Callable[[int], Grid]
"""Makes the grid of a frame."""


def grid_makers(recording: Recording) -> dict[str, GridMaker]:
    """The functions that make the grids of a frame, by the names of the grids; only those that show something."""
    scene = recording.scene
    makers: dict[str, GridMaker] = {}
    if recording.soft_bodies:
        makers["soft_bodies"] = _soft_bodies(recording)
    for kind in ACTUATOR_KINDS:
        actuators = recording.actuators.names_of(kind)
        walls = [surface for surface in recording.surfaces if surface.kind == kind.name]
        if walls:
            columns = {figure.name: _named(figure) for figure in kind.measured if figure.recorded}
            makers[kind.plural] = _surfaces(recording, walls, kind.name, actuators, columns)
        elif actuators and kind.drawn == "lines":
            makers[kind.plural] = _lines(recording, kind)
    others = [surface for surface in recording.surfaces if surface.kind in ("rigid", "obstacle")]
    others += [_square(plane, recording) for plane in recording.planes]
    if others:
        names = [*scene.soft_bodies, *scene.rigid_bodies, *scene.obstacles]
        makers["rigid_bodies"] = _surfaces(recording, others, "body", names)
    makers["contacts"] = lambda frame: _contacts(*recording.contacts(frame))
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

    def grid(frame: int) -> Grid:
        position = recording.row("position", frame)
        # A quadratic element is `parts` tetrahedra, each with a stress and a stretch.
        parted = [one.reshape(-1, body.parts, 3, 3) for one, body in zip(stresses(frame), bodies, strict=True)]
        stress = np.concatenate([one.mean(axis=1) for one in parted])
        largest = [
            one.largest(position[body.nodes]).reshape(-1, body.parts).max(axis=1)
            for one, body in zip(stretches, bodies, strict=True)
        ]
        moving = {"displacement [mm]": position - rest_position, "velocity [mm/s]": recording.velocity(frame)}
        present = {
            "stress [kPa]": stress[:, ROWS, COLUMNS],
            "von_mises [kPa]": von_mises(stress),
            "largest_stretch": np.concatenate(largest),
            "young_modulus [kPa]": recording.row("young_modulus", frame)[material],
        }
        return Grid(position, cells, moving | points, present | fixed)

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
        prefix: beginning of the names.
        count: number of items of all bodies.
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
    columns: Mapping[str, str] = NO_COLUMNS,
) -> GridMaker:
    """Several surfaces as triangles.

    Args:
        recording: the recording of the surfaces.
        surfaces: surfaces, each with one of the names.
        kind: name of the cell data with the index of the surface's name.
        names: names in the order in which they are numbered.
        columns: columns of the recording with a value for each name, and what they are called as cell data.
    """
    indices = np.array([names.index(surface.name) for surface in surfaces], dtype=np.int32)
    numbers = np.repeat(indices, [len(surface.triangles) for surface in surfaces])

    def grid(frame: int) -> Grid:
        vertices = [surface.vertices(frame) for surface in surfaces]
        first = np.cumsum([0, *map(len, vertices)])
        cells = [surface.triangles + start for surface, start in zip(surfaces, first, strict=False)]
        values = {shown: recording.row(name, frame)[numbers] for name, shown in columns.items()}
        return Grid(np.vstack(vertices), cells, cell_data={kind: numbers, **values})

    return grid


def _lines(recording: Recording, kind: ActuatorKind) -> GridMaker:
    """Actuators as lines from point to point, with the effort along each line, and the coordinate of its actuator."""
    counts = [len(line.owner) for line in recording.lines(kind)]
    after = np.arange(sum(counts))
    after = np.delete(after, np.cumsum([0, *counts[:-1]]))  # no cell leads to the first point of a line
    cells = np.stack([after - 1, after], axis=1)
    numbers = np.repeat(np.arange(len(counts), dtype=np.int32), np.array(counts) - 1)

    def grid(frame: int) -> Grid:
        cell_data = {kind.name: numbers, _named(kind.effort): np.concatenate(recording.segment_efforts(kind, frame))}
        if kind.coordinate.observed:
            cell_data[_named(kind.coordinate)] = recording.row(kind.coordinate.name, frame)[numbers]
        return Grid(np.vstack(recording.line_points(kind, frame)), [cells], cell_data=cell_data)

    return grid


def _contacts(points: np.ndarray, forces: np.ndarray) -> Grid:
    """A vertex at each contact [mm], with the force [mN] on the second body of its pair."""
    return Grid(points, [np.arange(len(points))[:, None]], point_data={"force [mN]": forces})


def _named(figure: Any) -> str:
    """The name of a quantity of an actuator, with its unit."""
    return f"{figure.name} [{figure.unit}]"


def _square(plane: Plane, recording: Recording) -> RecordedSurface:
    """A piece of an infinite plane, large enough to be seen below everything; its front is that of the plane."""
    everything = np.vstack([surface.vertices(0) for surface in recording.surfaces])
    corners, triangles = square_of_plane(plane, everything, [], PLANE_SIZE)
    return RecordedSurface(plane.name, "obstacle", triangles, lambda frame: corners)
