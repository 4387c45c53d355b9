"""The body of a STEP file as it is drawn: its solids and faces with their numbers, its cavities and its openings."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from taichisoft.base import SIZE, implausible
from taichisoft.errors import MeshError
from taichisoft.mesh import require_suffix
from taichisoft_meshing.body_tables import PRESETS
from taichisoft_meshing.closed_shells import NEAR, diagonal, facing_sides
from taichisoft_meshing.geometry_file import STEP_SUFFIXES
from taichisoft_meshing.gmsh_session import SURFACE_ALGORITHMS, TRIANGLE, first_success
from taichisoft_meshing.meshed_body import SILICONE
from taichisoft_meshing.openings import Opening, find_openings

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


def import_solids(gmsh: Any, path: Path) -> dict[int, str]:
    """Read the solids of a file [mm], each joined to another by a face that both share.

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


def _refuse_loose_solids(gmsh: Any, path: Path, tags: list[int], volumes: list[float]) -> None:
    joined, waiting = set(), [tags[0]]
    while waiting:
        joined.add(tag := waiting.pop())
        faces = gmsh.model.getAdjacencies(3, tag)[1]
        waiting += {int(one) for face in faces for one in gmsh.model.getAdjacencies(2, face)[0]} - joined
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
        solids, faces: in the order of their numbers.
        outside: numbers of the faces of its outside, those of chambers that are open to it too.
        voids: numbers of the faces of each closed void.
        void_volumes: their volumes [mm^3].
        nodes, triangles, face_of: a coarse triangulation of all faces, outward: [mm], shape (node_count, 3); node
            indices, shape (triangle_count, 3); and the number of the face of each, shape (triangle_count,).
        extent: edge lengths of the box around it along x, y and z [mm], shape (3,).
    """

    path: Path
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
            (one, other)
            for one, other in pairs.tolist()
            if (n := faces[one].normal) is not None
            and (m := faces[other].normal) is not None
            and n @ m > 1 - NEAR
            and abs(n @ (faces[one].centre - faces[other].centre)) < near
        ]
        size = max(faces) + 1
        label = connected_components(coo_matrix((np.ones(len(joined)), np.array(joined).reshape(-1, 2).T), (size,) * 2))
        lowest: dict[int, int] = {}
        return {face: lowest.setdefault(int(label[1][face]), face) for face in sorted(self.outside)}

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
        opened = [region for region in deep if any(region == self.regions[one.beside] for one in self.openings)]
        area = {region: sum(face.area for face in ends[region]) for region in deep}
        deep.sort(key=lambda region: -area[region])
        if len(opened) == 1:
            chosen = opened[0]
        elif len(deep) == 1 or (deep and area[deep[0]] >= LARGER * area[deep[1]]):
            chosen = deep[0]
        else:
            return ()
        return tuple(face.number for face in ends[chosen])


def read_step(path: Path) -> CadBody:
    """Read a STEP file and measure its body."""
    refuse_broken_step(path)

    def read(gmsh: Any, algorithm: int) -> CadBody:
        gmsh.option.setNumber("Mesh.Algorithm", algorithm)
        return _measured(gmsh, path)

    return first_success(str(path), SURFACE_ALGORITHMS, read)


def _measured(gmsh: Any, path: Path) -> CadBody:
    model, occ = gmsh.model, gmsh.model.occ
    names = import_solids(gmsh, path)
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
    tags, coordinates, _ = mesh.getNodes()
    order = np.argsort(tags)
    corners = [mesh.getElementsByType(TRIANGLE, face)[1].reshape(-1, 3) for face in faces]
    face_of = np.repeat(list(faces), [len(some) for some in corners])
    used, triangles = np.unique(np.concatenate(corners), return_inverse=True)
    nodes = coordinates.reshape(-1, 3)[order[np.searchsorted(tags[order], used)]]
    return nodes, triangles.reshape(-1, 3), face_of


def _shells(nodes: np.ndarray, triangles: np.ndarray, face_of: np.ndarray, faces: set[int]) -> list[frozenset[int]]:
    """The boundary's pieces, each the numbers of its faces: the outside, then each void."""
    here = np.isin(face_of, list(faces))
    pairs = facing_sides(triangles[here]) // 3
    graph = coo_matrix((np.ones(len(pairs)), pairs.T), shape=(here.sum(),) * 2)
    count, piece = connected_components(graph, directed=False)
    sizes = [diagonal(nodes[triangles[here][piece == number]].reshape(-1, 3)) for number in range(count)]
    order = [int(np.argmax(sizes)), *(number for number in range(count) if number != np.argmax(sizes))]
    return [frozenset(face_of[here][piece == number].tolist()) for number in order]
