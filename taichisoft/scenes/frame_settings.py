"""Frames as a user describes them: what soft bodies are anchored to and rigid bodies follow, moved as a whole."""

import itertools
import math
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from taichisoft.scenes.table import NotNegative, Number, Positive, Table, Vector, check_order

BASE = "base"
"""Name of the first frame, which every scene has."""
SHORTEST_AXIS = 1e-9


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

    axis: Vector
    """Direction of the axis through the pivot, of any length; a positive angle turns by the right-hand rule."""
    lowest_angle: Number | None = None
    """Smallest angle [degrees]."""
    highest_angle: Number | None = None
    """Largest angle [degrees]."""

    @property
    def unit_axis(self) -> np.ndarray:
        """Unit vector along the axis, shape (3,)."""
        return np.array(self.axis) / math.hypot(*self.axis)

    @model_validator(mode="after")
    def _check_axis(self) -> Self:
        if math.hypot(*self.axis) < SHORTEST_AXIS:
            raise ValueError(f"axis = {list(self.axis)}: has no direction; its length must not vanish")
        check_order(self, "angle")
        if (self.lowest_angle or 0.0) > 0.0 or (self.highest_angle or 0.0) < 0.0:
            raise ValueError("lowest_angle and highest_angle must have 0 between them, where the scene puts the bodies")
        return self


class FrameSettings(Table):
    """Something that moves as it is asked to, whatever acts on it: a jaw, the root of a finger, a link of an arm."""

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

    @model_validator(mode="after")
    def _check_drive(self) -> Self:
        if self.path is not None and self.hinge is not None:
            raise ValueError("path and hinge are both given; give one of them")
        for key, why in (("path", "which has its own times"), ("hinge", "which only turns")):
            limits = ("speed", "turning_speed") if key == "path" else ("speed",)
            for limit in limits:
                if getattr(self, key) is not None and getattr(self, limit) is not None:
                    raise ValueError(f"{limit} would have no effect beside a {key}, {why}; remove it")
        return self
