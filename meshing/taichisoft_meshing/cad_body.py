"""The body of a STEP file as it is drawn: its solids and faces with their numbers, its cavities and its openings."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from taichisoft.base import SIZE, implausible, warn_caller
from taichisoft.errors import MeshError
from taichisoft.mesh import VolumeMesh, enclosed_volume, joined_pieces, require_suffix
from taichisoft_meshing.body_tables import PRESETS
from taichisoft_meshing.closed_shells import NEAR, area_vectors, diagonal, facing_sides
from taichisoft_meshing.geometry_file import STEP_SUFFIXES
from taichisoft_meshing.gmsh_session import SILICONE, SURFACE_ALGORITHMS, TRIANGLE, numbered, successes
from taichisoft_meshing.wall_quality import winding_numbers

# Caps: triangles over the opening of a surface, whose corners are nodes of its rim.


def with_caps(mesh: VolumeMesh, cavity: str) -> VolumeMesh:
    """The mesh, with a cavity that is open to the outside, and the outside, closed by the same flat or ruled caps.

    The caps belong to no tetrahedron: the air's pressure on them acts at the nodes of the rim, as that of a plug that
    is glued in, and they neither stiffen the rim nor weigh anything.
    """
    wall, outer = mesh.surface_groups[cavity], mesh.surface_groups["outer"]
    sides = wall[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    inner = {tuple(side) for side in sides.tolist()}
    rim = np.array([(end, begin) for begin, end in sides.tolist() if (end, begin) not in inner], dtype=np.int32)
    caps = []
    for loop in rims(rim):
        try:
            caps.append(np.array(loop, dtype=np.int32)[cap_triangles(mesh.nodes[loop])])
        except ValueError as error:
            raise MeshError(f"{mesh.source}: {cavity}: {error}") from error
    groups = {"outer": np.concatenate([outer, *caps]), cavity: np.concatenate([wall, *caps])}
    return replace(mesh, surface_groups={**mesh.surface_groups, **groups})


def rims(edges: np.ndarray) -> list[list[int]]:
    """Closed loops of directed edges, shape (edge_count, 2), each as the nodes that it passes.

    Loops that touch in a node are parted there, and edges of no loop are left out.
    """
    following: dict[int, list[int]] = {}
    for begin, end in edges.tolist():
        following.setdefault(begin, []).append(end)
    loops = []
    for start in list(following):
        path = [start]
        while path:
            if not following.get(path[-1]):
                path.pop()  # the end of the loops through it, or of an edge of none
                continue
            node = following[path[-1]].pop()
            if node in path:
                at = path.index(node)
                loops.append(path[at:])
                del path[at + 1 :]
            else:
                path.append(node)
    return loops


def cap_triangles(rim: np.ndarray) -> np.ndarray:
    """Triangles between the corners of a polygon, which keep its sense: ears with the shortest sides are cut first.

    Args:
        rim: corners, flat or nearly so [mm], shape (count, 3).

    Returns:
        Indices of corners, shape (count - 2, 3).
    """
    middle = rim - rim.mean(axis=0)
    normal = np.cross(middle, np.roll(middle, -1, axis=0)).sum(axis=0)
    across = np.linalg.svd(normal[None])[2][1:]
    flat = middle @ across.T
    if np.dot(np.cross(across[0], across[1]), normal) < 0:
        flat = flat[:, ::-1]
    least = 1e-9 * np.ptp(flat, axis=0).max() ** 2
    ring, triangles = list(range(len(rim))), []
    while len(ring) > 2:
        ears = []
        for place, corner in enumerate(ring):
            before, after = ring[place - 1], ring[(place + 1) % len(ring)]
            ear = flat[[before, corner, after]]
            others = flat[[other for other in ring if other not in (before, corner, after)]]
            sides = np.roll(ear, -1, axis=0) - ear
            if sides[0, 0] * sides[1, 1] - sides[0, 1] * sides[1, 0] <= least:
                continue
            away = others[:, None] - ear
            left = sides[:, 0] * away[..., 1] - sides[:, 1] * away[..., 0]
            if not (left >= -least).all(axis=1).any():
                ears.append((round(float(np.linalg.norm(ear[2] - ear[0])), 9), place, (before, corner, after)))
        if not ears:
            raise ValueError("the rim of its opening crosses itself, so that no cap closes it")
        _, place, chosen = min(ears)
        triangles.append(chosen)
        del ring[place]
    return np.array(triangles, dtype=np.int32)


INWARD = 0.05
"""Distance of the points of a cap that must lie in air from its rim, as a share of its triangles' height [-]."""
AIR = 0.25
"""Largest winding number of the body around a point in air [-]: 0, 1/2 on its surface, 1 in silicone."""
PLACES = 8  # points of a rim that are tried


@dataclass(frozen=True, eq=False)
class Opening:
    """A chamber that is open to the outside.

    Attributes:
        faces: numbers of the faces behind its rim.
        beside: number of a face outside of its rim.
        centre: middle of the rim [mm], shape (3,).
        area: area of the cap over it [mm^2].
        volume: volume behind the cap [mm^3], of a coarse triangulation.
    """

    faces: frozenset[int]
    beside: int
    centre: np.ndarray
    area: float
    volume: float

    def __str__(self) -> str:
        place = ", ".join(f"{value:.4g}" for value in np.round(self.centre, 3) + 0.0)
        return f"{self.area:.4g} mm^2 wide in face {self.beside} around [{place}] mm"


def find_openings(
    nodes: np.ndarray, triangles: np.ndarray, face_of: np.ndarray, regions: Mapping[int, int]
) -> tuple[Opening, ...]:
    """Find the rims of chambers in the outside of a body, the chambers of largest volume first.

    A rim is a loop of edges around a hole in a flat or curved region, which parts the surface in two, and whose cap
    lies in air. So holes that lead through the body have none, and neither have studs. A rim behind another is none.

    Args:
        nodes: positions [mm], shape (node_count, 3).
        triangles: of the outside, outward, shape (triangle_count, 3); face_of: face of each, shape (triangle_count,).
        regions: the number of each face's region, the same for flat faces that continue each other.
    """
    sides = facing_sides(triangles)
    region = np.array([regions[face] for face in face_of.tolist()])[sides // 3]
    openings: dict[frozenset[int], Opening] = {}  # two regions may have the same rim
    for number in np.unique(region[region[:, 0] != region[:, 1]]).tolist():
        border = np.flatnonzero((region == number).sum(axis=1) == 1)
        side = np.where(region[border, 0] == number, *sides[border].T)
        loops = rims(triangles.ravel()[np.column_stack([side, side - side % 3 + (side + 1) % 3])])
        for loop in sorted(loops, key=lambda loop: diagonal(nodes[loop]))[:-1]:
            cap = _cap(nodes, triangles, loop)
            parts = [] if cap is None else _parted(triangles, sides, loop)
            if cap is not None and parts:
                behind = min(parts, key=lambda part: diagonal(nodes[triangles[part].ravel()]))
                opening = _opening(nodes, triangles, face_of, behind, cap)
                openings.setdefault(opening.faces, opening)
    outermost = [
        opening for opening in openings.values() if not any(opening.faces < other.faces for other in openings.values())
    ]
    return tuple(sorted(outermost, key=lambda opening: (-float(f"{opening.volume:.2g}"), min(opening.faces))))


def _parted(triangles: np.ndarray, sides: np.ndarray, loop: list[int]) -> list[np.ndarray]:
    """The triangles on either side of a loop, each as flags, shape (triangle_count,); none where it parts nothing."""
    side, numbers = sides[:, 0], np.array([triangles.max() + 1, 1])
    ends = triangles.ravel()[np.column_stack([side, side - side % 3 + (side + 1) % 3])]
    edges = np.sort(np.column_stack([loop, np.roll(loop, -1)]), axis=1)
    pairs = sides[~np.isin(np.sort(ends, axis=1) @ numbers, edges @ numbers)] // 3
    piece = joined_pieces(len(triangles), pairs)
    return [piece == number for number in range(2)] if piece.max() == 1 else []


def _cap(nodes: np.ndarray, triangles: np.ndarray, loop: list[int]) -> np.ndarray | None:
    """Triangles over a loop that lie in air, by their centres and places near their sides; None where none do."""
    try:
        cap = np.array(loop)[cap_triangles(nodes[loop])]
    except ValueError:
        return None
    corners = nodes[cap]
    middles = (corners + np.roll(corners, -1, axis=1)) / 2
    inward = middles + INWARD * (np.roll(corners, 1, axis=1) - middles)
    places = np.concatenate([corners.mean(axis=1), inward.reshape(-1, 3)])
    places = places[:: max(len(places) // PLACES, 1)]
    in_air = np.abs(winding_numbers(places, nodes[triangles])) < AIR
    return cap if in_air.all() else None


def _opening(
    nodes: np.ndarray, triangles: np.ndarray, face_of: np.ndarray, behind: np.ndarray, cap: np.ndarray
) -> Opening:
    """The opening under a cap; `behind` says of each triangle whether it is behind the cap."""
    rim = np.unique(cap)
    before = (np.isin(triangles, rim).sum(axis=1) > 1) & ~behind
    sides = triangles[behind][:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    if len(set(map(tuple, sides.tolist())) & set(map(tuple, cap[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).tolist()))):
        cap = cap[:, ::-1]
    return Opening(
        frozenset(face_of[behind].tolist()),
        int(face_of[before][0]),
        nodes[rim].mean(axis=0),
        float(np.linalg.norm(area_vectors(nodes[cap]), axis=1).sum() / 2),
        -enclosed_volume(nodes, np.concatenate([triangles[behind], cap])),
    )


# STEP files: their text checked, and their solids in gmsh, which share the faces where they touch.

FIRST, LAST = "ISO-10303-21", "END-ISO-10303-21"
SECTIONS = ("HEADER", "DATA")

QUOTED = re.compile(r"'[^']*'")
NOT_FINITE = re.compile(r"[(,]\s*[-+]?(?:nan\w*|inf\w*|1\.#\w+)\s*[,)]", re.IGNORECASE)

NO_NAME = "Open CASCADE STEP translator"
"""Beginning of the names that OpenCASCADE gives to solids without one."""


def refuse_broken_step(path: Path) -> None:
    """Check that a file is a whole STEP file without NaN."""
    require_suffix(path, "STEP", STEP_SUFFIXES)
    try:
        text = path.read_text(encoding="latin-1")  # any byte is a letter
    except FileNotFoundError as error:
        raise MeshError(f"{path}: no such file; a STEP file ({', '.join(STEP_SUFFIXES)}) is needed") from error
    except OSError as error:
        raise MeshError(f"{path}: cannot be read: {error.strerror or error}") from error
    if not text.lstrip("\xef\xbb\xbf \t\r\n").startswith(FIRST):
        raise MeshError(f"{path}: is not a STEP file: it does not begin with {FIRST}")
    if LAST not in text:
        raise MeshError(f"{path}: stops too early: it does not end with {LAST}; write it again")
    for section in SECTIONS:
        if not re.search(rf"\b{section}\s*[;(]", text):
            raise MeshError(f"{path}: is not a STEP file: it has no section {section}")
    # Names may read like numbers; blanks take their places, so that lines keep their numbers.
    wrong = NOT_FINITE.search(QUOTED.sub(lambda quoted: " " * len(quoted[0]), text))
    if wrong is not None:
        line, number = text.count("\n", 0, wrong.start()) + 1, wrong[0].strip("(), \t\r\n")
        raise MeshError(f"{path}: line {line} has the number {number}, which is not finite; write the file again")


def import_solids(gmsh: Any, path: Path, defeature: float = 0.0) -> dict[int, str]:
    """Read the solids of a file [mm], each joined to another by a face that both share.

    Args:
        gmsh: the module.
        path: the file.
        defeature: radius up to which fillets and holes are dropped [mm].

    Returns:
        For each solid, in the file's order, gmsh's number and its name, which is empty where the file gives none.
    """
    # Always set: OpenCASCADE keeps the unit of an earlier session.
    gmsh.option.setString("Geometry.OCCTargetUnit", "MM")
    occ = gmsh.model.occ
    try:
        occ.importShapes(str(path))
    except Exception as error:  # gmsh raises plain Exception
        raise MeshError(f"{path}: not readable as STEP: {' '.join(str(error).split())}") from error
    occ.synchronize()
    solids = gmsh.model.getEntities(3)
    if not solids:
        faces = len(gmsh.model.getEntities(2))
        raise MeshError(f"{path}: has no solid body, and {faces} face{'s' * (faces != 1)}; export the body as a solid")
    names = [_plain_name(gmsh.model.getEntityName(*solid)) for solid in solids]
    if defeature:
        solids = _without_small_rounds(gmsh, path, solids, defeature)
    if len(solids) == 1:
        return {solids[0][1]: names[0]}
    volumes = [occ.getMass(*solid) for solid in solids]
    _, parts = occ.fragment(solids, [])
    occ.synchronize()
    for second, its in enumerate(parts):
        for first in range(second):
            common = set(parts[first]) & set(its)
            if common:
                amount = sum(occ.getMass(*part) for part in common)
                raise MeshError(
                    f"{path}: solids {first + 1} and {second + 1} overlap by {amount:.4g} mm^3; cut one from the other"
                )
    tags = [its[0][1] for its in parts]
    _refuse_loose_solids(gmsh, path, tags, volumes)
    return dict(zip(tags, names, strict=True))


def _without_small_rounds(gmsh: Any, path: Path, solids: list[tuple[int, int]], radius: float) -> list[tuple[int, int]]:
    """The solids without faces that are curved by a radius up to this [mm]: their neighbours are extended instead."""
    model, occ = gmsh.model, gmsh.model.occ

    def small_rounds() -> dict[int, np.ndarray]:
        """Numbers of such faces that lie between others, and their middles [mm]."""
        rounds = {}
        for _, face in model.getEntities(2):
            middle = np.mean(model.getParametrizationBounds(2, face), axis=0)
            curvature = np.abs(np.ravel(model.getPrincipalCurvatures(face, middle)[:2])).max()
            if curvature * radius * (1 + NEAR) >= 1:
                rounds[face] = np.round(model.getValue(2, face, middle), 2)
        return rounds

    where, before = f"{path}: defeature = {radius:g}", sum(occ.getMass(*solid) for solid in solids)
    dropped = small_rounds()
    if not dropped:
        warn_caller(f"{where}: no face has a radius up to {radius:g} mm; it has no effect")
        return solids
    place = next(iter(dropped.values())).tolist()
    refusal = MeshError(f"{where}: cannot drop {len(dropped)} faces, the first at {place} mm; try a smaller radius")
    try:
        left = occ.defeature([solid for _, solid in solids], list(dropped))
    except Exception as error:  # gmsh raises plain Exception
        raise refusal from error
    occ.synchronize()
    kept = small_rounds()
    if len(left) != len(solids) or len(kept) == len(dropped):
        raise refusal
    after = sum(occ.getMass(*solid) for solid in left)
    rest = f"; {len(kept)} are left, the first at {next(iter(kept.values())).tolist()} mm" if kept else ""
    warn_caller(
        f"{where}: {len(dropped) - len(kept)} round faces are dropped, which changes the volume by "
        f"{100 * (after / before - 1):.2g} %{rest}"
    )
    return list(left)


def _refuse_loose_solids(gmsh: Any, path: Path, tags: list[int], volumes: list[float]) -> None:
    joined, waiting = set(), [tags[0]]
    while waiting:
        joined.add(tag := waiting.pop())
        faces = gmsh.model.getAdjacencies(3, tag)[1]
        waiting += {int(solid) for face in faces for solid in gmsh.model.getAdjacencies(2, face)[0]} - joined
    loose = [number for number, tag in enumerate(tags) if tag not in joined]
    if loose:
        sizes = ", ".join(f"{volume:.4g}" for volume in volumes)
        raise MeshError(
            f"{path}: has {len(tags)} solids, of {sizes} mm^3, and solid {loose[0] + 1} shares no face with those "
            "joined to solid 1; join them, or export one body alone"
        )


def _plain_name(label: str) -> str:
    """The last part of a label like "Shapes/assembly/stiff layer", as a name of a group: "stiff_layer"."""
    name = label.rpartition("/")[2]
    return "" if name.startswith(NO_NAME) else re.sub(r"[^\w.-]+", "_", name).strip("_")


DEEP, LARGER = 0.9, 1.25
"""Least depth of the body behind its base over the largest depth behind any flat end, and least area of the base over
that of the next largest end [-]."""


@dataclass(frozen=True)
class CadSolid:
    """A solid: its number, from 1 in the file's order; its name, "solid_2" without one of its own; volume [mm^3]."""

    number: int
    name: str
    volume: float


@dataclass(frozen=True)
class CadFace:
    """A face.

    Attributes:
        number: its number, from 1.
        solids: numbers of the solid behind it, or of the two that share it.
        area: [mm^2].
        centre: its centre of mass [mm], shape (3,).
        normal: unit normal out of its first solid, shape (3,); None where it is curved.
    """

    number: int
    solids: tuple[int, ...]
    area: float
    centre: np.ndarray
    normal: np.ndarray | None


@dataclass(frozen=True, eq=False)
class CadBody:
    """The body of a STEP file, of one solid or several that share faces.

    Attributes:
        path: path of the file.
        defeature: radius up to which its fillets and holes were dropped [mm].
        solids, faces: in the order of their numbers.
        outside: numbers of the faces of its outside, those of chambers that are open to it too.
        voids: numbers of the faces of each closed void.
        void_volumes: their volumes [mm^3].
        nodes, triangles, face_of: a coarse triangulation of all faces, outward: [mm], shape (node_count, 3); node
            indices, shape (triangle_count, 3); and the number of the face of each, shape (triangle_count,).
        extent: edge lengths of the box around it along x, y and z [mm], shape (3,).
    """

    path: Path
    defeature: float
    solids: tuple[CadSolid, ...]
    faces: tuple[CadFace, ...]
    outside: frozenset[int]
    voids: tuple[frozenset[int], ...]
    void_volumes: tuple[float, ...]
    nodes: np.ndarray
    triangles: np.ndarray
    face_of: np.ndarray
    extent: np.ndarray

    @property
    def volume(self) -> float:
        """Volume of all solids [mm^3]."""
        return sum(solid.volume for solid in self.solids)

    @property
    def doubt(self) -> str:
        """What is odd about its size; empty where nothing is."""
        return implausible(f"{self.path}: its longest side", float(self.extent.max()), SIZE)

    @property
    def flat(self) -> bool:
        """Whether all faces are flat."""
        return all(face.normal is not None for face in self.faces)

    @cached_property
    def regions(self) -> dict[int, int]:
        """For each face of the outside the lowest number of those that continue it in its plane, or its own."""
        faces = {face.number: face for face in self.faces}
        outside = np.isin(self.face_of, list(self.outside))
        pairs = np.unique(self.face_of[outside][facing_sides(self.triangles[outside]) // 3], axis=0)
        near = NEAR * diagonal(self.nodes)
        joined = [
            (first, second)
            for first, second in pairs.tolist()
            if (n := faces[first].normal) is not None
            and (m := faces[second].normal) is not None
            and n @ m > 1 - NEAR
            and abs(n @ (faces[first].centre - faces[second].centre)) < near
        ]
        region = joined_pieces(max(faces) + 1, np.array(joined, dtype=int).reshape(-1, 2)).tolist()
        lowest: dict[int, int] = {}
        return {face: lowest.setdefault(region[face], face) for face in sorted(self.outside)}

    @cached_property
    def openings(self) -> tuple[Opening, ...]:
        """The chambers that are open to the outside, the largest first."""
        here = np.isin(self.face_of, list(self.outside))
        return find_openings(self.nodes, self.triangles[here], self.face_of[here], self.regions)

    @cached_property
    def flat_end(self) -> tuple[int, ...]:
        """Numbers of the faces of the one flat end by which the body is held, by all likelihood; empty where none is.

        It is one of the flat ends behind which the body is deepest: the one with an opening, else the largest if it is
        larger than the others by a quarter.
        """
        skin = self.outside - frozenset(face for opening in self.openings for face in opening.faces)
        vertices = self.nodes[np.unique(self.triangles[np.isin(self.face_of, list(skin))])]
        ends: dict[int, list[CadFace]] = {}
        for face in self.faces:
            if face.number in skin and face.normal is not None:
                ends.setdefault(self.regions[face.number], []).append(face)
        depth = {}
        for region, faces in ends.items():
            heights = (vertices - faces[0].centre) @ faces[0].normal
            if heights.max() < NEAR * diagonal(vertices):
                depth[region] = -heights.min()
        deep = [region for region in depth if depth[region] >= DEEP * max(depth.values())]
        opened = [region for region in deep if any(region == self.regions[opening.beside] for opening in self.openings)]
        area = {region: sum(face.area for face in ends[region]) for region in deep}
        deep.sort(key=lambda region: -area[region])
        if len(opened) == 1:
            chosen = opened[0]
        elif len(deep) == 1 or (deep and area[deep[0]] >= LARGER * area[deep[1]]):
            chosen = deep[0]
        else:
            return ()
        return tuple(face.number for face in ends[chosen])


def read_step(path: Path, defeature: float = 0.0) -> CadBody:
    """Read a STEP file and measure its body, without fillets and holes of a radius up to `defeature` [mm]."""
    refuse_broken_step(path)

    def read(gmsh: Any, algorithm: int) -> CadBody:
        gmsh.option.setNumber("Mesh.Algorithm", algorithm)
        return _measured(gmsh, path, defeature)

    return next(successes(str(path), SURFACE_ALGORITHMS, read))


def _measured(gmsh: Any, path: Path, defeature: float) -> CadBody:
    model, occ = gmsh.model, gmsh.model.occ
    names = import_solids(gmsh, path, defeature)
    number_of = {tag: number for number, tag in enumerate(names, 1)}
    solids = []
    for (tag, name), number in zip(names.items(), number_of.values(), strict=True):
        free = name not in ("", SILICONE) and list(names.values()).count(name) == 1
        solids.append(CadSolid(number, name if free else f"solid_{number}", occ.getMass(3, tag)))
    wrong = next((solid for solid in solids if not solid.volume > 0), None)
    if wrong is not None:
        raise MeshError(f"{path}: the volume of its body is {wrong.volume:.4g} mm^3; is it inside out?")
    faces = [_face(model, tag, number_of) for _, tag in model.getEntities(2) if len(model.getAdjacencies(2, tag)[0])]
    boxes = np.reshape([model.getBoundingBox(3, tag) for tag in names], (-1, 2, 3))
    extent = boxes[:, 1].max(axis=0) - boxes[:, 0].min(axis=0)
    gmsh.option.setNumber("Mesh.MeshSizeMax", float(np.linalg.norm(extent)) / PRESETS["coarse"])
    gmsh.option.setNumber("Mesh.MeshSizeFromPoints", 0)
    gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", 12)
    gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)
    model.mesh.generate(2)
    nodes, triangles, face_of = _triangulation(model.mesh, [face.number for face in faces])
    shells = _shells(nodes, triangles, face_of, {face.number for face in faces if len(face.solids) == 1})
    volumes = [abs(occ.getMass(3, occ.addVolume([occ.addSurfaceLoop(sorted(shell))]))) for shell in shells[1:]]
    return CadBody(
        path,
        defeature,
        tuple(solids),
        tuple(faces),
        shells[0],
        tuple(shells[1:]),
        tuple(volumes),
        nodes,
        triangles,
        face_of,
        extent,
    )


def _face(model: Any, tag: int, number_of: dict[int, int]) -> CadFace:
    behind = tuple(sorted(number_of[int(solid)] for solid in model.getAdjacencies(2, tag)[0]))
    normal = None
    if model.getType(2, tag) == "Plane":
        normal = np.array(model.getNormal(tag, np.mean(model.getParametrizationBounds(2, tag), axis=0)))
    return CadFace(tag, behind, model.occ.getMass(2, tag), np.array(model.occ.getCenterOfMass(2, tag)), normal)


def _triangulation(mesh: Any, faces: Iterable[int]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    corners = [mesh.getElementsByType(TRIANGLE, face)[1] for face in faces]
    nodes, triangles, _ = numbered(mesh, np.concatenate(corners))
    return nodes, triangles.reshape(-1, 3), np.repeat(list(faces), [len(its) // 3 for its in corners])


def _shells(nodes: np.ndarray, triangles: np.ndarray, face_of: np.ndarray, faces: set[int]) -> list[frozenset[int]]:
    """The boundary's pieces, each the numbers of its faces: the outside, then each void."""
    here = np.isin(face_of, list(faces))
    pairs = facing_sides(triangles[here]) // 3
    piece = joined_pieces(here.sum(), pairs)
    sizes = [diagonal(nodes[triangles[here][piece == number]].reshape(-1, 3)) for number in range(piece.max() + 1)]
    order = sorted(range(len(sizes)), key=lambda number: number != np.argmax(sizes))  # the others as they come
    return [frozenset(face_of[here][piece == number].tolist()) for number in order]
