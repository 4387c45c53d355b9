"""The geometry kind `pneunet_finger`: a finger's dimensions from TOML."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from taichisoft.meshes.volume_mesh import VolumeMesh
from taichisoft.plugin_system.geometry import Geometry
from taichisoft_meshing.finger.cavity_walls import thin_walls
from taichisoft_meshing.finger.mesher import mesh_finger
from taichisoft_meshing.finger.parameters import FingerParameters
from taichisoft_meshing.geometry_file import checked

PRESETS = {"coarse": 3.6, "medium": 1.55, "fine": 1.0}
"""Element size at the cavity over the thickness of the thinnest wall [-]; the tutorial's finger has 590, 2000 and 5700
nodes."""


@dataclass(frozen=True)
class PneunetFinger(Geometry):
    """A finger that the tables of a file describe.

    Attributes:
        tables: tables of the file, as TOML gives them.
        file: path of the file; begins every error.

    Raises:
        MeshError: a dimension is not valid.
    """

    tables: Mapping[str, Any]
    file: Path

    def __post_init__(self) -> None:
        self.dimensions()

    def dimensions(self, size: float | None = None) -> FingerParameters:
        """The dimensions, checked; `size` [mm] replaces the largest element size and scales the smallest with it.

        Raises:
            MeshError: a dimension or the size is not valid.
        """
        finger = checked(FingerParameters, self.tables, self.file)
        if size is None:
            return finger
        smallest = size * finger.mesh.smallest / finger.mesh.largest
        sizes = {**self.tables.get("mesh", {}), "largest": size, "smallest": smallest}
        return checked(FingerParameters, {**self.tables, "mesh": sizes}, self.file)

    @property
    def parameters(self) -> dict[str, Any]:
        """Every dimension, defaults and what follows from thicknesses of walls included."""
        return self.dimensions().model_dump()

    @property
    def presets(self) -> dict[str, float]:
        """Largest element size [mm] by name: a multiple of the thinnest wall at the cavity, graded as in the file."""
        finger = self.dimensions()
        grading = finger.mesh.largest / finger.mesh.smallest
        return {name: times * float(thin_walls(finger)[0]) * grading for name, times in PRESETS.items()}

    def mesh(self, size: float | None = None) -> VolumeMesh:
        """Mesh the finger with gmsh; `size` [mm] replaces the largest element size and scales the smallest with it."""
        return mesh_finger(self.dimensions(size), str(self.file))
