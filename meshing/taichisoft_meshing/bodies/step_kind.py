"""The geometry kind `step`: a body from a STEP file, the voids in it its cavities."""

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from taichisoft.errors import MeshError
from taichisoft.meshes.volume_mesh import VolumeMesh
from taichisoft.plugin_system.geometry import Geometry
from taichisoft.scenes.scene import Table
from taichisoft_meshing.bodies.step_mesher import StepSolid, mesh_step, read_step
from taichisoft_meshing.bodies.tables import Base, Count, Sizes, checked, preset_sizes


class StepTable(Table):
    """A geometry file of the kind `step`."""

    file: Annotated[str, Field(strict=True, min_length=1)]
    """STEP file, beside the TOML; it says itself in which unit it is, and is taken to millimetres."""
    cavities: Count | None = None
    """How many voids the body must have; any number when it is not given."""
    base: Base | None = None
    """Triangles of the outside that make the group "base"."""
    mesh: Sizes = Sizes()


@dataclass(frozen=True)
class StepBody(Geometry):
    """A body from a STEP file.

    Attributes:
        tables: as TOML gives them.
        file: begins every error about them, and the name of the STEP file is relative to it.

    Raises:
        MeshError: something in the tables is not valid.
    """

    tables: Mapping[str, Any]
    file: Path

    def __post_init__(self) -> None:
        _ = self.table

    @cached_property
    def table(self) -> StepTable:
        """The tables, checked."""
        return checked(StepTable, self.tables, self.file)

    @cached_property
    def solid(self) -> StepSolid:
        """What the STEP file describes, checked."""
        solid = read_step(self.file.parent / self.table.file)
        found, wanted = len(solid.cavity_volumes), self.table.cavities
        if wanted is not None and found != wanted:
            raise MeshError(
                f"{self.file}: cavities = {wanted}: {solid.path} has {found}; a cavity is a void without an opening"
            )
        if wanted is None and found == 0:
            warnings.warn(f"{solid.path}: the body has no cavity; a cavity is a void without an opening", stacklevel=2)
        return solid

    @property
    def parameters(self) -> dict[str, Any]:
        """The tables with the defaults of what they leave open."""
        return self.table.model_dump(mode="json", exclude_none=True)

    @property
    def presets(self) -> dict[str, float]:
        """Largest element sizes [mm] by name."""
        return preset_sizes(self.solid.extent)

    def mesh(self, size: float | None = None) -> VolumeMesh:
        """Mesh it with gmsh; `size` [mm] replaces the largest element size and scales the smallest with it."""
        try:
            sizes = self.table.mesh.fitted(self.solid.extent, self.solid.volume, size)
        except ValueError as error:
            raise MeshError(f"{self.file}: {error}") from error
        return mesh_step(self.solid, sizes, str(self.file), self.table.base)
