"""Stand-ins, with the same names and sizes, for meshes of SOFA itself that scenes use."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from taichisoft.errors import MeshError
from taichisoft_sofa.meshes.loaded_mesh import LoadedMesh


def _box(lower: tuple[float, float, float], upper: tuple[float, float, float], pieces: int) -> LoadedMesh:
    """Surface of a box, facing outward, with pieces x pieces squares of two triangles on each face."""
    grid = np.linspace(0.0, 1.0, pieces + 1)
    points = np.array([[x, y, z] for x in grid for y in grid for z in grid])
    number = np.arange(len(points)).reshape(pieces + 1, pieces + 1, pieces + 1)
    on_surface = ((points == 0.0) | (points == 1.0)).any(axis=1)
    quads = []
    for axis in range(3):
        for end, turned in ((0, True), (-1, False)):
            face = np.take(number, end, axis=axis)
            corners = np.stack([face[:-1, :-1], face[1:, :-1], face[1:, 1:], face[:-1, 1:]], axis=-1).reshape(-1, 4)
            # The cross product of the two other axes points along the third axis, or against it if that is y.
            quads.append(corners[:, ::-1] if turned != (axis == 1) else corners)
    renumbered = np.cumsum(on_surface) - 1
    quad = renumbered[np.vstack(quads)]
    triangles = quad[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)
    return LoadedMesh(np.array(lower) + points[on_surface] * np.subtract(upper, lower), triangles=triangles)


def _plate(half_width: float) -> LoadedMesh:
    """A square in the plane y = 0, facing upward."""
    w = half_width
    corners = [[-w, 0.0, -w], [-w, 0.0, w], [w, 0.0, w], [w, 0.0, -w]]
    return LoadedMesh(np.array(corners), quads=np.array([[0, 1, 2, 3]]))


def _ball() -> LoadedMesh:
    """A sphere of radius 1, facing outward."""
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=2)
    return LoadedMesh(np.array(ball.vertices), triangles=np.array(ball.faces, dtype=np.int64))


STOCK_MESHES: dict[str, Callable[[], LoadedMesh]] = {
    "mesh/smCube27.obj": lambda: _box((-3.5, -3.5, -3.5), (3.5, 3.5, 3.5), 2),
    "mesh/ball.obj": _ball,
    "mesh/cube.obj": lambda: _box((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0), 1),
    "mesh/floorFlat.obj": lambda: _plate(20.0),
    "mesh/floor.obj": lambda: _box((-74.67, -5.33, -74.67), (74.67, -1.33, 74.67), 1),
}
"""Functions that make the meshes, by name."""


def find_mesh(name: str, find_file: Callable[[str], Path | None]) -> Path:
    """Path of a mesh: a file found by `find_file`, or the name of one of SOFA's meshes known to `read_mesh`.

    Raises:
        MeshError: the mesh was not found.
    """
    found = find_file(str(Path(name).expanduser()))
    if found is not None:
        return found.resolve()
    if Path(name).as_posix() not in STOCK_MESHES:
        known = ", ".join(STOCK_MESHES)
        raise MeshError(f"{name}: no such file beside the scene or in its folders; SOFA's own that are known: {known}")
    return Path(name)
