"""Grids of a frame for ParaView: soft bodies, cavities, cables, surfaces of the other bodies, and contacts.

`body` numbers the bodies in the order of the scene: soft bodies, rigid bodies, obstacles. Units are mm, mm/s, kPa, mm^3
and mN.
"""

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from taichisoft.actuators import ACTUATOR_KINDS, ActuatorKind
from taichisoft.bodies import Plane, Stretches
from taichisoft_outputs.drawing.planes import square_of_plane
from taichisoft_outputs.paraview.vtu_file import LINE, TETRAHEDRON, TRIANGLE, VERTEX, Grid
from taichisoft_outputs.recording.reader import RecordedSoftBody, RecordedSurface, Recording
from taichisoft_outputs.stress import recorded_stress, von_mises

PLANE_SIZE = 4.0
"""Half the side of the square that stands for a plane, in radii of the bodies [-]."""
ROWS, COLUMNS = [0, 1, 2, 0, 1, 0], [0, 1, 2, 1, 2, 2]
"""Rows and columns of a symmetric tensor in the order of VTK: xx, yy, zz, xy, yz, xz."""

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
            columns = [figure.name for figure in kind.measured if figure.recorded]
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
    """All soft bodies as tetrahedra, with their motion, stress and material."""
    bodies = recording.soft_bodies
    stresses = recorded_stress(recording)
    stretches = [Stretches(body.rest_position, body.elements) for body in bodies]
    material = np.concatenate([np.repeat(body.material, body.parts) for body in bodies])
    rest_position = np.vstack([body.rest_position for body in bodies])
    cells = np.vstack([body.tetrahedra + body.nodes.start for body in bodies])
    # Soft bodies are the first of all bodies, so that their places are their numbers.
    numbers = np.arange(len(bodies), dtype=np.int32)
    first_node = np.cumsum([0, *(len(body.rest_position) for body in bodies)])
    first_cell = np.cumsum([0, *(len(body.tetrahedra) for body in bodies)])
    point_groups = [(first, body.surface_groups.items()) for first, body in zip(first_node, bodies, strict=False)]
    cell_groups = [(first, _cell_groups(body)) for first, body in zip(first_cell, bodies, strict=False)]
    points = {"body": np.repeat(numbers, np.diff(first_node)), **_members("surface", first_node[-1], point_groups)}
    fixed = {"body": np.repeat(numbers, np.diff(first_cell)), **_members("group", first_cell[-1], cell_groups)}

    def grid(frame: int) -> Grid:
        position = recording.row("position", frame)
        stress = np.concatenate(stresses(frame))
        largest = [one.largest(position[body.nodes]) for one, body in zip(stretches, bodies, strict=True)]
        moving = {"displacement": position - rest_position, "velocity": recording.velocity(frame)}
        present = {
            "stress": stress[:, ROWS, COLUMNS],
            "von_mises": von_mises(stress),
            "largest_stretch": np.concatenate(largest),
            "young_modulus": recording.row("young_modulus", frame)[material],
        }
        return Grid(position, cells, TETRAHEDRON, moving | points, present | fixed)

    return grid


def _cell_groups(body: RecordedSoftBody) -> Iterable[tuple[str, np.ndarray]]:
    """The element groups of a body, as groups of its tetrahedra."""
    parts = np.arange(body.parts)
    return ((name, body.parts * group[:, None] + parts) for name, group in body.element_groups.items())


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
    columns: Iterable[str] = (),
) -> GridMaker:
    """Several surfaces as triangles.

    Args:
        recording: the recording of the surfaces.
        surfaces: surfaces, each with one of the names.
        kind: name of the cell data with the index of the surface's name.
        names: names in the order in which they are numbered.
        columns: columns of the recording with a value for each name, which become cell data.
    """
    indices = np.array([names.index(surface.name) for surface in surfaces], dtype=np.int32)
    numbers = np.repeat(indices, [len(surface.triangles) for surface in surfaces])

    def grid(frame: int) -> Grid:
        vertices = [surface.vertices(frame) for surface in surfaces]
        first = np.cumsum([0, *map(len, vertices)])
        cells = [surface.triangles + start for surface, start in zip(surfaces, first, strict=False)]
        values = {name: recording.row(name, frame)[numbers] for name in columns}
        return Grid(np.vstack(vertices), np.vstack(cells), TRIANGLE, cell_data={kind: numbers, **values})

    return grid


def _lines(recording: Recording, kind: ActuatorKind) -> GridMaker:
    """Actuators as lines from point to point, with the effort along each line, and the coordinate of its actuator."""
    counts = [len(line.owner) for line in recording.lines(kind)]
    after = np.arange(sum(counts))
    after = np.delete(after, np.cumsum([0, *counts[:-1]]))  # no cell leads to the first point of a line
    cells = np.stack([after - 1, after], axis=1)
    numbers = np.repeat(np.arange(len(counts), dtype=np.int32), np.array(counts) - 1)

    def grid(frame: int) -> Grid:
        cell_data = {kind.name: numbers, kind.effort.name: np.concatenate(recording.segment_efforts(kind, frame))}
        if kind.coordinate.observed:
            cell_data[kind.coordinate.name] = recording.row(kind.coordinate.name, frame)[numbers]
        return Grid(np.vstack(recording.line_points(kind, frame)), cells, LINE, cell_data=cell_data)

    return grid


def _contacts(points: np.ndarray, forces: np.ndarray) -> Grid:
    """A vertex at each contact [mm], with the force [mN] on the second body of its pair."""
    return Grid(points, np.arange(len(points))[:, None], VERTEX, point_data={"force": forces})


def _square(plane: Plane, recording: Recording) -> RecordedSurface:
    """A piece of an infinite plane, large enough to be seen below everything; its front is that of the plane."""
    everything = np.vstack([surface.vertices(0) for surface in recording.surfaces])
    corners, triangles = square_of_plane(plane, everything, [], PLANE_SIZE)
    return RecordedSurface(plane.name, "obstacle", triangles, lambda frame: corners)
