"""The geometry kinds `step` and `surfaces`: bodies between closed surfaces, which files describe."""

import math
import re
from abc import abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field

from taichisoft.base import SIZE, implausible, warn_caller
from taichisoft.errors import MeshError
from taichisoft.mesh import VolumeMesh, cavity_names, joined_pieces
from taichisoft.scene import BASE, NotNegative, Positive, Table
from taichisoft_meshing.body_tables import (
    FINEST,
    BasePlane,
    Count,
    FittedSizes,
    Sizes,
    SolidSizes,
    follow_curvature,
    follow_walls,
    obey_wall_sizes,
    preset_sizes,
    set_sizes,
    wall_sizes,
    with_base,
)
from taichisoft_meshing.cad_body import CadBody, Opening, import_solids, read_step, with_caps
from taichisoft_meshing.closed_shells import (
    NEAR,
    HollowBody,
    Shell,
    angles_between,
    area_vectors,
    diagonal,
    joined_sides,
    read_hollow_body,
)
from taichisoft_meshing.geometry_file import CheckedGeometry
from taichisoft_meshing.gmsh_session import (
    NO_GROUPS,
    SURFACE_ALGORITHMS,
    TRIANGLE,
    CurvedSides,
    compare_volumes,
    curve_sides,
    curved_sides,
    gmsh_session,
    meshed_body,
    successes,
    with_curved_sides,
)
from taichisoft_meshing.inner_nodes import least_shape, with_elements_across, without_flat_skin, without_slivers

# The mesher of STEP files: gmsh fills the solids that OpenCASCADE has read, and the mesh gets the drawing's names.

FLAT_TOLERANCE = 1e-6
"""Largest error of a volume between flat faces, as a share of it [-]: only rounding may be missing."""


Filling = tuple[VolumeMesh, CurvedSides | None]
"""Tetrahedra of four nodes, and the curved sides for ten, if they are asked for."""


def mesh_step(
    body: CadBody,
    sizes: FittedSizes,
    source: str,
    *,
    closed: Sequence[Opening] = (),
    parts: Mapping[str, int] = NO_GROUPS,
    faces: Mapping[str, Sequence[int]] = NO_GROUPS,
    wall_ratio: float = 0.0,
    curved: bool = False,
) -> Iterator[Filling]:
    """Mesh the body of a STEP file with elements of four nodes and some sizes, by one algorithm after the other.

    Args:
        body: the body.
        sizes: of its elements.
        source: begins every error.
        closed: the openings that get caps; their chambers are cavities, after the voids.
        parts: element groups, and the number of the solid of each.
        faces: surface groups, and the numbers of the faces of each.
        wall_ratio: longest edge in a wall over its thickness [-]; 0: as long as `sizes` say.
        curved: whether the middles of the sides on its surfaces are computed, too.
    """
    behind = [opening.faces for opening in closed]
    shells = [sorted(shell) for shell in (body.outside.difference(*behind), *body.voids, *behind)]

    def make(gmsh: Any, algorithm: int) -> Filling:
        gmsh.option.setNumber("Mesh.Algorithm", algorithm)
        tags = list(import_solids(gmsh, body.path, body.defeature))
        set_sizes(gmsh, sizes, [face for shell in shells[1:] for face in shell])
        gmsh.model.mesh.generate(3)
        if wall_ratio:
            follow_walls(gmsh, sizes, wall_ratio, source)
            gmsh.model.mesh.generate(3)
        mesh = meshed_body(gmsh, shells, source, {name: tags[number - 1] for name, number in parts.items()}, faces)
        for name in cavity_names(len(shells) - 1)[len(body.voids) :]:
            mesh = with_caps(mesh, name)
        sides = curved_sides(gmsh, mesh.nodes, mesh.elements) if curved else None
        shaped = mesh if sides is None else curve_sides(mesh, sides)[0]
        volumes = [*body.void_volumes, *(opening.volume for opening in closed)]
        volumes_of_parts = {name: body.solids[number - 1].volume for name, number in parts.items()}
        compare_volumes(shaped, body.volume, volumes, FLAT_TOLERANCE if body.flat else None, volumes_of_parts)
        return mesh, sides

    return successes(str(body.path), SURFACE_ALGORITHMS, make)


# The mesher of bodies between closed surfaces, which gmsh remeshes, or keeps triangle by triangle.

KEPT_TOLERANCE = 1e-9
"""Largest error of a volume between the given surfaces, as a share of it [-]: only rounding may be missing."""


def keep_surfaces(body: HollowBody, sizes: FittedSizes, source: str) -> VolumeMesh:
    """Fill a body and keep its surfaces: vertices of the outside, then of each cavity, are the first nodes.

    Args:
        body: body that is filled.
        sizes: sizes of its elements, of which only the largest has an effect.
        source: begins every error.
    """
    shells = (body.outer, *body.cavities)
    with gmsh_session(source) as gmsh:
        surfaces = _add_surfaces(gmsh.model, shells)
        _add_volume(gmsh.model, [[surface] for surface in surfaces])
        gmsh.option.setNumber("Mesh.MeshSizeMax", sizes.largest)
        gmsh.model.mesh.generate(3)
        mesh = meshed_body(gmsh, [[surface] for surface in surfaces], source)
    given = np.vstack([shell.vertices for shell in shells])
    faces = sum(len(shell.triangles) for shell in shells)
    on_surfaces = sum(len(triangles) for triangles in mesh.surface_groups.values())
    if on_surfaces != faces or not np.array_equal(mesh.nodes[: len(given)], given):
        raise MeshError(f"{source}: gmsh cannot fill the body without changing its surface; remove keep_surface")
    compare_volumes(mesh, body.volume, [cavity.volume for cavity in body.cavities], KEPT_TOLERANCE)
    return mesh


WALL_RATIOS = (4.0, 2.0)
"""Longest edges in walls over their thickness, with which coarse meshes are tried again that have slivers there [-]."""

SMALLER = 0.9
"""Sizes with which meshes are tried in the end that have slivers elsewhere, over those that were asked for [-]."""


def remesh_surfaces(body: HollowBody, sizes: FittedSizes, feature_angle: float, source: str) -> Iterator[VolumeMesh]:
    """Mesh a body with surface triangles of new sizes, which lie on the given ones, in one way after the other.

    Args:
        body: body that is meshed.
        sizes: sizes of its elements.
        feature_angle: angle between two triangles above which their edge stays an edge [degrees].
        source: begins every error.
    """
    angle = math.radians(feature_angle)
    flat = all(_flat_faced(shell, angle) for shell in (body.outer, *body.cavities))
    # gmsh cuts surfaces in parts that it can unroll, which flat faces need not be; the cuts stay edges of the mesh, and
    # make slivers where they pass near others, so that all are tried without cuts in the end.
    ways = [(False, algorithm) for algorithm in SURFACE_ALGORITHMS[:1] if flat]
    ways += [(True, algorithm) for algorithm in SURFACE_ALGORITHMS]
    ways += [(False, algorithm) for algorithm in SURFACE_ALGORITHMS[1 if flat else 0 :]]

    rows = np.empty((0, 12))

    def make(gmsh: Any, way: tuple[bool, int]) -> VolumeMesh:
        cut, algorithm = way
        gmsh.option.setNumber("Mesh.Algorithm", algorithm)
        return _remesh(gmsh, body, sizes, angle, cut, flat, source, rows)

    meshes = successes(source, ways, make)
    yield (coarse := next(meshes))
    yield from meshes
    least, in_walls = FINEST * sizes.smallest, False
    for ratio in WALL_RATIOS:
        before = rows
        rows = wall_sizes(coarse.nodes, coarse.elements, sizes, ratio, source, least)
        # They would change nothing, or no more than the last ones, as in walls that get the least size with both.
        if rows[:, 9:].min() > 0.9 * sizes.largest or np.array_equal(rows, before):
            continue
        in_walls = True
        warn_caller(
            f"{source}: elements are flat in thin walls; tried again with {ratio:g} times the walls' thickness, "
            f"but no less than {least:.3g} mm"
        )
        with suppress(MeshError):
            yield from successes(source, ways, make)
    if in_walls:
        return
    rows = np.empty((0, 12))
    sizes = replace(sizes, largest=SMALLER * sizes.largest, smallest=SMALLER * sizes.smallest)
    with suppress(MeshError):
        yield from successes(source, ways, make)


def _remesh(
    gmsh: Any,
    body: HollowBody,
    sizes: FittedSizes,
    angle: float,
    cut: bool,
    flat: bool,
    source: str,
    rows: np.ndarray,
) -> VolumeMesh:
    shells = (body.outer, *body.cavities)
    surfaces = _classify(gmsh.model, shells, angle, cut)
    gmsh.option.setNumber("Mesh.MinimumCurveNodes", 1 if flat else 3)
    set_sizes(gmsh, sizes, [surface for wall in surfaces[1:] for surface in wall])
    follow_curvature(gmsh, sizes, [] if flat else shells, angle)
    if len(rows):
        obey_wall_sizes(gmsh, sizes, rows)
    gmsh.model.mesh.generate(3)
    mesh = meshed_body(gmsh, surfaces, source)
    mesh = without_flat_skin(mesh)
    compare_volumes(mesh, body.volume, [cavity.volume for cavity in body.cavities], FLAT_TOLERANCE if flat else None)
    return mesh


def _add_surfaces(model: Any, shells: Sequence[Shell]) -> list[int]:
    """Give gmsh each shell as a surface of triangles."""
    surfaces, first_node, first_triangle = [], 1, 1
    for shell in shells:
        surface = model.addDiscreteEntity(2)
        node_tags = np.arange(first_node, first_node + len(shell.vertices))
        triangle_tags = np.arange(first_triangle, first_triangle + len(shell.triangles))
        model.mesh.addNodes(2, surface, node_tags, shell.vertices.ravel())
        model.mesh.addElementsByType(surface, TRIANGLE, triangle_tags, (shell.triangles + first_node).ravel())
        surfaces.append(surface)
        first_node += len(node_tags)
        first_triangle += len(triangle_tags)
    return surfaces


def _add_volume(model: Any, shells: Sequence[Sequence[int]]) -> None:
    model.geo.addVolume([model.geo.addSurfaceLoop(list(shell)) for shell in shells])
    model.geo.synchronize()


def _classify(model: Any, shells: Sequence[Shell], angle: float, cut: bool) -> list[list[int]]:
    """Part the shells into faces at sharp edges, and make geometry of them; gmsh's surfaces of each shell."""
    _add_surfaces(model, shells)
    model.mesh.classifySurfaces(angle, True, cut, math.pi)
    model.mesh.createGeometry()
    last_nodes = np.cumsum([len(shell.vertices) for shell in shells])
    surfaces: list[list[int]] = [[] for _ in shells]
    for _, surface in model.getEntities(2):
        node = model.mesh.getElementsByType(TRIANGLE, surface)[1][0]
        surfaces[int(np.searchsorted(last_nodes, node))].append(surface)
    _add_volume(model, surfaces)
    return surfaces


def _flat_faced(shell: Shell, angle: float) -> bool:
    """Whether all faces between sharp edges are flat."""
    corners = shell.vertices[shell.triangles]
    normals = area_vectors(corners)
    neighbours = joined_sides(shell.triangles)[1] // 3
    smooth = neighbours[angles_between(normals, neighbours) < angle]
    face = joined_pieces(len(normals), smooth)
    count = face.max() + 1
    mean_normal = np.column_stack([np.bincount(face, normals[:, axis], count) for axis in range(3)])
    lengths = np.linalg.norm(mean_normal, axis=1, keepdims=True)
    if (lengths == 0).any():
        return False
    mean_normal = mean_normal / lengths
    middles = np.einsum("tcd,td->t", corners, mean_normal[face]) / 3
    offset = np.bincount(face, middles, count) / np.bincount(face, minlength=count)
    heights = np.einsum("tcd,td->tc", corners, mean_normal[face]) - offset[face, None]
    return bool((np.abs(heights) <= 10 * NEAR * diagonal(shell.vertices)).all())


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
    defeature: NotNegative = 0.0
    """Radius up to which fillets, rounds and holes are dropped [mm], which coarse meshes need not follow; 0: none. The
    faces that are left have other numbers, which `taichisoft mesh info --defeature` lists."""
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
    unite: Annotated[bool, Field(strict=True)] = False
    """Whether the closed surfaces in `outer` that face as the largest does are parts of one body, and are united; those
    that face the other way are chambers."""
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
        best: tuple[float, VolumeMesh, CurvedSides | None] | None = None
        tries = 0
        for filling, its_sides in self._fillings(sizes):
            tries += 1
            filled = without_slivers(with_elements_across(filling, sizes))
            shape = least_shape(filled.nodes, filled.elements)
            if best is None or shape > best[0]:
                best = shape, filled, its_sides
            if shape >= 1:
                break
        if best is None:
            raise MeshError(f"{self.file}: no mesh came out; try another size")
        if tries > 1:
            warn_caller(f"{self.file}: elements were nearly flat at first; the best of {tries} meshes is taken")
        _, mesh, sides = best
        return with_base(mesh if sides is None else with_curved_sides(mesh, sides), self.table.base)

    @abstractmethod
    def _fillings(self, sizes: FittedSizes) -> Iterator[Filling]:
        """Fill the body, in one way after the other; at least one succeeds."""

    def _check_cavities(self, count: int, place: Path, where: str, hint: str = "") -> None:
        """Raise MeshError for another number of cavities than the tables have; warn of a body without cavities."""
        wanted = self.table.cavities
        if wanted is not None and count != wanted:
            raise MeshError(f"{self.file}: cavities = {wanted}: {where} {count}{hint}")
        if wanted is None and count == 0:
            warn_caller(f"{place}: the body has no cavity{hint}")


class StepBody(_BodyFromFiles):
    """A body from a STEP file, whose cavities are the voids in it, and the chambers whose openings are closed."""

    table_type = StepTable

    @cached_property
    def body(self) -> CadBody:
        """The body that the STEP file describes, checked."""
        table, body = self.table, read_step(self.file.parent / self.table.file, self.table.defeature)
        solids, numbers = [solid.number for solid in body.solids], [face.number for face in body.faces]
        for name, solid in table.solids.items():
            self._refuse_numbers(f"solids.{name}", [solid], "solids", solids)
        for name, faces in table.faces.items():
            self._refuse_numbers(f"faces.{name}", faces, "faces", numbers)
        if table.base is not None and BASE in table.faces:
            raise MeshError(f"{self.file}: base and faces.base: only one of them can be given")
        closed = self._closed(body)
        left = [
            f"opening {n}, {opening} before {opening.volume:.4g} mm^3 of air"
            for n, opening in enumerate(body.openings, 1)
            if opening not in closed
        ]
        left = [*left[:SAID], f"and {len(left) - SAID} more"] if len(left) > SAID else left
        remedy = "".join(
            f"; {opening}" for opening in left
        ) + "; close_inlets = true makes cavities of openings" * bool(left)
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

    def _fillings(self, sizes: FittedSizes) -> Iterator[Filling]:
        table, body = self.table, self.body
        faces = dict(table.faces)
        if table.base is None and BASE not in faces and body.flat_end:
            faces[BASE] = body.flat_end
            message = f"the flat end, face {' and '.join(map(str, body.flat_end))}, is the group 'base'"
            warn_caller(f"{body.path}: {message}; `faces` or `base` choose another")
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
        cavities = [folder / name for name in table.cavity]
        body = read_hollow_body(folder / table.outer, cavities, table.scale, table.unite)
        if doubt := implausible(f"{folder / table.outer}: its longest side", float(body.extent.max()), SIZE):
            warn_caller(f"{doubt}; scale = {table.scale:g}: 1000 takes a file in metres, 10 in centimetres")
        self._check_cavities(len(body.cavities), folder / table.outer, "the files have")
        return body

    @property
    def cavity_volumes(self) -> tuple[float, ...]:
        """Volumes of the cavities [mm^3]."""
        return self.body.cavity_volumes

    def _fillings(self, sizes: FittedSizes) -> Iterator[Filling]:
        if self.table.keep_surface:
            yield keep_surfaces(self.body, sizes, str(self.file)), None
        else:
            for mesh in remesh_surfaces(self.body, sizes, self.table.feature_angle, str(self.file)):
                yield mesh, None
