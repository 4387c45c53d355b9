"""What a page draws: surfaces and planes that stay the same, and frames that say where everything is."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from taichisoft.bodies.body_axes import BodyAxes
from taichisoft.bodies.surfaces import Plane, Surface
from taichisoft.scenes.scene import Scene


@dataclass(frozen=True)
class PageScene:
    """What stays the same while a page shows one frame after the other.

    Attributes:
        scene: the scene that was or is simulated.
        surfaces: surfaces in the order of `Frame.vertices`.
        planes: infinite obstacles.
        cavities: names of the cavities.
        cables: names of the cables.
        axes: by name, the axes of bodies that are shown, in the order of `Frame.axes`.
    """

    scene: Scene
    surfaces: Sequence[Surface]
    planes: Sequence[Plane]
    cavities: Sequence[str]
    cables: Sequence[str]
    axes: Mapping[str, BodyAxes] = field(default_factory=dict)


@dataclass(frozen=True)
class Frame:
    """What a page shows at one time of a run.

    Attributes:
        time: time of the run [s].
        vertices: positions [mm] of each surface's vertices, each of shape (vertex_count, 3).
        cable_lines: ends of the lines from point to point of all cables [mm], shape (line_count, 2, 3).
        cable_tensions: tension of each of these lines [mN], shape (line_count,).
        contact_points: points of contact [mm], shape (contact_count, 3).
        contact_forces: forces on the second body of each contact [mN], shape (contact_count, 3).
        plotted: a row of `curves.plotted_row`, which begins with the pressures of all cavities.
        axes: origin [mm] and unit vectors along x, y and z of the bodies' axes, shape (axes_count, 4, 3).
    """

    time: float
    vertices: Sequence[np.ndarray]
    cable_lines: np.ndarray
    cable_tensions: np.ndarray
    contact_points: np.ndarray
    contact_forces: np.ndarray
    plotted: np.ndarray
    axes: np.ndarray = field(default_factory=lambda: np.zeros((0, 4, 3)))


def lines_of_cables(points: Sequence[np.ndarray], tensions: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """`Frame.cable_lines` and `Frame.cable_tensions`.

    Args:
        points: points of each cable [mm], each of shape (point_count, 3).
        tensions: tensions between these points [mN], each of shape (point_count - 1,).
    """
    lines = [np.stack([one[:-1], one[1:]], axis=1) for one in points]
    return np.concatenate([np.zeros((0, 2, 3)), *lines]), np.concatenate([np.zeros(0), *tensions])
