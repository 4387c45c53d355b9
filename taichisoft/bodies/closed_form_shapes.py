"""Shapes without a surface file: their volume and inertia in closed form, and triangles to draw them with."""

import math
from dataclasses import dataclass

import numpy as np

from taichisoft.scenes.shape_settings import Shaped

SPHERE_SUBDIVISIONS = 4  # of an icosahedron: 5120 triangles
SECTIONS = 96  # triangles around a cylinder or capsule


@dataclass(frozen=True)
class RoundShape:
    """A sphere, capsule or cylinder about the origin, its axis along z.

    Attributes:
        radius: [mm].
        length: of the axis: between the flat ends of a cylinder, between the centres of a capsule's half balls, 0 for a
            sphere [mm].
        flat: whether the ends are flat.
    """

    radius: float
    length: float
    flat: bool

    @property
    def volume(self) -> float:
        """[mm^3]."""
        ball = 0.0 if self.flat else 4.0 / 3.0 * self.radius
        return math.pi * self.radius**2 * (self.length + ball)

    @property
    def smallest_extent(self) -> float:
        """[mm]."""
        return min(2.0 * self.radius, self.length) if self.flat else 2.0 * self.radius

    def inertia(self, mass: float) -> np.ndarray:
        """About the centre [kg mm^2], shape (3, 3), of a mass [kg] spread evenly.

        A half ball's centre of mass is 3/8 of the radius beyond its flat side, and its inertia about an axis across
        there is 83/320 of its mass times the radius squared.
        """
        r, length = self.radius, self.length
        cylinder_mass = mass * math.pi * r**2 * length / self.volume
        balls_mass = mass - cylinder_mass if not self.flat else 0.0
        along = cylinder_mass * r**2 / 2.0 + balls_mass * 0.4 * r**2
        across = cylinder_mass * (3.0 * r**2 + length**2) / 12.0
        across += balls_mass * (83.0 / 320.0 * r**2 + (length / 2.0 + 0.375 * r) ** 2)
        return np.diag([across, across, along])

    def triangulated(self) -> tuple[np.ndarray, np.ndarray]:
        """Vertices on the surface [mm], shape (vertex_count, 3), and outward triangles, for pictures and files."""
        import trimesh  # takes long, and scenes of soft bodies do without

        if self.flat:
            made = trimesh.creation.cylinder(self.radius, self.length, sections=SECTIONS)
        elif self.length > 0.0:
            made = trimesh.creation.capsule(self.length, self.radius, count=[SECTIONS, SECTIONS])
            made.apply_translation([0.0, 0.0, -made.bounds.mean(axis=0)[2]])
        else:
            made = trimesh.creation.icosphere(SPHERE_SUBDIVISIONS, self.radius)
        return np.array(made.vertices), np.array(made.faces)


def round_shape(body: Shaped) -> RoundShape | None:
    """The round shape that the table of a body or obstacle gives it; None for a box, a plane or a surface."""
    if body.sphere is not None:
        return RoundShape(body.sphere.radius, 0.0, flat=False)
    if body.capsule is not None:
        return RoundShape(body.capsule.radius, body.capsule.length, flat=False)
    if body.cylinder is not None:
        return RoundShape(body.cylinder.radius, body.cylinder.length, flat=True)
    return None
