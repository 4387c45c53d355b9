"""Closed surfaces and STEP files made in code, for tests of bodies from elsewhere."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from taichisoft_meshing.gmsh_session import gmsh_session

Surface = trimesh.Trimesh


def box(size: Sequence[float], at: Sequence[float] = (0, 0, 0), parts: int = 0) -> Surface:
    """A box about `at` [mm]; each of its triangles is cut in four `parts` times."""
    surface = trimesh.creation.box(size)
    for _ in range(parts):
        surface = surface.subdivide()
    return moved(surface, at)


def ball(radius: float, at: Sequence[float] = (0, 0, 0), parts: int = 2) -> Surface:
    """A ball about `at` [mm], of 20 triangles that are each cut in four `parts` times."""
    return moved(trimesh.creation.icosphere(parts, radius), at)


def moved(surface: Surface, by: Sequence[float]) -> Surface:
    surface = surface.copy()
    surface.apply_translation(by)
    return surface


def turned_round(surface: Surface) -> Surface:
    """Inside out."""
    return surface_of(surface.vertices, surface.faces[:, ::-1])


def together(*surfaces: Surface) -> Surface:
    return trimesh.util.concatenate(list(surfaces))


def surface_of(vertices: Any, triangles: Any) -> Surface:
    return Surface(vertices, triangles, process=False)


def arrays(surface: Surface) -> tuple[np.ndarray, np.ndarray]:
    """Vertices [mm] and triangles."""
    return np.array(surface.vertices), np.array(surface.faces)


def save(surface: Surface, path: Path) -> Path:
    surface.export(path)
    return path


def write_step(path: Path, draw: Callable[[Any], object]) -> Path:
    """A STEP file of what `draw` makes with gmsh's OpenCASCADE."""
    with gmsh_session(path.name) as gmsh:
        draw(gmsh.model.occ)
        gmsh.model.occ.synchronize()
        gmsh.write(str(path))
    return path
