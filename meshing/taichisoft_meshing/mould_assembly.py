"""A mould with the silicone in it, as solids that OpenCASCADE makes, and the files of its parts."""

import math
import os
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from taichisoft.mesh import write_stl
from taichisoft_meshing.closed_shells import closed_shells
from taichisoft_meshing.gmsh_session import TRIANGLE, GmshFailure, gmsh_session, numbered
from taichisoft_meshing.pneunet_finger import Solids

SMALLEST_EDGE, LARGEST_EDGE = 0.1, 10.0
"""Shortest and longest edge that triangles are asked to have [mm]."""

Way = tuple[float, float, float]


@dataclass(frozen=True)
class Assembly:
    """The parts of a mould, and the silicone in it, as they lie before it is opened.

    Attributes:
        parts: gmsh's solids by name, in the order in which they come off; the last one stays where it is.
        ways: direction in which each comes off [-], by name; none for the last one.
        silicone: name of the silicone among the parts.
        block: volume of the box that all parts and the silicone fill together [mm^3].
        clearance: volume in it that stays empty, so that parts go together [mm^3].
        pours: what is poured one after the other: what for, of which silicone ("soft" or "stiff"), and its volume
            [mm^3].
    """

    parts: Mapping[str, Solids]
    ways: Mapping[str, Way]
    silicone: str
    block: float
    clearance: float
    pours: tuple[tuple[str, str, float], ...]


Build = Callable[[Any], Assembly]
"""Makes an assembly with the module gmsh, in a session."""


def write_assembly(build: Build, folder: Path, name: str, chord: float) -> dict[str, Any]:
    """Write NAME-PART.stl and NAME-PART.step for every part, the silicone included, the former as fine as `chord` [mm].

    The parts are triangulated together, so that triangles of parts that touch are the same: nothing overlaps.

    Returns:
        What the check needs to know, for `mould.json`.
    """
    with gmsh_session(name) as gmsh:
        assembly = build(gmsh)
        for part, (vertices, triangles) in _triangulated(gmsh, assembly, name, chord).items():
            write_stl(vertices, triangles, folder / f"{name}-{part}.stl")
    for part in assembly.parts:  # each in a session of its own: gmsh writes all that a model has, or nothing
        with gmsh_session(name) as gmsh:
            parts = build(gmsh).parts
            gmsh.model.occ.remove([one for other, solids in parts.items() if other != part for one in solids], True)
            write_step(gmsh, folder / f"{name}-{part}.step")
    files = [
        {"file": f"{name}-{part}.stl", "part": part, "comes_off": list(assembly.ways.get(part, ())) or None}
        for part in assembly.parts
    ]
    pours = [{"what": what, "silicone": silicone, "mm3": volume} for what, silicone, volume in assembly.pours]
    return {
        "parts": files,
        "silicone": assembly.silicone,
        "block_mm3": assembly.block,
        "clearance_mm3": assembly.clearance,
        "pours": pours,
    }


def write_step(gmsh: Any, path: Path) -> None:
    """Write all solids of a session as STEP.

    What OpenCASCADE prints goes to nowhere; gmsh's options do not silence it.
    """
    gmsh.model.occ.synchronize()
    with _silence():
        gmsh.write(str(path))


def triangulate(gmsh: Any, chord: float) -> None:
    """Put triangles on all faces of the session's model, which miss curved ones by `chord` [mm] at most."""
    model = gmsh.model
    sizes: dict[tuple[int, int], float] = {}
    for _, face in model.getEntities(2):
        low, high = model.getParametrizationBounds(2, face)
        grid = np.stack(np.meshgrid(*(np.linspace(*ends, 9) for ends in zip(low, high, strict=True))), axis=-1)
        curvature = max(np.abs(model.getPrincipalCurvatures(face, grid.ravel())[:2]).max(), 1e-9)
        size = min(max(math.sqrt(4 * chord / curvature), SMALLEST_EDGE), LARGEST_EDGE)
        for entity in ((2, face), *((1, int(curve)) for curve in model.getAdjacencies(2, face)[1])):  # seams too
            sizes[entity] = min(size, sizes.get(entity, size))
    model.mesh.setSizeCallback(lambda dim, tag, x, y, z, size: sizes.get((dim, tag), size))
    gmsh.option.setNumber("Mesh.MeshSizeMax", LARGEST_EDGE)
    gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)
    model.mesh.generate(2)


def triangles_of(gmsh: Any, faces: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """Vertices [mm], shape (vertex_count, 3), and triangles, (triangle_count, 3), of faces, as gmsh turned them."""
    mesh = gmsh.model.mesh
    corners = [mesh.getElementsByType(TRIANGLE, face)[1] for face in faces]
    vertices, triangles, _ = numbered(mesh, np.concatenate(corners))
    return vertices, triangles.reshape(-1, 3)


def _triangulated(gmsh: Any, assembly: Assembly, name: str, chord: float) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Vertices and outward triangles of every part."""
    solids = [solid for part in assembly.parts.values() for solid in part]
    made, origins = gmsh.model.occ.fragment(solids, [])
    gmsh.model.occ.synchronize()
    if sum(len(pieces) for pieces in origins) != len(made):
        raise GmshFailure(f"parts of {name} overlap")
    triangulate(gmsh, chord)
    pieces_of = iter(origins)
    surfaces = {}
    for part, of_part in assembly.parts.items():
        pieces = [piece for _ in of_part for piece in next(pieces_of)]
        faces = [face for _, face in gmsh.model.getBoundary(pieces, combined=True, oriented=False)]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # gmsh turns triangles as it likes
            shells = closed_shells(*triangles_of(gmsh, faces), f"{name}-{part}")
        starts = np.cumsum([0, *(len(shell.vertices) for shell in shells)])
        surfaces[part] = (
            np.concatenate([shell.vertices for shell in shells]),
            np.concatenate([shell.triangles + start for shell, start in zip(shells, starts, strict=False)]),
        )
    return surfaces


@contextmanager
def _silence() -> Iterator[None]:
    before = os.dup(1)
    with Path(os.devnull).open("wb") as nowhere:
        os.dup2(nowhere.fileno(), 1)
        try:
            yield
        finally:
            os.dup2(before, 1)
            os.close(before)
