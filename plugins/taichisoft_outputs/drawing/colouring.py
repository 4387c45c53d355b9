"""The surfaces of a recording, tubes along lines among them, and their colours before light falls on them.

Bodies have the colours of the scene, or soft bodies show displacement, stress or strain; actuators show their effort:
cavities the pressure, cables the tension. Colours that stand for numbers get no light, which would move them off the
bar that explains them.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from taichisoft import Scene
from taichisoft.mechanics import ACTUATOR_KINDS, ActuatorKind, Stretches, embed, soft_surface
from taichisoft.mesh import MappedSurface, linear_parts, read_surface
from taichisoft.scene import red_green_blue
from taichisoft_outputs.drawing.camera import radius_around_mean
from taichisoft_outputs.drawing.style import Style, StyleError
from taichisoft_outputs.recording.bodies import RecordedSoftBody, RecordedSurface
from taichisoft_outputs.recording.reader import Recording
from taichisoft_outputs.stress import nodal_mean, recorded_stress, von_mises

# A finer surface in place of a soft body's own: it is mapped onto the elements and moves with them.


def with_visual_surfaces(recording: Recording, path: Path | None) -> list[RecordedSurface]:
    """The surfaces of a recording; a file replaces the surfaces of soft bodies.

    Args:
        path: file of a surface in the coordinates of the bodies' mesh files [mm]; None leaves all as they are.
    """
    if path is None:
        return list(recording.surfaces)
    vertices, triangles = read_surface(path)
    mapped: dict[bytes, MappedSurface] = {}  # often several bodies have one mesh
    surfaces = {}
    for body in recording.soft_bodies:
        mesh = body.mesh_nodes.tobytes()
        if mesh not in mapped:
            mapped[mesh] = _map(vertices, triangles, body, path)
        surfaces[body.name] = recording.follow(soft_surface(body.name, "soft", mapped[mesh], body.nodes))
    return [surfaces[surface.name] if surface.kind == "soft" else surface for surface in recording.surfaces]


def _map(vertices: np.ndarray, triangles: np.ndarray, body: RecordedSoftBody, path: Path) -> MappedSurface:
    from scipy.spatial import cKDTree

    corners = body.mesh_nodes[body.elements[:, :4]]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max()
    distance, _ = cKDTree(body.mesh_nodes).query(vertices)
    outside = int(np.count_nonzero(distance > longest))
    if outside:
        raise StyleError(
            f"{path}: {outside} of {len(vertices)} vertices lie further from the mesh of '{body.name}' than an element "
            "is long; a surface must be in the coordinates of the body's mesh file, in mm"
        )
    return MappedSurface(*embed(vertices, body.mesh_nodes, linear_parts(body.elements)), triangles)


# Cables, and other actuators drawn as lines, as thin tubes with a bead at each point through which they run.

THICKNESS = 0.01
"""Radius of a tube, in radii of the soft bodies [-]: cables are drawn thicker than they are, so that they are seen."""
BEAD = 2.0
"""Radius of a bead, in radii of the tube [-]."""
SIDES = 10
"""Faces around a tube: few enough to draw fast, and enough that they meet at angles that are shaded smoothly."""


@dataclass(frozen=True)
class LineTube(RecordedSurface):
    """A tube around a line.

    Attributes:
        actuator: the kind of the actuator.
        number: its number among its kind.
        segment: the part of the line between two points that each vertex belongs to, shape (vertex_count,).
    """

    actuator: str = ""
    number: int = 0
    segment: np.ndarray | None = None

    def at_vertices(self, values: np.ndarray) -> np.ndarray:
        """Values at the vertices, shape (vertex_count,), of values of the parts between points, (point_count - 1,)."""
        return values[self.segment]


def line_tubes(recording: Recording, first_frame: int) -> list[LineTube]:
    """A tube for each cable and other line of a recording.

    Args:
        first_frame: the instant in which the bodies have the size that the thickness suits.
    """
    lines = [(kind, line) for kind in ACTUATOR_KINDS for line in recording.lines(kind)]
    if not lines:
        return []
    soft = [surface.vertices(first_frame) for surface in recording.surfaces if surface.kind == "soft"]
    radius = THICKNESS * radius_around_mean(np.concatenate(soft))
    return [
        LineTube(
            # No body or cavity has this name, as a line's own might be.
            name=f"{line.name}|{kind.name}",
            kind="line",
            triangles=tube_triangles(len(line.owner)),
            vertices=_around(partial(recording.points_of_line, line), radius),
            actuator=kind.name,
            number=line.number,
            segment=_segments(len(line.owner)),
        )
        for kind, line in lines
    ]


def tube_vertices(points: np.ndarray, radius: float) -> np.ndarray:
    """Vertices of a tube with beads around a polyline [mm], shape (vertex_count, 3)."""
    ways = np.diff(points, axis=0)
    along = ways / np.maximum(np.linalg.norm(ways, axis=1, keepdims=True), 1e-30)
    # Any direction across: faces are too many and too small for anybody to see where the first of them is.
    aside = np.cross(along, np.eye(3)[np.abs(along).argmin(axis=1)])
    aside /= np.maximum(np.linalg.norm(aside, axis=1, keepdims=True), 1e-30)
    axes = np.stack([radius * aside, radius * np.cross(along, aside), ways], axis=1)
    tubes = 0.5 * (points[1:] + points[:-1])[:, None] + _tube().vertices @ axes
    beads = points[:, None] + BEAD * radius * _ball().vertices
    return np.concatenate([tubes.reshape(-1, 3), beads.reshape(-1, 3)])


def tube_triangles(point_count: int) -> np.ndarray:
    """Vertex indices of the outward triangles of `tube_vertices`, shape (triangle_count, 3)."""
    size = len(_tube().vertices)
    segments = size * np.arange(point_count - 1)
    beads = size * (point_count - 1) + len(_ball().vertices) * np.arange(point_count)
    return np.concatenate([_repeated(_tube().faces, segments), _repeated(_ball().faces, beads)])


def _around(points: Callable[[int], np.ndarray], radius: float) -> Callable[[int], np.ndarray]:
    return lambda instant: tube_vertices(points(instant), radius)


def _segments(point_count: int) -> np.ndarray:
    """The segment of each vertex of `tube_vertices`; that of a bead is the one that ends there."""
    of_tubes = np.repeat(np.arange(point_count - 1), len(_tube().vertices))
    of_beads = np.repeat(np.maximum(np.arange(point_count) - 1, 0), len(_ball().vertices))
    return np.concatenate([of_tubes, of_beads])


def _repeated(triangles: np.ndarray, starts: Iterable[int]) -> np.ndarray:
    return np.concatenate([triangles + start for start in starts])


@cache
def _tube() -> Any:
    from trimesh.creation import cylinder

    return cylinder(radius=1.0, height=1.0, sections=SIDES)


@cache
def _ball() -> Any:
    from trimesh.creation import icosphere

    return icosphere(subdivisions=1)


# Scales that hold for all instants that are drawn: colours for numbers, round ends, instants to look at.

SOFT = ((0.93, 0.92, 0.88), (0.98, 0.82, 0.42), (0.93, 0.46, 0.24), (0.70, 0.13, 0.30), (0.33, 0.06, 0.32))
"""Colours from silicone's own over yellow and red to violet: brightness falls all the way."""

AIR = ((0.60, 0.70, 0.72), (0.24, 0.66, 0.62), (0.02, 0.50, 0.38), (0.00, 0.27, 0.22))
"""Colours from grey to dark green: none of them is among the colours of the silicone around the air."""

LINE = ((0.42, 0.43, 0.46), (0.62, 0.25, 0.55), (0.72, 0.02, 0.50), (0.36, 0.00, 0.32))
"""Colours from grey over magenta to purple, which neither silicone nor air has."""


STEPS = (1.0, 1.2, 1.5, 1.8, 2.0, 2.5, 3.0, 3.5, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0)


@dataclass(frozen=True)
class ColourScale:
    """Colours that run linearly from the lowest to the highest value.

    Attributes:
        title: what the values are, with their unit.
        low, high: values of the first and the last colour; `low` < `high`.
        steps: red, green and blue [-] of evenly spaced values.
        highest: the highest value that is shown; above `high` it has the colour of that, and the bar says so.
        names: what the values 0, 1, ... stand for, which a legend lists in the place of a bar; () for quantities.
    """

    title: str
    low: float
    high: float
    steps: Sequence[tuple[float, float, float]]
    highest: float = -np.inf
    names: tuple[str, ...] = ()

    @property
    def stops(self) -> np.ndarray:
        """The values between which colours run linearly, shape (step_count,)."""
        return np.linspace(self.low, self.high, len(self.steps))

    @property
    def top(self) -> str:
        """The number at the high end, and the highest value where its colour stands for all up to that."""
        return f"{self.high:g}" + (f" to {self.highest:.3g}" if self.highest > self.high * (1 + 1e-9) else "")

    def colours(self, values: np.ndarray) -> np.ndarray:
        """Red, green and blue [-], shape (count, 3), of values (count,); values outside get the colour of the end."""
        return np.stack([np.interp(values, self.stops, part) for part in np.array(self.steps).T], axis=1)


def round_up(value: float) -> float:
    """The next of STEPS times a power of ten, for the high end of a scale: no more than a quarter above the value."""
    power = 10.0 ** np.floor(np.log10(value))
    step = next(step for step in STEPS if value <= step * power * (1 + 1e-9))
    return float(f"{step * power:.6g}")  # the decimal number, not 0.7000000000000001


def scale_of(title: str, values: np.ndarray, steps: Sequence[tuple[float, float, float]]) -> ColourScale | None:
    """A scale from the lowest to the highest of the values, and zero, with round ends; None where all are zero."""
    lowest, highest = np.min(values, initial=0.0), np.max(values, initial=0.0)
    if highest == lowest:
        return None
    ends = [round_up(abs(end)) * np.sign(end) if end else 0.0 for end in (lowest, highest)]
    return ColourScale(title, float(ends[0]), float(ends[1]), steps)


def effort_scale(kind: ActuatorKind, values: np.ndarray) -> ColourScale | None:
    """A scale for efforts of a kind of actuators, such as pressures."""
    return scale_of(f"{kind.effort.words} [{kind.effort.unit}]", values, AIR if kind.drawn == "walls" else LINE)


def round_down(value: float) -> float:
    """The last of 1, 2, 5 and 10 times a power of ten, for a value that a scale shows."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * max(step for step in (1.0, 2.0, 5.0) if step * power <= value * (1 + 1e-9)))


def sample_instants(instants: Sequence[int], count: int) -> list[int]:
    """At most `count` of the instants, evenly spaced from the first to the last."""
    return [instants[index] for index in np.unique(np.linspace(0, len(instants) - 1, count).astype(int))]


# The colours of surfaces.

PLAIN = {
    "soft": (0.96, 0.93, 0.88),
    "cavity": (0.10, 0.52, 0.55),
    "membrane": (0.80, 0.64, 0.40),
    "fibre": (0.62, 0.42, 0.08),
    "rigid": (0.16, 0.33, 0.72),
    "obstacle": (0.62, 0.65, 0.69),
    "line": LINE[0],
}
"""Red, green and blue [-] by the kind of surface, of what has no colour of its own."""

WALLS = frozenset(kind.name for kind in ACTUATOR_KINDS if kind.drawn == "walls")
"""Kinds of actuators whose effort the walls of cavities show."""
NAMES_MAP, MANY_MAP = "Set2", "turbo"
"""Maps of Matplotlib with the colours of bodies and materials, and of more than the first has colours."""
MAP_STEPS = 17
"""Colours that stand for a map of Matplotlib, with straight lines between them."""
SAMPLES = 40
"""Number of instants, at most, in which the range of a quantity is looked for."""
COVERED_SHARE = 0.995
"""Part of the values that the range covers: single elements at an edge would make all others look alike."""

NodeValues = Callable[[int], np.ndarray]
"""Gives the values at the nodes of all soft bodies in an instant, shape (node_count, material_count).

A node where materials meet has a value in each; NaN in those that it has no part in. Displacements have one column.
"""


def body_colours(scene: Scene) -> dict[str, np.ndarray]:
    """Red, green and blue [-], shape (3,), of each body or obstacle to which the scene gives a colour."""
    colours: dict[str, str | None] = {}
    for bodies in (scene.soft_bodies, scene.rigid_bodies, scene.obstacles):
        colours |= {name: body.colour for name, body in bodies.items()}
    return {name: np.array(red_green_blue(colour)) for name, colour in colours.items() if colour is not None}


class Colouring:
    """Gives every surface its colours.

    Attributes:
        scales: what the colours mean.
        values_scale: the scale of the values of soft bodies; None where they have plain colours.
    """

    def __init__(
        self, recording: Recording, style: Style, instants: Sequence[int], surfaces: Sequence[RecordedSurface]
    ):
        self._recording, self._surfaces = recording, surfaces
        own = body_colours(recording.scene)
        self._plain = {surface.name: own.get(surface.name, np.array(PLAIN[surface.kind])) for surface in surfaces}
        self.values_scale: ColourScale | None = None
        self._materials: dict[str, np.ndarray] = {}
        self._named: frozenset[str] = frozenset()
        if style.colour_by in NAMED:
            names, self._values = NAMED[style.colour_by](recording)
            steps = _steps(style.colour_map or NAMES_MAP, len(names))
            self.values_scale = ColourScale(style.colour_by, 0.0, len(names) - 1.0, steps, names=tuple(names))
            self._plain |= {
                name: np.array(step) for name, step in zip(names, steps, strict=True) if name in self._plain
            }
            self._named = frozenset(names)
        elif style.colour_by != "none":
            quantity, title = QUANTITIES[style.colour_by]
            self._values = quantity(recording)
            self.values_scale = self._range_of_values(title, instants, style)
        self._effort_scales: dict[str, ColourScale] = {}
        for kind in ACTUATOR_KINDS:
            wanted = style.cavity_pressure if kind.drawn == "walls" else style.cable_tension
            scale = _effort_scale(recording, kind, np.unique(instants)) if wanted else None
            if scale is not None:
                self._effort_scales[kind.name] = with_ranges(scale, style.ranges)
        # Of what opaque bodies hide there is no bar.
        are_walls_seen = style.section is not None or style.soft_opacity < 1.0
        shown = (scale for name, scale in self._effort_scales.items() if name not in WALLS or are_walls_seen)
        self.scales = (*((self.values_scale,) if self.values_scale is not None else ()), *shown)

    @property
    def ranges(self) -> dict[str, tuple[float, float, float]]:
        """Lowest and highest value of each scale, and the highest that was shown, by its title."""
        scales = [self.values_scale, *self._effort_scales.values()]
        return {scale.title: (scale.low, scale.high, scale.highest) for scale in scales if scale is not None}

    @property
    def unlit(self) -> dict[str, bool]:
        """Names of the surfaces whose colours stand for numbers, and whether their edges need lines: tubes are thin."""
        kinds = [kind for kind in ACTUATOR_KINDS if kind.name in self._effort_scales and kind.name in WALLS]
        names = {name for kind in kinds for name in self._recording.actuators.names_of(kind)}
        tubes = {
            one.name for one in self._surfaces if isinstance(one, LineTube) and one.actuator in self._effort_scales
        }
        names |= {one.name for one in self._surfaces if one.kind == "soft" and self.values_scale is not None}
        names |= {one.name for one in self._surfaces if one.name in self._named}
        return dict.fromkeys(names, True) | dict.fromkeys(tubes, False)

    def colours(self, instant: int) -> dict[str, np.ndarray]:
        """Red, green and blue [-] by surface, shape (3,), or of each of its vertices, shape (vertex_count, 3)."""
        colours = dict(self._plain)
        for kind in ACTUATOR_KINDS:
            scale = self._effort_scales.get(kind.name)
            if scale is not None and kind.drawn == "walls":
                efforts = self._recording.row(kind.effort.name, instant)
                colours |= zip(self._recording.actuators.names_of(kind), scale.colours(efforts), strict=True)
            elif scale is not None:
                along = self._recording.segment_efforts(kind, instant)
                for tube in self._surfaces:
                    if isinstance(tube, LineTube) and tube.actuator == kind.name:
                        colours[tube.name] = scale.colours(tube.at_vertices(along[tube.number]))
        return colours

    def values(self, instant: int) -> np.ndarray | None:
        """What `values_scale` shows at the nodes of all soft bodies, see `NodeValues`; None for plain colours."""
        return None if self.values_scale is None else self._values(instant)

    def at_corners(self, surface: RecordedSurface, values: np.ndarray) -> np.ndarray:
        """`values` at the corners of a soft body's triangles, see `at_corners`."""
        return at_corners(surface, values, self._materials_of(surface))

    def _materials_of(self, surface: RecordedSurface) -> np.ndarray | None:
        """The material behind each triangle of a body's own surface; None for a finer one."""
        body = next(body for body in self._recording.soft_bodies if body.name == surface.name)
        mapping = surface.mapping
        if mapping is None or mapping.nodes.shape[1] > 1 or len(np.unique(body.material)) == 1:
            return None
        if surface.name not in self._materials:
            triangles = mapping.nodes[:, 0][mapping.triangles] - body.nodes.start
            tetrahedra = body.tetrahedra
            faces = np.concatenate([triangles, *(np.delete(tetrahedra, corner, axis=1) for corner in range(4))])
            _, face = np.unique(np.sort(faces, axis=1), axis=0, return_inverse=True)
            of_face = np.zeros(face.max() + 1, dtype=int)
            of_face[face[len(triangles) :]] = np.tile(np.repeat(body.material, body.parts), 4)
            self._materials[surface.name] = of_face[face[: len(triangles)]]
        return self._materials[surface.name]

    def _range_of_values(self, title: str, instants: Sequence[int], style: Style) -> ColourScale:
        """A scale up to what 99.5 % of the values that are shown reach: at surfaces, or in all of the cut bodies."""
        soft = [surface for surface in self._surfaces if surface.kind == "soft"]
        samples = [self._values(instant) for instant in sample_instants(instants, SAMPLES)]
        if style.section is None:
            shown = [self.at_corners(surface, sample) for sample in samples for surface in soft]
        else:
            shown = [sample[np.isfinite(sample)] for sample in samples]
        shown = [some[some != 0.0] for some in shown]  # pressures of contacts are zero nearly everywhere
        highest = max((float(np.quantile(some, COVERED_SHARE)) for some in shown if len(some)), default=0.0)
        scale = ColourScale(title, 0.0, round_up(highest) if highest > 0 else 1.0, _steps(style.colour_map))
        scale = with_ranges(
            replace(scale, highest=max((float(np.max(some, initial=0.0)) for some in shown), default=0.0)), style.ranges
        )
        low, high = style.colour_range or (scale.low, scale.high)
        return replace(scale, low=low, high=high)


def _steps(colour_map: str, count: int = 0) -> Sequence[tuple[float, float, float]]:
    """Colours of evenly spaced values, or of a `count` of names: those of a map of Matplotlib, or our own."""
    if not colour_map:
        return SOFT
    from matplotlib import colormaps

    chosen = colormaps[colour_map if count <= colormaps[colour_map].N else MANY_MAP]
    is_list = count and chosen.N < 256  # of colours that were made for names
    places = np.arange(count) if is_list else np.linspace(0.0, 1.0, count or MAP_STEPS)
    return [(red, green, blue) for red, green, blue, _ in chosen(places)]


def at_corners(surface: RecordedSurface, values: np.ndarray, behind: np.ndarray | None = None) -> np.ndarray:
    """Values at the corners of a soft body's triangles, shape (3 * triangle_count,), of `NodeValues`.

    A triangle has the values of one material, since stress jumps where materials meet, and no mean of both is anywhere.

    Args:
        behind: number of the material behind each triangle, shape (triangle_count,); None where it is not known.
    """
    assert surface.mapping is not None
    weights, nodes = surface.mapping.weights[..., None], surface.mapping.nodes
    parts = np.where(weights > 0.0, weights * values[nodes], 0.0)  # without what is NaN in other materials
    corners = parts.sum(axis=1)[surface.triangles]
    material = np.isfinite(corners).all(axis=1).argmax(axis=1) if behind is None or values.shape[1] == 1 else behind
    of_one = np.take_along_axis(corners, material[:, None, None], axis=2)[..., 0]
    # A triangle of a finer surface may lie in several.
    return np.where(np.isfinite(of_one), of_one, np.nanmax(corners, axis=2)).ravel()


def merged_ranges(all_ranges: Sequence[Mapping[str, tuple[float, float, float]]]) -> dict[str, tuple[float, ...]]:
    """The `ranges` that hold for several recordings."""
    titles = dict.fromkeys(title for ranges in all_ranges for title in ranges)
    reach = {title: np.array([ranges[title] for ranges in all_ranges if title in ranges]) for title in titles}
    return {title: (float(ends[:, 0].min()), *map(float, ends[:, 1:].max(axis=0))) for title, ends in reach.items()}


def with_ranges(scale: ColourScale, ranges: Mapping[str, tuple[float, ...]]) -> ColourScale:
    """The scale with the ends that `merged_ranges` gives to its title, if it does."""
    low, high, highest = ranges.get(scale.title, (scale.low, scale.high, scale.highest))
    return replace(scale, low=low, high=high, highest=highest)


def displacements(recording: Recording) -> Callable[[int], np.ndarray]:
    """Gives the way of each node [mm], shape (node_count, 3), from its place if the bodies had kept their shape."""
    bodies = recording.soft_bodies
    carriers = recording.frames.numbers(recording.scene.soft_bodies[body.name].follows for body in bodies)

    def values(instant: int) -> np.ndarray:
        places = recording.frames.places(recording.row("frame_pose", instant))
        carried = [places.moved(body.rest_position, one) for body, one in zip(bodies, carriers, strict=True)]
        moved: np.ndarray = recording.row("position", instant) - np.vstack([np.zeros((0, 3)), *carried])
        return moved

    return values


def displacement(recording: Recording) -> NodeValues:
    """Distance of each node from its place if the bodies had moved with their frames and kept their shape [mm]."""
    ways = displacements(recording)
    return lambda instant: np.linalg.norm(ways(instant), axis=1, keepdims=True)


def stress(recording: Recording) -> NodeValues:
    """Von Mises stress at each node [kPa], see `nodal_mean`."""
    stresses = recorded_stress(recording)
    return lambda instant: _at_nodes(recording, map(von_mises, stresses(instant)))


def strain(recording: Recording) -> NodeValues:
    """Largest principal strain at each node [-], the stretch less one, see `nodal_mean`."""
    laws = [Stretches(body.rest_position, body.elements) for body in recording.soft_bodies]

    def values(instant: int) -> np.ndarray:
        position = recording.row("position", instant)
        bodies = zip(laws, recording.soft_bodies, strict=True)
        return _at_nodes(recording, (law.largest(position[body.nodes]) - 1.0 for law, body in bodies))

    return values


def contact_pressure(recording: Recording) -> NodeValues:
    """Pressure of contacts at each node [kPa], as the highest in `metrics.json`; 0 where nothing touches."""
    from taichisoft.control import ContactPatches
    from taichisoft_outputs.recording.resume import recorded_model

    model = recorded_model(recording, recording.scene)
    patches, bodies = ContactPatches(model), {body.name: body for body in model.soft_bodies}

    def values(instant: int) -> np.ndarray:
        pressure = np.zeros((model.node_count, 1))
        for patch in patches.patches(recording.contact_state(instant)).values():
            body = bodies[patch.body]
            vertices = body.surface.triangles[patch.triangles]
            nodes, weights = body.surface.nodes[vertices] + body.nodes.start, body.surface.weights[vertices]
            at_nodes = np.where(weights > 0.0, patch.pressures[..., None], 0.0)
            np.maximum.at(pressure[:, 0], nodes.ravel(), at_nodes.ravel())
        return pressure

    return values


def _at_nodes(recording: Recording, of_bodies: Iterable[np.ndarray]) -> np.ndarray:
    """`NodeValues` of those of the tetrahedra of each body."""
    bodies = recording.soft_bodies
    values = np.full((sum(len(body.rest_position) for body in bodies), len(recording.materials)), np.nan)
    for body, of_body in zip(bodies, of_bodies, strict=True):
        material = np.repeat(body.material, body.parts)
        for number in np.unique(material):
            own = material == number
            values[body.nodes, number] = nodal_mean(of_body[own], body.tetrahedra[own], body.rest_position)
    return values


def bodies(recording: Recording) -> tuple[list[str], NodeValues]:
    """Names of the bodies and obstacles, and the number of that of each node."""
    values = np.repeat(np.arange(len(recording.soft_bodies)), [len(one.mesh_nodes) for one in recording.soft_bodies])
    solid = (surface.name for surface in recording.surfaces if surface.kind in ("rigid", "obstacle"))
    return [*recording.scene.soft_bodies, *solid], lambda instant: values[:, None]


def materials(recording: Recording) -> tuple[list[str], NodeValues]:
    """Names of the materials, by their numbers where they have none, and the number of that of each node."""
    labels = [
        one.material.name if one.material else f"{one.law or body.law}, E {young:g} kPa, nu {ratio:g}"
        for body in recording.scene.soft_bodies.values()
        for one, young, ratio in zip(body.materials, body.young_moduli, body.poisson_ratios, strict=True)
    ]
    names = list(dict.fromkeys(labels))
    number = np.array([float(names.index(label)) for label in labels])
    values = _at_nodes(recording, (number[np.repeat(body.material, body.parts)] for body in recording.soft_bodies))
    return names, lambda instant: values


NAMED = {"body": bodies, "material": materials}

QUANTITIES = {
    "displacement": (displacement, "displacement [mm]"),
    "stress": (stress, "von Mises stress [kPa]"),
    "strain": (strain, "largest strain [-]"),
    "contact": (contact_pressure, "contact pressure [kPa]"),
}


def _effort_scale(recording: Recording, kind: ActuatorKind, instants: np.ndarray) -> ColourScale | None:
    """The scale of the efforts of a kind; None where it has no actuators, or no effort but zero."""
    if not recording.actuators.names_of(kind):
        return None
    if kind.drawn == "walls":
        return effort_scale(kind, recording.column(kind.effort.name)[instants])
    return effort_scale(kind, np.concatenate(recording.segment_efforts(kind, instants), axis=1))
