"""The geometry kinds `step` and `surfaces`: bodies between closed surfaces, which files describe."""

import re
from abc import abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator, Field

from taichisoft.caller_warnings import warn_caller
from taichisoft.errors import MeshError
from taichisoft.meshes import VolumeMesh
from taichisoft.scenes import BASE, Positive, Table
from taichisoft_meshing.bodies.cad_body import CadBody, read_step
from taichisoft_meshing.bodies.hollow_body import HollowBody, read_hollow_body
from taichisoft_meshing.bodies.meshed_body import with_base
from taichisoft_meshing.bodies.openings import Opening
from taichisoft_meshing.bodies.step_mesher import mesh_step
from taichisoft_meshing.bodies.surface_mesher import keep_surfaces, remesh_surfaces
from taichisoft_meshing.bodies.tables import BasePlane, Count, FittedSizes, Sizes, SolidSizes, preset_sizes
from taichisoft_meshing.bodies.wall_splitting import with_elements_across
from taichisoft_meshing.curved_sides import CurvedSides, with_curved_sides
from taichisoft_meshing.geometry_file import CheckedGeometry

FileName = Annotated[str, Field(strict=True, min_length=1)]
Number = Annotated[int, Field(strict=True, ge=1)]
Numbers = Annotated[tuple[Number, ...], BeforeValidator(lambda given: (given,) if isinstance(given, int) else given)]

SAID = 4
"""Number of openings that a message names."""


def _group_name(name: str) -> str:
    if not re.fullmatch(r"[\w.-]+", name) or re.fullmatch(r"silicone|outer|cavity(_\d+)?", name):
        raise ValueError("must be a name of letters, digits, '_', '.', '-' that no other group has")
    return name


GroupName = Annotated[str, AfterValidator(_group_name)]


class StepTable(Table):
    """A geometry file of the kind `step`."""

    file: FileName
    """STEP file, beside the TOML; it names its unit itself, and is converted to millimetres."""
    cavities: Count | None = None
    """Number of cavities that the body must have; any number when it is not given."""
    close_inlets: Annotated[bool, Field(strict=True)] | Numbers | None = None
    """Whether chambers that are open to the outside get caps and are cavities; or the numbers of their openings, from 1
    in the order of `taichisoft mesh info`. When it is not given, they stay open, and a warning names them."""
    solids: Mapping[GroupName, Number] = Field(default_factory=dict)
    """Names of element groups, and the number of the solid of each; others have their names in the file."""
    faces: Mapping[GroupName, Numbers] = Field(default_factory=dict)
    """Names of surface groups, and the numbers of the faces of each, as `taichisoft mesh info` lists them."""
    base: BasePlane | tuple[BasePlane, ...] | None = None
    """Plane, or planes, whose triangles of the outside make the group "base"; a flat end that is the only one, or by
    far the largest, is taken when neither this nor `faces` gives it."""
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
    @abstractmethod
    def cavity_volumes(self) -> tuple[float, ...]:
        """Volumes of the cavities [mm^3]."""

    @property
    def presets(self) -> dict[str, float]:
        """Largest element sizes [mm] by name."""
        return preset_sizes(self.body.extent)

    def mesh(self, size: float | None = None) -> VolumeMesh:
        """Mesh the body with gmsh; `size` [mm] replaces the largest element size and scales the smallest with it."""
        try:
            body = self.body
            sizes = self.table.mesh.fitted(body.extent, body.volume, size, self.cavity_volumes)
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
            warn_caller(f"{place}: the body has no cavity{hint}")


class StepBody(_BodyFromFiles):
    """A body from a STEP file, whose cavities are the voids in it, and the chambers whose openings are closed."""

    table_type = StepTable

    @cached_property
    def body(self) -> CadBody:
        """The body that the STEP file describes, checked."""
        table, body = self.table, read_step(self.file.parent / self.table.file)
        solids, numbers = [solid.number for solid in body.solids], [face.number for face in body.faces]
        for name, solid in table.solids.items():
            self._refuse_numbers(f"solids.{name}", [solid], "solids", solids)
        for name, faces in table.faces.items():
            self._refuse_numbers(f"faces.{name}", faces, "faces", numbers)
        if table.base is not None and BASE in table.faces:
            raise MeshError(f"{self.file}: base and faces.base: only one of them can be given")
        closed = self._closed(body)
        left = [
            f"opening {n}, {one} before {one.volume:.4g} mm^3 of air"
            for n, one in enumerate(body.openings, 1)
            if one not in closed
        ]
        left = [*left[:SAID], f"and {len(left) - SAID} more"] if len(left) > SAID else left
        remedy = "".join(f"; {one}" for one in left) + "; close_inlets = true makes cavities of openings" * bool(left)
        hint = f"; a cavity is a void without an opening{remedy}"
        self._check_cavities(len(body.voids) + len(closed), body.path, f"{body.path} has", hint)
        if left and table.close_inlets is None and table.cavities is None and body.voids:
            warn_caller(f"{body.path}: a chamber is open{remedy}, and false leaves it as it is")
        return body

    @property
    def cavity_volumes(self) -> tuple[float, ...]:
        """Volumes of the voids and of the chambers whose openings are closed [mm^3]."""
        return (*self.body.void_volumes, *(opening.volume for opening in self._closed(self.body)))

    def _closed(self, body: CadBody) -> tuple[Opening, ...]:
        """The openings that get caps."""
        wanted = self.table.close_inlets
        if wanted is True and not body.openings:
            raise MeshError(f"{self.file}: close_inlets = true: no chamber of {body.path} is open to the outside")
        if isinstance(wanted, tuple):
            self._refuse_numbers("close_inlets", wanted, "openings", range(1, len(body.openings) + 1))
            return tuple(body.openings[number - 1] for number in sorted(set(wanted)))
        return body.openings if wanted else ()

    def _refuse_numbers(self, key: str, numbers: Iterable[int], what: str, valid: Sequence[int]) -> None:
        """Raise MeshError for a number that no solid, face or opening has."""
        wrong = next((number for number in numbers if number not in valid), None)
        if wrong is not None:
            raise MeshError(
                f"{self.file}: {key} = {wrong}: the body has {len(valid)} {what}; `taichisoft mesh info` lists them"
            )

    def _parts(self) -> dict[str, int]:
        """Names of element groups, and the number of the solid of each; none for a single solid that got no name."""
        chosen = self.table.solids
        others = {solid.name: solid.number for solid in self.body.solids if solid.number not in chosen.values()}
        twice = sorted(chosen.keys() & others.keys())
        if twice:
            raise MeshError(f"{self.file}: solids.{twice[0]}: solid {others[twice[0]]} has this name; choose another")
        return {**others, **chosen} if len(self.body.solids) > 1 else dict(chosen)

    def _fill(self, sizes: FittedSizes) -> tuple[VolumeMesh, CurvedSides | None]:
        table, body = self.table, self.body
        faces = dict(table.faces)
        if table.base is None and BASE not in faces and body.flat_end:
            faces[BASE] = body.flat_end
            said = f"the flat end, face {' and '.join(map(str, body.flat_end))}, is the group 'base'"
            warn_caller(f"{body.path}: {said}; `faces` or `base` choose another")
        return mesh_step(
            body,
            sizes,
            str(self.file),
            closed=self._closed(body),
            parts=self._parts(),
            faces=faces,
            wall_ratio=table.mesh.wall_ratio,
            curved=table.mesh.order == 2,
        )


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

    @property
    def cavity_volumes(self) -> tuple[float, ...]:
        """Volumes of the cavities [mm^3]."""
        return self.body.cavity_volumes

    def _fill(self, sizes: FittedSizes) -> tuple[VolumeMesh, CurvedSides | None]:
        if self.table.keep_surface:
            return keep_surfaces(self.body, sizes, str(self.file)), None
        return remesh_surfaces(self.body, sizes, self.table.feature_angle, str(self.file)), None
