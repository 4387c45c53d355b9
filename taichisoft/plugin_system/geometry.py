"""The base class of every geometry that `taichisoft mesh` meshes."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any

from taichisoft.meshes.volume_mesh import VolumeMesh


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
