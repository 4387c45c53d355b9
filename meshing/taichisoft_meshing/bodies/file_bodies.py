"""The geometry kinds `step` and `surfaces`: bodies between closed surfaces, which files describe."""

import warnings
from abc import abstractmethod
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator, Field

from taichisoft.errors import MeshError
from taichisoft.meshes import VolumeMesh
from taichisoft.scenes import Positive, Table
from taichisoft_meshing.bodies.hollow_body import HollowBody, read_hollow_body
from taichisoft_meshing.bodies.meshed_body import with_base
from taichisoft_meshing.bodies.step_mesher import StepSolid, mesh_step, read_step
from taichisoft_meshing.bodies.surface_mesher import keep_surfaces, remesh_surfaces
from taichisoft_meshing.bodies.tables import BasePlane, Count, FittedSizes, Sizes, SolidSizes, preset_sizes
from taichisoft_meshing.bodies.wall_splitting import with_elements_across
from taichisoft_meshing.curved_sides import CurvedSides, with_curved_sides
from taichisoft_meshing.geometry_file import CheckedGeometry

FileName = Annotated[str, Field(strict=True, min_length=1)]


class StepTable(Table):
    """A geometry file of the kind `step`."""

    file: FileName
    """STEP file, beside the TOML; it names its unit itself, and is converted to millimetres."""
    cavities: Count | None = None
    """Number of voids that the body must have; any number when it is not given."""
    base: BasePlane | None = None
    """Triangles of the outside that make the group "base"."""
    mesh: SolidSizes = SolidSizes()


class SurfacesTable(Table):
    """A geometry file of the kind `surfaces`."""

    outer: FileName
    """STL, OBJ or PLY file of the outside and perhaps of cavities, beside the TOML."""
    cavity: Annotated[
        tuple[FileName, ...], BeforeValidator(lambda given: [given] if isinstance(given, str) else given)
    ] = ()
    """Further file, or files, of cavities; a cavity that `outer` has too counts once."""
    cavities: Count | None = None
    """Number of cavities that the files must have together; any number when it is not given."""
    scale: Positive = 1.0
    """Millimetres in one unit of the files, for example 1000 for metres."""
    keep_surface: Annotated[bool, Field(strict=True)] = False
    """Whether the tetrahedra end at exactly the given triangles; otherwise the surfaces are remeshed."""
    feature_angle: Annotated[float, Field(strict=True, gt=0, lt=180)] = 40.0
    """Angle between two triangles above which their edge stays an edge when the surfaces are remeshed [degrees]."""
    base: BasePlane | None = None
    """Triangles of the outside that make the group "base"."""
    mesh: Sizes = Sizes()


class _BodyFromFiles(CheckedGeometry):
    """A geometry whose tables name files; they are read when the body is first needed."""

    @property
    @abstractmethod
    def body(self) -> Any:
        """The body that the files describe, checked; it has a `volume` [mm^3] and an `extent` [mm], shape (3,)."""

    @property
    def presets(self) -> dict[str, float]:
        """Largest element sizes [mm] by name."""
        return preset_sizes(self.body.extent)

    def mesh(self, size: float | None = None) -> VolumeMesh:
        """Mesh the body with gmsh; `size` [mm] replaces the largest element size and scales the smallest with it."""
        try:
            body = self.body
            sizes = self.table.mesh.fitted(body.extent, body.volume, size, body.cavity_volumes)
        except ValueError as error:
            raise MeshError(f"{self.file}: {error}") from error
        mesh, sides = self._fill(sizes)
        mesh = with_elements_across(mesh, sizes)
        return with_base(mesh if sides is None else with_curved_sides(mesh, sides), self.table.base)

    @abstractmethod
    def _fill(self, sizes: FittedSizes) -> tuple[VolumeMesh, CurvedSides | None]:
        """Fill the body with tetrahedra of four nodes; and the curved sides for ten, if they are asked for."""

    def _check_cavities(self, found: int, place: Path, where: str, hint: str = "") -> None:
        """Raise MeshError for another number of cavities than the tables have; warn of a body without cavities."""
        wanted = self.table.cavities
        if wanted is not None and found != wanted:
            raise MeshError(f"{self.file}: cavities = {wanted}: {where} {found}{hint}")
        if wanted is None and found == 0:
            warnings.warn(f"{place}: the body has no cavity{hint}", stacklevel=4)


class StepBody(_BodyFromFiles):
    """A body from a STEP file, whose cavities are the voids in it."""

    table_type = StepTable

    @cached_property
    def body(self) -> StepSolid:
        """The body that the STEP file describes, checked."""
        solid = read_step(self.file.parent / self.table.file)
        hint = "; a cavity is a void without an opening"
        self._check_cavities(len(solid.cavity_volumes), solid.path, f"{solid.path} has", hint)
        return solid

    def _fill(self, sizes: FittedSizes) -> tuple[VolumeMesh, CurvedSides | None]:
        return mesh_step(self.body, sizes, str(self.file), curved=self.table.mesh.order == 2)


class SurfacesBody(_BodyFromFiles):
    """A body between surfaces from files."""

    table_type = SurfacesTable

    @cached_property
    def body(self) -> HollowBody:
        """The body that the surface files describe, checked."""
        table, folder = self.table, self.file.parent
        body = read_hollow_body(folder / table.outer, [folder / name for name in table.cavity], table.scale)
        self._check_cavities(len(body.cavities), folder / table.outer, "the files have")
        return body

    def _fill(self, sizes: FittedSizes) -> tuple[VolumeMesh, CurvedSides | None]:
        if self.table.keep_surface:
            return keep_surfaces(self.body, sizes, str(self.file)), None
        return remesh_surfaces(self.body, sizes, self.table.feature_angle, str(self.file)), None
