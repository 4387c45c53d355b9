"""What a page draws: surfaces and planes that stay the same, and frames that say where everything is."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from taichisoft.bodies.surfaces import Plane, Surface
from taichisoft.scenes.scene import Scene


@dataclass(frozen=True)
class PageScene:
    """What stays the same while a page shows one frame after the other.

    Attributes:
        scene: The scene that was or is simulated.
        surfaces: Surfaces in the order of `Frame.vertices`.
        planes: Infinite obstacles.
        cavities: Names of the cavities.
    """

    scene: Scene
    surfaces: Sequence[Surface]
    planes: Sequence[Plane]
    cavities: Sequence[str]


@dataclass(frozen=True)
class Frame:
    """What a page shows at one time of a run.

    Attributes:
        time: Time of the run [s].
        vertices: Positions [mm] of each surface's vertices, each of shape (vertex_count, 3).
        contact_points: Points of contact [mm], shape (contact_count, 3).
        contact_forces: Forces on the second body of each contact [mN], shape (contact_count, 3).
        plotted: A row of `curves.plotted_row`.
    """

    time: float
    vertices: Sequence[np.ndarray]
    contact_points: np.ndarray
    contact_forces: np.ndarray
    plotted: np.ndarray
