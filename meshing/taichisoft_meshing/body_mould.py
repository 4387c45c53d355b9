"""The mould of a body between any closed surfaces, made of its facets by solid booleans.

A body is cast at once, or in two castings that are glued in a plane through its chambers. Of all directions that suit
it those are taken in which nothing is undercut, no core is lost, and the fewest parts are needed. A core hangs on the
lid where it can be drawn out; else it is lost: it is melted or dissolved, and leaves through the hole of its pin.
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from manifold3d import CrossSection, Manifold, OpType
from scipy.spatial.transform import Rotation

from taichisoft.errors import MeshError
from taichisoft.mesh import write_stl
from taichisoft_meshing.closed_shells import NEAR, Shell, area_vectors
from taichisoft_meshing.mould_check import TOUCH, Solid, solid_of

CLEARANCE = 0.15
"""Gap around pegs and pins, so that printed parts go together [mm]."""
POUR, VENT = 4.0, 1.0
"""Largest radius of the hole that silicone is poured through, and of those that air leaves through [mm]."""
THICKEST_PEG, PIN, LEAST_PIN = 2.0, 1.5, 0.5
"""Largest radius of a peg, and of the pin of a lost core, and the least of a pin [mm]."""
FOLDS = 12
"""Times that facets which would fold when they are moved are moved by half."""
BEYOND = 1.0
"""Length by which a core reaches into the outside of a casting through its chamber's mouth [mm]."""
GRID = 40
"""Lines along the longest side of what is looked at for undercuts."""
CLEAN = 1e-3
"""Largest share of a solid's volume that may be trapped beside it: lines hit edges [-]."""
FLAT, LEAST_END = 0.02, 10.0
"""An end is flat, for a lid or to be poured at, if so far below it [mm] the section is so large [mm^2]."""
ROUGH = 1e-3
"""Length by which surfaces may be simplified [mm]."""
ALIKE = 0.01
"""Faces at a vertex that differ less, as the ratio of two eigenvalues, are one face that is rough or curved [-]."""
ALONG = 0.999
"""Least cosine between directions that count as one [-]."""
X, Y, Z = np.eye(3)
TO_Y, TO_MINUS_Y = np.array([Z, X, Y]), np.array([X, Z, -Y])
"""Frames whose third axes are y and -y."""


@dataclass(frozen=True)
class Casting:
    """One pour, in axes of its own: its lid comes off along z, and halves of its outside along y.

    Attributes:
        name: part of the names of its files.
        frame: unit vectors along its axes, shape (3, 3).
        filled: the body, or its part, without chambers.
        hanging: the chambers whose cores hang on the lid.
        lost: those whose cores are lost.
        parting: plane y that parts the outside in halves [mm]; None where it comes off as a whole.
        trapped: volume of air that holds outer parts [mm^3].
    """

    name: str
    frame: np.ndarray
    filled: Solid
    hanging: tuple[Solid, ...]
    lost: tuple[Solid, ...] = ()
    parting: float | None = None
    trapped: float = 0.0

    @property
    def top(self) -> float:
        """Its upper end [mm]."""
        return float(_bounds(self.filled)[1][2])

    @property
    def is_flat(self) -> bool:
        """Whether its end along z is flat."""
        return bool(self.filled.slice(self.top - FLAT).area() > LEAST_END)


# How a body is cast: of all directions and ways those with the least undercut, lost cores and parts.


@dataclass(frozen=True)
class PartingPlane:
    """How outer parts shall come off.

    Attributes:
        way: unit vector, shape (3,).
        position: of the parting plane along it [mm], if it matters.
    """

    way: np.ndarray
    position: float | None

    def plane(self, axis: np.ndarray) -> float | None:
        """Position of the plane along an axis, which may point the other way [mm]."""
        return None if self.position is None else self.position * float(self.way @ axis)


def parse_parting(text: str | None, vertices: np.ndarray) -> PartingPlane | None:
    """The direction and position that are asked for, "z", "z=0" or "0,1,2=5", of a body with these vertices [mm]."""
    if text is None:
        return None
    name, given, number = text.replace(" ", "").lower().partition("=")
    try:
        position = float(number) if given else None
        way = np.eye(3)["xyz".index(name)] if len(name) == 1 else np.array([float(part) for part in name.split(",")])
        if way.shape != (3,) or not 0.0 < (length := float(np.linalg.norm(way))) < math.inf:
            raise ValueError(name)
        way = way / length
    except ValueError as error:
        wanted = "an axis or a direction, and perhaps a position in mm, such as z, z=0 or 0,1,2=5"
        raise MeshError(f"--parting {text}: must be {wanted}") from error
    ends = np.array([(vertices @ way).min(), (vertices @ way).max()]) + 0.0
    if position is not None and not ends[0] < position < ends[1]:
        raise MeshError(
            f"--parting {text}: misses the body, which reaches from {ends[0]:g} to {ends[1]:g} along {name}"
        )
    return PartingPlane(way, position)


def plan_castings(body: Sequence[Shell], wanted: PartingPlane | None, whole: bool = False) -> list[list[Casting]]:
    """The ways to cast a body, each of one or two castings, that trap the least air; the best first.

    Args:
        body: its outside, then its closed chambers.
        wanted: how its outer parts come off; None: as is best.
        whole: whether it must be cast in one.
    """
    outer, *voids = (solid_of(shell.vertices, shell.triangles) for shell in body)
    frames = _frames(outer, wanted)
    open_to = [_pockets(_turned(outer, frame)) for frame in frames]
    filled, chambers = [outer, *voids], list(voids)
    for frame, pockets in zip(frames, open_to, strict=True):
        filled += [_turned(pocket, frame.T) for pocket in pockets]
        chambers += [_turned(pocket + _mouth(pocket, BEYOND), frame.T) for pocket in pockets]
    choices = []
    for number, (frame, pockets) in enumerate(zip(frames, open_to, strict=True)):
        hanging = tuple(its for its in pockets if _is_clean(its, _trapped(its, _bounds(its)[1][2])[1]))
        lost = [its for its in pockets if its not in hanging] + [_turned(its, frame) for its in voids]
        all_filled = _union([_turned(outer, frame), *pockets, *lost])
        ways = [[casting] for casting in _partings(Casting("mould", frame, all_filled, hanging, tuple(lost)), wanted)]
        if chambers and not whole and frame[2].sum() >= 0:
            ways += _in_two(_union(filled), chambers, frame, wanted)
        for castings in ways:
            cost = (
                round(sum(casting.trapped for casting in castings) / outer.volume(), 3),
                any(casting.lost for casting in castings),
                len(castings),
                sum(casting.parting is not None for casting in castings),
                sum(not casting.is_flat for casting in castings),
                number,
            )
            choices.append((cost, castings))
    choices.sort(key=lambda choice: choice[0])
    return [castings for cost, castings in choices if cost[0] == choices[0][0][0]]


def _frames(outer: Solid, wanted: PartingPlane | None) -> list[np.ndarray]:
    """Axes that may suit a body, both ways along each: those of the file, its principal ones and normals of large flat
    faces, or the wanted one and those across it."""
    if wanted is not None:
        axes = [wanted.way, *np.linalg.svd(wanted.way[None])[2][1:]]
    else:
        vertices, triangles = _arrays(outer)
        vectors = area_vectors(vertices[triangles])
        rounded = np.round(vectors / np.linalg.norm(vectors, axis=1)[:, None], 2)
        _, which = np.unique(rounded, axis=0, return_inverse=True)
        normals = np.stack([np.bincount(which.ravel(), component) for component in vectors.T], axis=1)
        largest = normals[np.argsort(-np.linalg.norm(normals, axis=1))[:4]]
        axes = [*np.eye(3), *np.linalg.svd(vertices - vertices.mean(axis=0), full_matrices=False)[2], *largest]
    kept: list[np.ndarray] = []
    for axis in axes:
        axis = axis / np.linalg.norm(axis)
        if all(abs(axis @ other) < 0.999 for other in kept):
            kept.append(axis)
    frames = []
    for axis in [*kept, *(-axis for axis in kept)]:
        side = min(kept, key=lambda other: round(abs(float(axis @ other)), 3))
        side = side - (side @ axis) * axis
        side /= np.linalg.norm(side)
        frames.append(np.array([np.cross(side, axis), side, axis]) + 0.0)
    return frames


def _in_two(
    filled: Solid, chambers: Sequence[Solid], frame: np.ndarray, wanted: PartingPlane | None
) -> list[list[Casting]]:
    """Two castings with lids along z of a frame, in a plane that parts all chambers; none where it cannot be.

    Args:
        filled: the body without chambers, in its own axes.
        chambers: what the cores fill, in its own axes.
        frame: unit vectors, shape (3, 3).
        wanted: how outer parts come off.
    """
    filled, *chambers = (_turned(solid, frame) for solid in (filled, *chambers))
    at = wanted.plane(frame[2]) if wanted is not None and abs(wanted.way @ frame[2]) > ALONG else None
    plane, held = _trapped(_union(chambers), at, at_ends=True)
    lower, upper = (ends[2] for ends in _bounds(filled))
    if not (lower + TOUCH < plane < upper - TOUCH and _is_clean(_union(chambers), held)):
        return []
    halves = []
    for name, sense in (("lower", 1.0), ("upper", -1.0)):
        turn = np.diag([1.0, sense, sense])
        turned = (_level(_turned(solid, turn), Z, sense * plane) for solid in (filled, *chambers))
        half, *cores = (_without_slivers(its.trim_by_plane((0, 0, -1), -sense * plane)) for its in turned)
        hanging = tuple(core for core in cores if not core.is_empty())
        ways = _partings(Casting(name, turn @ frame, half, hanging), wanted)
        halves.append(min(ways, key=lambda its: (round(its.trapped, 1), its.parting is not None), default=None))
    return [[its for its in halves if its is not None]] if all(halves) else []


def _mouth(pocket: Solid, length: float) -> Solid:
    """What continues a pocket beyond its mouth, at its upper end, so far [mm]."""
    top = _bounds(pocket)[1][2]
    return pocket.slice(top - 1e-9).extrude(length).translate((0, 0, top))


def _pockets(outer: Solid) -> list[Solid]:
    """The chambers that open to the upper end alone, or to both ends, as if flat lids lay on both."""
    lower, upper = _bounds(outer)
    outer = _level(_level(outer, Z, lower[2]), Z, upper[2])
    grown = np.array([1.0, 1.0, 0.0])
    air = (_box(lower - grown, upper + grown) - outer).decompose()
    limits = np.array([*(lower[:2] - 0.5), -math.inf, *(-upper[:2] - 0.5), upper[2] - 1e-6])
    ends = (np.array(piece.bounding_box()) * [1, 1, 1, -1, -1, 1] for piece in air)
    return [its for its, at in zip(air, ends, strict=True) if (at > limits).all() and its.volume() > CLEAN]


def _partings(whole: Casting, wanted: PartingPlane | None) -> Iterator[Casting]:
    """The ways in which the outside may come off: as a whole, or in halves in four directions across z."""
    if whole.is_flat and (wanted is None or abs(wanted.way @ whole.frame[2]) > ALONG):
        yield replace(whole, trapped=_trapped(whole.filled, whole.top)[1])
    elif whole.hanging:
        return
    for angle in (0.0, 90.0, 45.0, 135.0):
        turn = Rotation.from_euler("z", -angle, degrees=True).as_matrix().round(15)
        frame = turn @ whole.frame
        if wanted is not None and abs(wanted.way @ frame[1]) < ALONG:
            continue
        filled, *cores = (_turned(solid, turn) for solid in (whole.filled, *whole.hanging, *whole.lost))
        plane, held = _trapped(_turned(filled, TO_Y), None if wanted is None else wanted.plane(frame[1]))
        count = len(whole.hanging)
        yield Casting(whole.name, frame, filled, tuple(cores[:count]), tuple(cores[count:]), plane, held)


def _trapped(solid: Solid, plane: float | None = None, at_ends: bool = False) -> tuple[float, float]:
    """The plane across z that traps the least air [mm], and how much [mm^3]: between it and the solid, and between
    parts of the solid.

    Args:
        solid: what is looked through along z.
        plane: the plane, if it is given [mm].
        at_ends: whether it lies at an end of the solid rather than between the ends, where both are as good.
    """
    lower, upper = _bounds(solid)
    spacing = np.minimum((upper - lower)[:2].max() / GRID, (upper - lower)[:2] / 4)
    ends, between = [], 0.0
    for x, y in itertools.product(*(np.arange(lower[n] + 0.317 * spacing[n], upper[n], spacing[n]) for n in (0, 1))):
        heights = [hit.position[2] for hit in solid.ray_cast((x, y, lower[2] - 1), (x, y, upper[2] + 1))]
        if heights:
            ends.append((heights[0], heights[-1]))
            gaps = (high - low for low, high in zip(heights[1:-1:2], heights[2::2], strict=True))
            between += sum(gap for gap in gaps if gap > TOUCH)
    begin, end = np.array(ends).T
    if plane is None:
        low, high = np.sort(np.concatenate([begin, end]))[len(begin) - 1 : len(begin) + 1].tolist()
        low, high = (lower[2] if low < lower[2] + TOUCH else low), (upper[2] if high > upper[2] - TOUCH else high)
        at_end = [value for value, edge in ((high, upper[2]), (low, lower[2])) if value == edge]
        middle = round(float(lower[2] + upper[2]) / 2, 3) + 0.0
        plane = middle if low - TOUCH < middle < high + TOUCH else (low + high) / 2
        plane = at_end[0] if at_end and (at_ends or high - low < POUR) else plane
    beside = np.maximum(begin - plane, plane - end)
    return plane, float((between + beside[beside > 2 * TOUCH].sum()) * spacing.prod())


def _is_clean(solid: Solid, trapped: float) -> bool:
    return bool(trapped <= CLEAN * solid.volume())


# The parts of a casting.


def write_casting(casting: Casting, folder: Path, stem: str, wall: float, draft: float) -> dict[str, Any]:
    """Write STEM-NAME-PART.stl for every part of a casting, the silicone included.

    Args:
        casting: what is cast.
        folder: where the files go.
        stem: name of the body.
        wall: thickness of the parts around the silicone [mm].
        draft: angle by which faces along the direction of a part lean [degrees].

    Returns:
        What the check needs to know, for `mould.json`.
    """
    top, flat, parting = casting.top, casting.is_flat, casting.parting
    has_lid = flat and bool(casting.hanging or casting.lost)
    slope = math.tan(math.radians(draft))
    solids = [casting.filled, *casting.hanging, *casting.lost]
    for axis, plane in ((Z, top), (Y, parting)):
        solids = solids if plane is None else [_level(solid, axis, plane) for solid in solids]
    filled, *chambers = solids
    hanging = [_leaning(core, Z, top, slope) for core in chambers[: len(casting.hanging)]]
    axis, plane = (Z, top) if parting is None else (Y, parting)
    filled, *lost = (
        _leaning(solid, axis, plane, slope, top if flat else None) for solid in (filled, *chambers[len(hanging) :])
    )
    lower, upper = _bounds(casting.filled)
    lower, upper = lower - wall, upper + wall * np.array([1.0, 1.0, not flat])
    block, slab = _box(lower, upper), _box(np.array([*lower[:2], top]), upper + wall * Z)
    sides = [np.eye(3)] * has_lid + [TO_Y, TO_MINUS_Y] * (parting is not None)
    inner, pins, sockets = _union([*hanging, *lost]), Manifold(), Manifold()
    for number, core in enumerate(lost):
        others = _union([*hanging, *lost[:number], *lost[number + 1 :]])
        pin, socket = _pin(core, filled, others, casting, sides, wall)
        lost[number], pins, sockets = core + pin, pins + pin, sockets + socket
    silicone = filled - inner - pins
    outside = block - filled - inner - sockets
    cast, lid, whole = silicone, Manifold(), block.volume()
    x, y, z = zip(lower + wall / 2, upper - wall / 2, strict=True)  # in the middle of the walls
    pegs, holes = _pegs(np.eye(3), [(*place, top) for place in itertools.product(x, y)] if has_lid else [], wall)
    outside += pegs
    if has_lid:
        bores = _union(list(_bores(silicone.slice(top - FLAT) - sockets.project().offset(VENT), top, wall)))
        lid = slab + _union(hanging) - sockets - bores - holes
        cast, whole = silicone + bores, whole + slab.volume()
    elif not flat and parting is not None:
        cast = silicone + (_sprue(filled, parting, upper[2]) - inner - sockets)
        outside -= cast
    gaps = sockets - filled - pins + (holes - pegs)
    parts: dict[str, tuple[Solid, np.ndarray | None]] = {"lid": (lid, Z)} if has_lid else {}
    if parting is not None:
        pegs, holes = _pegs(TO_Y, [(a, parting, c) for a, c in itertools.product(x, z)], wall)
        plus, minus = outside.split_by_plane((0, 1, 0), parting)
        parts["plus"], outside, gaps = (plus - holes, Y), minus + pegs, gaps + (holes - pegs)
    parts |= {f"core-{number}": (core, None) for number, core in enumerate(lost, 1)}
    parts["cast"] = cast, axis
    parts["minus" if parting is not None else "box" if has_lid else "tray"] = outside, None
    files = []
    for name, (solid, way) in parts.items():
        file = f"{stem}-{casting.name}-{name}.stl"
        vertices, triangles = _arrays(_without_slivers(solid.simplify(ROUGH / 5)))
        write_stl(vertices @ casting.frame, triangles, folder / file)
        comes_off = None if way is None else (way @ casting.frame + 0.0).tolist()
        files.append({"file": file, "part": name, "comes_off": comes_off, "lost": name.startswith("core-")})
    sprues = cast.volume() - silicone.volume()
    what = f"the {casting.name}, {sprues / 1000:.2f} cm^3 of it in holes"
    return {
        "name": f"{stem}-{casting.name}",
        "parts": files,
        "silicone": "cast",
        "block_mm3": whole,
        "clearance_mm3": gaps.volume(),
        "body_mm3": silicone.volume(),
        "sprues_beyond": [*casting.frame[2].tolist(), top] if has_lid else None,
        "pours": [{"what": what, "silicone": "soft", "mm3": cast.volume()}],
    }


def _leaning(solid: Solid, way: np.ndarray, plane: float, slope: float, flat_end: float | None = None) -> Solid:
    """A solid whose faces along a direction lean inward, away from a plane across it, where its section stays.

    The outline of every other section is drawn in by `slope` times its distance from the plane, but less where faces
    lie across the direction, from 45 degrees on not at all, and where facets would fold.

    Args:
        solid: what is drawn along `way`, an axis, or what is drawn off it.
        way: unit vector, shape (3,).
        plane: position of the plane along it [mm].
        slope: tangent of the angle [-].
        flat_end: height z of a flat end that stays, since something else lies on it [mm].
    """
    if not slope:
        return solid
    pieces = []
    for piece in _parted(solid.simplify(ROUGH), way, plane):
        vertices, triangles = _arrays(piece)
        normals = area_vectors(vertices[triangles])
        areas = np.linalg.norm(normals, axis=1)
        across = (normals / np.maximum(areas, 1e-30)[:, None]) @ np.eye(3)[way == 0].T
        inward = slope * np.abs(vertices @ way - plane)
        moves = areas * np.maximum(1 - 2 * (1 - (across**2).sum(axis=1)), 0.0)
        matrix, right = np.zeros((len(vertices), 2, 2)), np.zeros((len(vertices), 2))
        for corner in triangles.T:
            np.add.at(matrix, corner, areas[:, None, None] * across[:, :, None] * across[:, None, :])
            np.add.at(right, corner, -(moves * inward[corner])[:, None] * across)
        moved = np.zeros(vertices.shape)
        moved[:, way == 0] = np.einsum("nij,nj->ni", np.linalg.pinv(matrix, ALIKE, hermitian=True), right)
        if flat_end is not None:
            moved[np.abs(vertices[:, 2] - flat_end) < ROUGH, 2] = 0.0
        for _ in range(FOLDS):
            turned = np.einsum("nd,nd->n", area_vectors((vertices + moved)[triangles]), normals) < 0.1 * areas**2
            moved[triangles[turned]] /= 2
        vertices += moved
        pieces.append(solid_of(vertices, triangles))
    return _union(pieces)


def _parted(solid: Solid, way: np.ndarray, plane: float) -> Sequence[Solid]:
    """The parts of a solid on both sides of a plane; itself where the plane lies at one of its ends."""
    heights = _arrays(solid)[0] @ way
    is_inside = heights.min() + TOUCH < plane < heights.max() - TOUCH
    return solid.split_by_plane(tuple(way), plane) if is_inside else (solid,)


def _pin(
    core: Solid, filled: Solid, others: Solid, casting: Casting, sides: Sequence[np.ndarray], wall: float
) -> tuple[Solid, Solid]:
    """What holds a lost core in the outer parts, and the space for it: its mouth goes on in the lid, or a round pin
    goes the shortest way along z of one of the frames `sides`."""
    top = float(_bounds(filled)[1][2])
    mouth = core.slice(top - 1e-6)
    if casting.is_flat and mouth.area() > 0:
        socket = mouth.offset(CLEARANCE).extrude(wall / 2 + CLEARANCE)
        return mouth.extrude(wall / 2).translate((0, 0, top)), socket.translate((0, 0, top))
    pins = []
    for frame in sides:
        turned = _turned(core, frame)
        high, end = float(_bounds(turned)[1][2]), float(_bounds(_turned(filled, frame))[1][2])
        for depth in (0.1, 0.3, 1.0, 2.0, 4.0):
            place, widest = _widest(turned.slice(high - depth))
            radius, long = min(0.7 * widest, PIN), end + wall / 2 - high + depth
            if radius < LEAST_PIN:
                continue
            pin, socket = (
                _turned(Manifold.cylinder(length, r, r, 32).translate((*place, high - depth)), frame.T)
                for length, r in ((long, radius), (long + CLEARANCE, radius + CLEARANCE))
            )
            if (pin ^ others).is_empty():
                pins.append(((pin ^ (filled - core)).volume(), pin, socket))
            break
    if not pins:
        middle = ", ".join(f"{value:.1f}" for value in np.mean(_bounds(core), axis=0) @ casting.frame + 0.0)
        raise MeshError(
            f"the lost core of the chamber around ({middle}) mm cannot be held: no pin of {2 * LEAST_PIN:g} mm reaches "
            "it; give the chamber a bore"
        )
    return min(pins, key=lambda pin: pin[0])[1:]


def _bores(section: Any, top: float, wall: float) -> Iterator[Solid]:
    """Holes through a lid over the silicone: one to pour, where it is widest, and two for air, away from it."""
    for largest, least in ((POUR, 1.5 * VENT), (VENT, VENT), (VENT, VENT)):
        place, radius = _widest(section)
        radius = min(0.7 * radius, largest)
        if radius < 0.7 * least:
            return
        yield Manifold.cylinder(wall, radius, 0.9 * radius, 32).translate((*place, top))
        x0, y0, x1, y1 = section.bounds()
        section -= CrossSection.circle(max(x1 - x0, y1 - y0) / 3).translate(place)


def _widest(section: Any) -> tuple[tuple[float, float], float]:
    """Middle and radius of the largest circle in a section [mm]."""
    low, high, place = 0.0, 1e3, (0.0, 0.0)
    for _ in range(30):
        radius = (low + high) / 2 if low else high / 4
        left = section.offset(-radius)
        if left.is_empty():
            high = radius
        else:
            corners = left.to_polygons()[0]
            middle = np.linalg.norm(corners - corners.mean(axis=0), axis=1).argmin()  # that of a ring is not inside
            low, place = radius, tuple(corners[middle].tolist())
    return place, low


def _sprue(filled: Solid, parting: float, above: float) -> Solid:
    """A hole to pour through, from the highest place in the parting plane up to a height [mm]."""
    turned = _turned(filled, TO_Y)
    ends = turned.bounding_box()[2::3]
    section = turned.slice(min(max(parting, ends[0] + FLAT), ends[1] - FLAT))  # the plane may lie at an end
    points = np.concatenate(section.to_polygons())
    z, x = points[np.argmax(points[:, 0])].tolist()
    inside = z - 2 * VENT
    return Manifold.cylinder(above - inside, 2 * VENT, POUR, 32).translate((x, parting, inside))


def _pegs(frame: np.ndarray, places: Sequence[Sequence[float]], wall: float) -> tuple[Solid, Solid]:
    """Pegs along z of a frame at places [mm], and the holes for them, as long as the wall."""
    radius, tall = min(wall / 4, THICKEST_PEG), min(wall - 1.0, 4 * THICKEST_PEG)
    sizes = ((tall, radius), (wall, radius + CLEARANCE))
    pegs, holes = (
        _union([_turned(Manifold.cylinder(length, r, r, 32).translate(frame @ place), frame.T) for place in places])
        for length, r in sizes
    )
    return pegs, holes


# Solids.


def _box(lower: np.ndarray, upper: np.ndarray) -> Solid:
    return Manifold.hull_points(list(itertools.product(*zip(lower, upper, strict=True))))  # exact, unlike a moved cube


def _union(solids: Sequence[Solid]) -> Solid:
    return Manifold.batch_boolean(list(solids), OpType.Add)


def _without_slivers(solid: Solid) -> Solid:
    """A solid without flat leftovers of booleans."""
    return Manifold.compose([its for its in solid.decompose() if abs(its.volume()) > CLEAN])  # a void's is negative


def _turned(solid: Solid, frame: np.ndarray) -> Solid:
    """A solid in the axes of a frame, whose rows they are, shape (3, 3)."""
    return solid.transform(np.column_stack([frame, np.zeros(3)]))


def _level(solid: Solid, way: np.ndarray, plane: float) -> Solid:
    """A solid whose vertices near a plane across an axis lie in it, so that no sliver is left between both."""
    vertices, triangles = _arrays(solid)
    near = np.abs(vertices @ way - plane) < NEAR * np.ptp(vertices)
    vertices[near[:, None] & (way != 0)] = plane
    return solid_of(vertices, triangles)


def _bounds(solid: Solid) -> tuple[np.ndarray, np.ndarray]:
    """Least and largest coordinates [mm], shape (3,) each."""
    lower, upper = np.reshape(solid.bounding_box(), (2, 3))
    return lower, upper


def _arrays(solid: Solid) -> tuple[np.ndarray, np.ndarray]:
    """Vertices [mm], shape (vertex_count, 3), and triangles, shape (triangle_count, 3)."""
    mesh = solid.to_mesh64()
    return np.array(mesh.vert_properties)[:, :3], np.array(mesh.tri_verts, dtype=np.int64)
