"""The objects of the grasps: surfaces and meshes made in code, as the tables of a scene.

The gripper points down along -x, so that an object stands with its own z axis along x; objects of round shape stand
upright in their own frames, and are turned.
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from taichisoft.mesh import write_volume_mesh
from taichisoft_benchmarks.regular_meshes import bar

AXIS = (70.0, 0.0)
"""The axis of the gripper: y and z [mm]."""
BOTTOM = -121.0
"""x of the lowest points of the objects at the start [mm]: the contact distance of 1 mm above the floor."""
SIDE = 42.0
"""Edge of the cube, and diameter of round objects [mm]."""
GAP = 1.0
"""Distance between two objects that are grasped together [mm], which is the contact distance."""
UPRIGHT = (0.0, 90.0, 0.0)
"""Rotation that brings an object's z axis to the vertical x axis [degrees]."""
CELLS = 4
"""Cells along the edges of the soft cube."""

Tables = dict[str, dict[str, Any]]
"""Bodies by name, in `rigid_bodies` and `soft_bodies`."""


def _ball(mass: float, exact: bool, folder: Path) -> Tables:
    radius = SIDE / 2
    shape = (
        {"sphere": {"radius": radius}}
        if exact
        else _surface(trimesh.creation.icosphere(4, radius), folder / "ball.stl")
    )
    return _rigid(ball={**shape, "mass": mass, **_standing(radius)})


def _cylinder(mass: float, exact: bool, folder: Path, lying: bool) -> Tables:
    radius = SIDE / 2
    surface = trimesh.creation.cylinder(radius, SIDE, sections=128)
    shape = {"cylinder": {"radius": radius, "length": SIDE}} if exact else _surface(surface, folder / "cylinder.stl")
    turn = (0.0, 0.0, 0.0) if lying else UPRIGHT
    return _rigid(cylinder={**shape, "mass": mass, **_standing(radius, turn)})


def _torus(mass: float, exact: bool, folder: Path) -> Tables:
    """A ring that lies on the floor, 50 mm wide and 20 mm high."""
    surface = trimesh.creation.torus(15.0, 10.0, major_sections=64, minor_sections=32)
    return _rigid(torus={**_surface(surface, folder / "torus.stl"), "mass": mass, **_standing(10.0, UPRIGHT)})


def _bracket(mass: float, exact: bool, folder: Path) -> Tables:
    """An L, which is a cube without a quarter, upright, its centre of mass on the axis of the gripper."""
    outline = np.array([[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]]) * SIDE / 2
    centre = np.array([5.0, 5.0]) / 6 * SIDE / 2  # the mean of its three squares
    surface = _prism(outline - centre, [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]], SIDE)
    return _rigid(bracket={**_surface(surface, folder / "bracket.stl"), "mass": mass, **_standing(SIDE / 2, UPRIGHT)})


def _cube(mass: float, exact: bool, folder: Path, degrees: float = 0.0, aside: float = 0.0) -> Tables:
    return _rigid(cube={**_box(SIDE, SIDE, SIDE, mass, 0.0, aside), "rotation": (degrees, 0.0, 0.0)})


def _stack(mass: float, exact: bool, folder: Path) -> Tables:
    height = (SIDE - GAP) / 2
    lower, upper = (_box(height, SIDE, SIDE, mass / 2, above) for above in (0.0, height + GAP))
    return _rigid(lower=lower, upper=upper)


def _pair(mass: float, exact: bool, folder: Path) -> Tables:
    width = (SIDE - GAP) / 2
    left, right = (_box(SIDE, SIDE, width, mass / 2, 0.0, side * (width + GAP) / 2) for side in (-1, 1))
    return _rigid(left=left, right=right)


def _mug(mass: float, exact: bool, folder: Path) -> Tables:
    """A cup with a handle, whose ends are inside the wall: the two are one closed surface without a boolean.

    The handle is between two fingers.
    """
    radius, wall, height = 17.0, 4.0, 40.0
    profile = [[0, 0], [radius, 0], [radius, height], [radius - wall, height], [radius - wall, wall], [0, wall]]
    cup = trimesh.creation.revolve(np.array(profile), sections=64)
    handle = _half_ring(10.0, 3.0)
    handle.apply_translation([radius - wall / 2, 0.0, height / 2])
    both = trimesh.util.concatenate([cup, handle])
    return _rigid(mug={**_surface(both, folder / "mug.stl"), "mass": mass, **_standing(0.0, (90.0, 0.0, 90.0))})


def _soft_cube(mass: float, exact: bool, folder: Path) -> Tables:
    path = folder / "soft_cube.msh"
    write_volume_mesh(bar((CELLS,) * 3, (SIDE,) * 3), path)
    table = {
        "mesh": str(path),
        "mass": mass,
        "young_modulus": 100.0,
        "poisson_ratio": 0.3,
        "rayleigh_stiffness": 0.01,
        "translation": (BOTTOM, AXIS[0] - SIDE / 2, AXIS[1] - SIDE / 2),
    }
    return {"rigid_bodies": {}, "soft_bodies": {"soft_cube": table}}


OBJECTS: dict[str, Callable[[float, bool, Path], Tables]] = {
    "ball": _ball,
    "cylinder standing": partial(_cylinder, lying=False),
    "cylinder lying": partial(_cylinder, lying=True),
    "torus": _torus,
    "L": _bracket,
    "cube": _cube,
    "cube turned by 45 degrees": partial(_cube, degrees=45.0),
    "cube 10 mm off centre": partial(_cube, aside=10.0),
    "two cubes stacked": _stack,
    "two cubes side by side": _pair,
    "mug": _mug,
    "soft cube": _soft_cube,
}
"""Functions that give the tables of the grasped objects.

Their arguments are the mass of all of it [kg], whether round objects are given by their shape instead of by triangles,
and the folder in which surfaces and meshes are written.
"""
ROUND = ("ball", "cylinder standing", "cylinder lying")
"""Objects whose shape can be exact."""


def _rigid(**bodies: dict[str, Any]) -> Tables:
    return {"rigid_bodies": bodies, "soft_bodies": {}}


def _standing(height: float, rotation: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> dict[str, Any]:
    """Place of a body whose origin is `height` above its lowest point [mm]."""
    return {"position": (BOTTOM + height, *AXIS), "rotation": rotation}


def _box(high: float, deep: float, wide: float, mass: float, above: float, aside: float = 0.0) -> dict[str, Any]:
    """A box with edges along x, y and z, so far above the floor and so far along z from the axis [mm]."""
    place = (BOTTOM + above + high / 2, AXIS[0], AXIS[1] + aside)
    return {"box": (high, deep, wide), "mass": mass, "position": place}


def _surface(surface: trimesh.Geometry, path: Path) -> dict[str, Any]:
    surface.export(path)
    return {"surface": str(path)}


def _prism(outline: np.ndarray, faces: list[list[int]], height: float) -> trimesh.Trimesh:
    """A prism about the origin over an outline that goes round anticlockwise, and the triangles that fill it."""
    count = len(outline)
    vertices = [[*point, side * height / 2] for side in (-1, 1) for point in outline]
    triangles = [face[::-1] for face in faces] + [[corner + count for corner in face] for face in faces]
    for here in range(count):
        there = (here + 1) % count
        triangles += [[here, there, there + count], [here, there + count, here + count]]
    return trimesh.Trimesh(vertices, triangles)


def _half_ring(radius: float, thickness: float, along: int = 24, around: int = 16) -> trimesh.Trimesh:
    """Half a ring in the xz plane on the side of positive x, its two ends closed; radii of ring and tube [mm]."""
    middle = np.linspace(-np.pi / 2, np.pi / 2, along)[:, None]
    angle = np.linspace(0.0, 2 * np.pi, around, endpoint=False)[None, :]
    distance = radius + thickness * np.cos(angle)
    height = np.broadcast_to(-thickness * np.sin(angle), (along, around))
    rings = np.stack([distance * np.cos(middle), height, distance * np.sin(middle)], axis=-1).reshape(-1, 3)
    ends = radius * np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]])
    triangles = []
    for k in range(around):
        after = (k + 1) % around
        for ring in range(0, (along - 1) * around, around):
            triangles += [[ring + k, ring + around + after, ring + after]]
            triangles += [[ring + k, ring + around + k, ring + around + after]]
        last = (along - 1) * around
        triangles += [[k, after, along * around], [last + after, last + k, along * around + 1]]
    return trimesh.Trimesh(np.vstack([rings, ends]), triangles)
