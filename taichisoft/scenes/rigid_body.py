"""Rigid objects and obstacles as a user describes them."""

import math
from typing import ClassVar, Self

from pydantic import model_validator

from taichisoft.scenes.colours import Colour
from taichisoft.scenes.shape_settings import SHAPES, Shaped
from taichisoft.scenes.table import Groups, NotNegative, Positive, Table, Vector


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
    alternatives = (("surface", *SHAPES),)

    @model_validator(mode="after")
    def _check_mass(self) -> Self:
        given = [key for key in ("mass", "density") if getattr(self, key) is not None]
        if self.follows is None and len(given) != 1:
            raise ValueError(f"exactly one of mass, density is needed; given: {', '.join(given) or 'none'}")
        moved = {"mass", "density", "inertia", "centre_of_mass", "velocity", "angular_velocity", "springs"}
        useless = [key for key in type(self).model_fields if key in moved and self._is_given(key)]
        if self.follows is not None and useless:
            raise ValueError(f"{', '.join(useless)} would have no effect beside follows; remove it")
        return self

    def _is_given(self, key: str) -> bool:
        return bool(getattr(self, key) != type(self).model_fields[key].default)


SHORTEST_NORMAL = 1e-9


class PlaneSettings(Table):
    """An infinite plane, solid on the side that its normal points away from."""

    point: Vector
    """Any point of the plane [mm]."""
    normal: Vector
    """Direction from the solid side to the free one, of any length."""

    @model_validator(mode="after")
    def _check_normal(self) -> Self:
        if math.hypot(*self.normal) < SHORTEST_NORMAL:
            raise ValueError(f"normal = {list(self.normal)}: has no direction; its length must not vanish")
        return self


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
