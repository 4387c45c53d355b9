"""What a page draws: surfaces that never change but in place, and where everything is at a moment."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class PageSurface:
    """A surface of a frame.

    Attributes:
        name: of the body or of the cavity; no two have the same.
        kind: "soft", "cavity", "rigid" or "obstacle".
        triangles: vertex indices, outward, shape (triangle_count, 3).
    """

    name: str
    kind: str
    triangles: np.ndarray


@dataclass(frozen=True)
class PagePlane:
    """An infinite plane.

    Attributes:
        name: of the obstacle.
        point: a point of it [mm], shape (3,).
        normal: unit normal [-], shape (3,).
    """

    name: str
    point: np.ndarray
    normal: np.ndarray


@dataclass(frozen=True)
class Cast:
    """Who appears on a page.

    Attributes:
        title: of the scene.
        up: unit vector against gravity, shape (3,).
        surfaces: in the order of `Frame.vertices`.
        planes: infinite obstacles.
        cavities: their names.
        soft_bodies: their names.
        gripped: name of the rigid body whose height and forces are plotted; None without one.
        gripped_index: its row in `Frame.rigid_position`.
    """

    title: str
    up: np.ndarray
    surfaces: tuple[PageSurface, ...]
    planes: tuple[PagePlane, ...]
    cavities: tuple[str, ...]
    soft_bodies: tuple[str, ...]
    gripped: str | None
    gripped_index: int = 0


@dataclass(frozen=True)
class Frame:
    """A moment.

    Attributes:
        time: [s].
        vertices: positions [mm] of each surface's vertices, each of shape (vertex_count, 3).
        rigid_position: centres of mass [mm], shape (rigid_count, 3).
        contact_points: [mm], shape (contact_count, 3).
        contact_forces: on the second body of each contact [mN], shape (contact_count, 3).
        pressures: [kPa] by cavity.
        normal_forces: [mN] by pair of bodies ("finger1|cube").
    """

    time: float
    vertices: tuple[np.ndarray, ...]
    rigid_position: np.ndarray
    contact_points: np.ndarray
    contact_forces: np.ndarray
    pressures: Mapping[str, float]
    normal_forces: Mapping[str, float]


def grip_forces(cast: Cast, normal_forces: Mapping[str, float]) -> np.ndarray:
    """How hard each soft body presses the gripped one [mN], shape (soft_count,)."""
    both = {frozenset(pair.split("|")): force for pair, force in normal_forces.items()}
    return np.array([both.get(frozenset((name, cast.gripped or "")), 0.0) for name in cast.soft_bodies])
