"""The geometry kind `surfaces`: a body between closed surfaces of triangles."""

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field

from taichisoft.errors import MeshError
from taichisoft.meshes.volume_mesh import VolumeMesh
from taichisoft.plugin_system.geometry import Geometry
from taichisoft.scenes.scene import Positive, Table
from taichisoft_meshing.bodies.hollow_body import HollowBody, read_hollow_body
from taichisoft_meshing.bodies.surface_mesher import keep_surfaces, remesh_surfaces
from taichisoft_meshing.bodies.tables import Base, Count, Sizes, checked, preset_sizes

FileName = Annotated[str, Field(strict=True, min_length=1)]


class SurfacesTable(Table):
    """A geometry file of the kind `surfaces`."""

    outer: FileName
    """STL, OBJ or PLY file of the outside, beside the TOML; cavities may be in it, too."""
    cavity: Annotated[
        tuple[FileName, ...], BeforeValidator(lambda given: [given] if isinstance(given, str) else given)
    ] = ()
    """Further file, or files, of cavities; a cavity that `outer` has too counts once."""
    cavities: Count | None = None
    """How many there must be in all; any number when it is not given."""
    scale: Positive = 1.0
    """Millimetres in one unit of the files: 1000 for metres."""
    keep_surface: Annotated[bool, Field(strict=True)] = False
    """Whether the tetrahedra end at exactly the given triangles; the surfaces are meshed anew otherwise."""
    feature_angle: Annotated[float, Field(strict=True, gt=0, lt=180)] = 40.0
    """[degrees] Edges with more than this between their two triangles stay edges when the surfaces are meshed anew."""
    base: Base | None = None
    """Triangles of the outside that make the group "base"."""
    mesh: Sizes = Sizes()


@dataclass(frozen=True)
class SurfacesBody(Geometry):
    """A body between surfaces from files.

    Attributes:
        tables: as TOML gives them.
        file: begins every error about them, and the names of surface files are relative to it.

    Raises:
        MeshError: something in the tables is not valid.
    """

    tables: Mapping[str, Any]
    file: Path

    def __post_init__(self) -> None:
        _ = self.table

    @cached_property
    def table(self) -> SurfacesTable:
        """The tables, checked."""
        return checked(SurfacesTable, self.tables, self.file)

    @cached_property
    def body(self) -> HollowBody:
        """What the files describe, checked and mended."""
        table, folder = self.table, self.file.parent
        body = read_hollow_body(folder / table.outer, [folder / name for name in table.cavity], table.scale)
        found = len(body.cavities)
        if table.cavities is not None and found != table.cavities:
            raise MeshError(f"{self.file}: cavities = {table.cavities}: the files have {found}")
        if table.cavities is None and found == 0:
            warnings.warn(f"{folder / table.outer}: the body has no cavity", stacklevel=2)
        return body

    @property
    def parameters(self) -> dict[str, Any]:
        """The tables with the defaults of what they leave open."""
        return self.table.model_dump(mode="json", exclude_none=True)

    @property
    def presets(self) -> dict[str, float]:
        """Largest element sizes [mm] by name."""
        return preset_sizes(self._extent)

    @property
    def _extent(self) -> np.ndarray:
        extent: np.ndarray = np.ptp(self.body.outer.vertices, axis=0)
        return extent

    def mesh(self, size: float | None = None) -> VolumeMesh:
        """Mesh it with gmsh; `size` [mm] replaces the largest element size and scales the smallest with it."""
        table = self.table
        try:
            sizes = table.mesh.fitted(self._extent, self.body.volume, size)
        except ValueError as error:
            raise MeshError(f"{self.file}: {error}") from error
        if table.keep_surface:
            return keep_surfaces(self.body, sizes, str(self.file), table.base)
        return remesh_surfaces(self.body, sizes, table.feature_angle, str(self.file), table.base)
