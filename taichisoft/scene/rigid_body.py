"""Rigid objects, obstacles, their shapes, and moving frames, as a user describes them."""

import itertools
import math
from typing import Annotated, ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from taichisoft.scene.table import (
    Colour,
    Direction,
    Groups,
    NotNegative,
    Number,
    Positive,
    Rule,
    Table,
    Vector,
    ordered,
)

# Shapes that a rigid body or an obstacle can have without a surface file.

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


# Frames as a user describes them: what soft bodies are anchored to and rigid bodies follow, moved as a whole.

BASE = "base"
"""Name of the first frame, which every scene has."""


class FramePath(Table):
    """A given motion: straight and at constant rates from each pose to the next, at rest before and after."""

    times: Annotated[list[NotNegative], Field(min_length=2)]
    """Times of the poses [s], rising; before the first the frame is where the scene puts its bodies."""
    translations: list[Vector] | None = None
    """Translation at each time [mm], the first of them 0; none when they are not given."""
    rotations: list[Vector] | None = None
    """Rotation vector about the pivot at each time [degrees], the first of them 0; 360 degrees are a whole turn. None
    when they are not given."""

    @model_validator(mode="after")
    def _check_poses(self) -> Self:
        if any(later <= earlier for earlier, later in itertools.pairwise(self.times)):
            raise ValueError(f"times must rise; they are {self.times}")
        poses = {key: getattr(self, key) for key in ("translations", "rotations") if getattr(self, key) is not None}
        if not poses:
            raise ValueError("needs translations or rotations")
        for key, values in poses.items():
            if len(values) != len(self.times):
                raise ValueError(f"{key} has {len(values)} rows; {len(self.times)} are needed, one for each time")
            if any(values[0]):
                raise ValueError(f"{key} begins with {list(values[0])}; it must be 0, where the scene puts the bodies")
        return self


class HingeSettings(Table):
    """An axis about which a frame turns by an angle, as a servo motor turns its horn."""

    axis: Direction
    """Direction of the axis through the pivot, of any length; a positive angle turns by the right-hand rule."""
    lowest_angle: Number | None = None
    """Smallest angle [degrees]."""
    highest_angle: Number | None = None
    """Largest angle [degrees]."""
    rules = (
        *ordered("angle"),
        Rule("lowest_angle <= 0", "lowest_angle ({lowest_angle:g}) must not exceed 0, where the scene puts the bodies"),
        Rule(
            "highest_angle >= 0",
            "highest_angle ({highest_angle:g}) must not be below 0, where the scene puts the bodies",
        ),
    )

    @property
    def unit_axis(self) -> np.ndarray:
        """Unit vector along the axis, shape (3,)."""
        return np.array(self.axis) / math.hypot(*self.axis)


class FrameSettings(Table):
    """Something that moves as requested, whatever acts on it: a jaw, the root of a finger, a link of an arm."""

    follows: str | None = None
    """Name of the frame that carries it, such as "base"; it moves in space when it is not given."""
    pivot: Vector | None = None
    """The point about which it turns [mm]; the mean of the nodes that are anchored to it when it is not given, the
    origin where there are none."""
    speed: Positive | None = None
    """Fastest motion [mm/s]."""
    turning_speed: Positive | None = None
    """Fastest turn [degrees/s]."""
    path: FramePath | None = None
    """A motion that the scene gives; no controller moves the frame then."""
    hinge: HingeSettings | None = None
    """What the frame turns about; nothing else can be asked of it but an angle then."""
    no_effect_beside: ClassVar = {"path": ("hinge", "speed", "turning_speed"), "hinge": ("speed",)}


# Rigid objects and obstacles as a user describes them.


class RigidSpringsSettings(Table):
    """Springs between a rigid body and a frame, at rest where the scene puts both."""

    follows: str | None = None
    """Frame to which they lead; to a place in space when it is not given."""
    stiffness: NotNegative
    """Against displacements of the centre of mass [mN/mm]."""
    angular_stiffness: NotNegative = 0.0
    """Against turns [mN mm/rad]."""
    rayleigh_stiffness: NotNegative = 0.0
    """Time b [s] of their Rayleigh damping: their forces are those of where the body will be b later."""


class RigidBodySettings(Shaped):
    """A rigid object; mass, centre of mass and inertia come from its shape or closed surface unless they are given."""

    surface: str | None = None
    """Closed surface file; either this or a shape."""
    scale: Positive = 1.0
    """Factor on the surface's coordinates [-]; not of a shape."""
    smooth: bool = False
    """Whether the surface stands for a curved one without edges, such as a ball's: it touches as that one does."""
    mass: Positive | None = None
    """Mass [kg]; either this or density."""
    density: Positive | None = None
    """Density [kg/mm^3]."""
    inertia: tuple[Vector, Vector, Vector] | None = None
    """Inertia about the centre of mass, in the surface's axes [kg mm^2]."""
    centre_of_mass: Vector | None = None
    """Centre of mass in the surface's scaled coordinates [mm]."""
    position: Vector = (0.0, 0.0, 0.0)
    """Place of the surface's origin at the start [mm]."""
    rotation: Vector = (0.0, 0.0, 0.0)
    """Turns about the x, y and z axes, in this order, at the start [degrees]."""
    velocity: Vector = (0.0, 0.0, 0.0)
    """Velocity of the centre of mass at the start [mm/s]."""
    angular_velocity: Vector = (0.0, 0.0, 0.0)
    """Angular velocity at the start [rad/s]."""
    follows: str | None = None
    """Frame that carries the body instead of forces: "base", as a palm that is screwed to the gripper, or one of
    `frames`; it has no mass, and its surface may be open."""
    springs: RigidSpringsSettings | None = None
    """Springs that hold the body, as the table [rigid_bodies.NAME.springs]."""
    collides: bool = True
    """Whether the body touches others; one that does not goes through them."""
    groups: Groups = []
    """Surfaces that have a group in common do not touch each other."""
    colour: Colour | None = None
    """Colour in pictures and on pages, "#rrggbb"; that of rigid bodies when it is not given."""
    axes: bool = False
    """Whether pictures and pages show its axes: the axes of its surface, from its centre of mass."""
    alternatives = (("surface", *SHAPES), ("mass", "density", "follows"))
    no_effect_beside: ClassVar = {
        **Shaped.no_effect_beside,
        "follows": ("inertia", "centre_of_mass", "velocity", "angular_velocity", "springs"),
    }


class PlaneSettings(Table):
    """An infinite plane, solid on the side that its normal points away from."""

    point: Vector
    """Any point of the plane [mm]."""
    normal: Direction
    """Direction from the solid side to the free one, of any length."""


class ObstacleSettings(Shaped):
    """Something that never moves: a plane, or a shape or surface that may be turned and shifted."""

    plane: PlaneSettings | None = None
    surface: str | None = None
    """Surface file; either this, a shape or plane."""
    scale: Positive = 1.0
    """Factor on the surface's coordinates [-]; not of a shape."""
    smooth: bool = False
    """Whether the surface stands for a curved one without edges, such as a ball's: it touches as that one does."""
    rotation: Vector = (0.0, 0.0, 0.0)
    """Turns about the x, y and z axes, in this order [degrees]."""
    translation: Vector = (0.0, 0.0, 0.0)
    """Shift after the rotation [mm]."""
    groups: Groups = []
    """Surfaces that have a group in common do not touch each other; a plane touches all."""
    colour: Colour | None = None
    """Colour in pictures and on pages, "#rrggbb"; that of obstacles, or of the floor, when it is not given."""
    alternatives = (("plane", "surface", *SHAPES),)
    no_effect_beside: ClassVar = {
        **Shaped.no_effect_beside,
        "plane": ("scale", "smooth", "rotation", "translation", "groups"),
    }
