"""A finger's dimensions from TOML; errors name the file, the key, its value and what would be valid."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from taichisoft.errors import MeshError
from taichisoft.meshes.volume_mesh import VolumeMesh
from taichisoft.plugin_system.geometry import Geometry
from taichisoft.scenes.validation_errors import first_problem
from taichisoft_meshing.finger.cavity_walls import thin_walls
from taichisoft_meshing.finger.parameters import FingerParameters
from taichisoft_meshing.geometry_file import read_tables

# Sizes at the cavity, over the thickness of the thinnest wall: nodes of the tutorial's finger 590, 2000 and 5700.
PRESETS = {"coarse": 3.6, "medium": 1.55, "fine": 1.0}


@dataclass(frozen=True)
class PneunetFinger(Geometry):
    """The geometry kind `pneunet_finger`: made from the tables of a finger file.

    Attributes:
        tables: as TOML gives them.
        file: begins every error.

    Raises:
        MeshError: a dimension is not valid.
    """

    tables: Mapping[str, Any]
    file: Path

    def __post_init__(self) -> None:
        self._finger()

    @property
    def parameters(self) -> dict[str, Any]:
        """Every dimension, defaults and what follows from thicknesses of walls included."""
        return self._finger().model_dump()

    @property
    def presets(self) -> dict[str, float]:
        """Largest element size [mm] by name: so many times the thinnest wall at the cavity, graded as in the file."""
        finger = self._finger()
        grading = finger.mesh.largest / finger.mesh.smallest
        return {name: times * float(thin_walls(finger)[0]) * grading for name, times in PRESETS.items()}

    def mesh(self, size: float | None = None) -> VolumeMesh:
        """Mesh it with gmsh; `size` [mm] replaces the largest element size and scales the smallest with it."""
        from taichisoft_meshing.finger.mesher import mesh_finger

        return mesh_finger(_resized(self.tables, str(self.file), size), str(self.file))

    def _finger(self) -> FingerParameters:
        return finger_from_dict(self.tables, str(self.file))


def read_finger(path: str | Path, size: float | None = None) -> FingerParameters:
    """Read a finger file; `size` [mm] replaces its largest element size and scales the smallest with it.

    Raises:
        MeshError: the file is missing or no TOML, or a dimension is not valid.
    """
    _, tables = read_tables(Path(path))
    return _resized(tables, str(path), size)


def finger_from_dict(document: Mapping[str, Any], source: str = "finger") -> FingerParameters:
    """Make a finger from plain tables, as TOML gives them; `source` begins every error.

    Raises:
        MeshError: a dimension is not valid.
    """
    try:
        return FingerParameters.model_validate(dict(document))
    except ValidationError as error:
        raise MeshError(f"{source}: {first_problem(error, FingerParameters)}") from error


def _resized(tables: Mapping[str, Any], source: str, size: float | None) -> FingerParameters:
    finger = finger_from_dict(tables, source)
    if size is None:
        return finger
    sizes = {**tables.get("mesh", {}), "largest": size, "smallest": size * finger.mesh.smallest / finger.mesh.largest}
    return finger_from_dict({**tables, "mesh": sizes}, source)
