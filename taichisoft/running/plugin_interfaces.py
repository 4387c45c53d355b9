"""Interfaces that plug-ins implement: renderers, and kinds of geometry."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from taichisoft.errors import PluginError
from taichisoft.mesh.volume_mesh import VolumeMesh

if TYPE_CHECKING:
    from taichisoft.mechanics.state import State

# The base class of every geometry that `taichisoft mesh` meshes.


class Geometry(ABC):
    """Base class of bodies that have been described and checked, but not meshed yet; only `mesh` must be written."""

    @property
    def presets(self) -> Mapping[str, float]:
        """Largest element sizes [mm] by the names that `--preset` takes."""
        return {}

    @property
    def parameters(self) -> Mapping[str, Any] | None:
        """Everything that describes the body, defaults included, for `mesh.json`; None for the tables of its file."""
        return None

    @abstractmethod
    def mesh(self, size: float | None = None) -> VolumeMesh:
        """Fill the body with tetrahedra; the same description and size give the same mesh.

        Closed surface groups whose names begin with "cavity" are air chambers: they point into the silicone, so that
        the volume that they enclose is positive.

        Args:
            size: largest element size [mm] instead of the description's own, from the command line or from a search
                for a number of nodes; may be asked for more than once.

        Raises:
            MeshError: the body cannot be meshed at this size.
        """


# The base class of every renderer, behind `Simulation.render`.


@dataclass(frozen=True)
class CameraView:
    """Where a camera is.

    Attributes:
        eye: position [mm], shape (3,).
        target: point that it looks at [mm], shape (3,).
        up: direction that is up in the picture [-], shape (3,).
    """

    eye: np.ndarray
    target: np.ndarray
    up: np.ndarray


@dataclass(frozen=True)
class CameraFrame:
    """What a camera sees.

    Attributes:
        colour: red, green and blue, shape (height, width, 3), dtype uint8.
        depth: distance of the nearest surface along the optical axis [mm], infinite where nothing is, shape (height,
            width), dtype float32.
        segmentation: number of the body that is seen, by `Model.body_names`, -1 for none, shape (height, width).
        intrinsics: camera matrix K [pixels], shape (3, 3): a point (x, y, z) in the camera's axes (right, down, ahead)
            is seen at K (x, y, z) / z, to the right of the left edge and below the upper one.
        rotation: the camera's axes right, down and ahead in the world, as rows, shape (3, 3).
        eye: position of the camera [mm], shape (3,).
    """

    colour: np.ndarray
    depth: np.ndarray
    segmentation: np.ndarray
    intrinsics: np.ndarray
    rotation: np.ndarray
    eye: np.ndarray


class Renderer(ABC):
    """Base class of renderers; only `picture` must be written.

    A renderer is made as `factory(model, size, camera)` with the arguments of `Simulation.render`, and draws any states
    of that model.
    """

    @abstractmethod
    def picture(self, state: "State", marks: np.ndarray) -> np.ndarray:
        """Draw a state: red, green and blue, shape (height, width, 3), dtype uint8.

        Args:
            state: state of the model.
            marks: points that get a mark [mm], shape (mark_count, 3).
        """

    def frame(self, state: "State", view: CameraView) -> CameraFrame:
        """What a camera sees of a state, with depth and segmentation; a renderer may lack it.

        Raises:
            PluginError: this renderer has no depth.
        """
        raise PluginError(f"{type(self).__qualname__} has no frame() for cameras of scenes")

    def close(self) -> None:
        """Give back what the renderer holds; called when the simulation is closed or deleted."""
