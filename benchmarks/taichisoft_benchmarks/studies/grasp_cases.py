"""The grasps that are tried: what is grasped, how heavy it is, how hard it is pressed, and how much it rubs."""

from dataclasses import dataclass, replace
from typing import Any

from taichisoft_benchmarks.studies.grasped_objects import OBJECTS, ROUND


@dataclass(frozen=True)
class Grasp:
    """One grasp.

    Attributes:
        object: what is grasped, a key of `OBJECTS`.
        exact: whether its round shape is given as such instead of by triangles.
        mass: of all of it [g].
        pressure: in the three fingers [kPa].
        friction: between all bodies [-].
        element: of the fingers, and of what is soft.
    """

    object: str
    exact: bool = False
    mass: float = 30.0
    pressure: float = 80.0
    friction: float = 0.6
    element: str = "linear"

    @property
    def name(self) -> str:
        """What `--only` looks for, and the name of the file of its figures."""
        words = [*self.object.split(), *(["exact"] if self.exact else [])]
        words += [self.element] if self.element != "linear" else []
        return "-".join([*words, f"{self.mass:g}g", f"{self.pressure:g}kPa", f"{self.friction:g}"])


VARIED: tuple[dict[str, Any], ...] = (
    {"mass": 12.0, "pressure": 50.0},
    {"mass": 12.0, "friction": 0.2},
    {"mass": 60.0, "pressure": 100.0},
    {"friction": 1.5},
    {"mass": 100.0, "pressure": 100.0, "friction": 1.0},
    {"mass": 100.0, "pressure": 120.0, "friction": 1.5},
)
"""What is varied with a cube and with a ball."""


PRESSURE_SHARES = {"linear": 1.0, "smoothed": 0.45, "quadratic": 0.45}
"""Pressures over those of linear fingers [-]: on the shipped mesh the others bend 2.3 and 2.4 times as far."""


def all_grasps(element: str = "linear") -> list[Grasp]:
    """Every object once, round ones also by their exact shape, and a cube and a ball at other settings.

    The masses stay where fingers of other elements have less pressure, so that these hold with less to spare.
    """
    grasps = []
    for name in OBJECTS:
        forms = (False, True) if name in ROUND else (False,)
        grasps += [Grasp(name, exact) for exact in forms]
    grasps.append(Grasp("cube", mass=12.0, pressure=30.0))  # a ball is out of reach of the fingers then
    for name, exact in (("cube", False), ("ball", False), ("ball", True)):
        grasps += [Grasp(name, exact, **changes) for changes in VARIED]
    share = PRESSURE_SHARES[element]
    return [replace(grasp, element=element, pressure=share * grasp.pressure) for grasp in grasps]
