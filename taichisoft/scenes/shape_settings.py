"""Shapes that a rigid body or an obstacle can have without a surface file."""

from typing import ClassVar

from taichisoft.scenes.table import NotNegative, Positive, Table

SHAPES = ("box", "sphere", "cylinder", "capsule")
"""Keys of the shapes; each stands in the place of `surface`."""


class Sphere(Table):
    """A ball about the origin."""

    radius: Positive
    """Radius [mm]."""


class Cylinder(Table):
    """A round cylinder about the origin, its axis along z."""

    radius: Positive
    """Radius [mm]."""
    length: Positive
    """Distance of the flat ends [mm]."""


class Capsule(Table):
    """A round cylinder with a half ball on each end, about the origin, its axis along z."""

    radius: Positive
    """Radius of the cylinder and of the half balls [mm]."""
    length: NotNegative
    """Distance of the half balls' centres, which is the length of the cylindrical part [mm]."""


class Shaped(Table):
    """What has one of the shapes, or none."""

    box: tuple[Positive, Positive, Positive] | None = None
    """Edge lengths [mm] of a box about the origin."""
    sphere: Sphere | None = None
    """A ball about the origin, by its radius."""
    cylinder: Cylinder | None = None
    """A round cylinder about the origin, along z, by its radius and length."""
    capsule: Capsule | None = None
    """A cylinder along z that ends in half balls, by its radius and the length between their centres."""
    no_effect_beside: ClassVar = {shape: ("scale", "smooth") for shape in SHAPES}
