"""What can be meshed: the interface of a geometry, behind `taichisoft mesh`."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol

from taichisoft.meshes.volume_mesh import VolumeMesh


class Geometry(Protocol):
    """A body that has been described and checked, but not meshed yet."""

    def mesh(self, size: float | None = None) -> "VolumeMesh":
        """Fill the body with tetrahedra; the same description and size give the same mesh.

        Closed surface groups whose names begin with "cavity" are air chambers: they point into the silicone, so that
        the volume that they enclose is positive.

        Args:
            size: largest element size [mm] instead of the description's own, from the command line or from a search
                for a number of nodes; may be asked for more than once.

        Raises:
            MeshError: the body cannot be meshed at this size.
        """
        ...


class GeometryKind(Protocol):
    """What `taichisoft_geometry_kinds` maps a name to."""

    def __call__(self, tables: Mapping[str, Any], file: Path) -> Geometry:
        """Check the tables of a TOML file, and make a geometry from them.

        Raises:
            MeshError: something in them is not valid; begins with the file, and says what would be.
        """
        ...
