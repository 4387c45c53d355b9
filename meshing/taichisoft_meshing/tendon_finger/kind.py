"""The geometry kind `tendon_finger`: gmsh builds the solid and fills it, with small tetrahedra in the hinges."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from taichisoft.meshes.second_order import with_middle_nodes
from taichisoft.meshes.volume_mesh import VolumeMesh
from taichisoft.plugin_system.geometry import Geometry
from taichisoft_meshing.bodies.meshed_body import compare_volumes
from taichisoft_meshing.finger.boxes import TOUCH
from taichisoft_meshing.finger.groups import surface_groups
from taichisoft_meshing.geometry_file import checked
from taichisoft_meshing.gmsh_session import gmsh_session, obey_size_fields, tetrahedra
from taichisoft_meshing.tendon_finger.dimensions import TendonFingerTable

GROWTH = 0.5
"""Growth of the element size for each millimetre of distance from the hinges [-]."""

VOLUME_TOLERANCE = 1e-6
"""Largest error of the volume, as a share of it [-]: between flat faces only rounding is missing."""

PRESETS = {"coarse": 1.75, "medium": 1.0, "fine": 0.6}
"""Largest element size over the thickness of the hinges [-]."""


@dataclass(frozen=True)
class TendonFinger(Geometry):
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
        _ = self.dimensions

    @cached_property
    def dimensions(self) -> TendonFingerTable:
        """The dimensions, checked."""
        return checked(TendonFingerTable, self.tables, self.file)

    @property
    def parameters(self) -> dict[str, Any]:
        """Every dimension, defaults included."""
        parameters: dict[str, Any] = self.dimensions.model_dump(mode="json")
        return parameters

    @property
    def presets(self) -> dict[str, float]:
        """Largest element size [mm] by name."""
        return {name: times * self.dimensions.notches.hinge for name, times in PRESETS.items()}

    def mesh(self, size: float | None = None) -> VolumeMesh:
        """Mesh the finger with gmsh; `size` [mm] replaces the largest element size and scales the smallest with it.

        Surface groups are "outer", closed, and "base", its part in the plane x = 0. Element groups are "silicone", all
        of it, and "base_block", the part that is held; elements end at its end.

        Raises:
            MeshError: the size is not valid, gmsh cannot be loaded, fails, or gives a body of another volume.
        """
        finger, source = self._with_size(size), str(self.file)
        with gmsh_session(source) as gmsh:
            _build(gmsh, finger)
            _set_sizes(gmsh, finger)
            gmsh.model.mesh.generate(3)
            nodes, elements, _ = tetrahedra(gmsh)
        held = (nodes[:, 0] >= -finger.body.base_length - TOUCH)[elements].all(axis=1)
        groups = {
            "silicone": np.arange(len(elements), dtype=np.int32),
            "base_block": np.flatnonzero(held).astype(np.int32),
        }
        surfaces = surface_groups(nodes, elements)
        mesh = VolumeMesh(f"{source} meshed by gmsh", nodes, elements, surfaces, groups).check()
        compare_volumes(mesh, finger.volume, [], VOLUME_TOLERANCE)
        return with_middle_nodes(mesh) if finger.mesh.order == 2 else mesh  # it has no curved faces

    def _with_size(self, size: float | None) -> TendonFingerTable:
        finger = self.dimensions
        if size is None:
            return finger
        smallest = size * finger.mesh.smallest / finger.mesh.largest
        sizes = {**self.tables.get("mesh", {}), "largest": size, "smallest": smallest}
        return checked(TendonFingerTable, {**self.tables, "mesh": sizes}, self.file)


def _build(gmsh: Any, finger: TendonFingerTable) -> None:
    """The side view drawn out across the finger, less what the top view leaves away, cut at the end of the base."""
    occ, body = gmsh.model.occ, finger.body
    side = [(x, y, -body.width / 2) for x, y in finger.outline]
    blank = _drawn_out(occ, side, (0.0, 0.0, body.width))
    half, tip = body.width / 2, body.tip_width / 2
    top = [(0.0, 0.0, -half), (0.0, 0.0, half), (-body.length, 0.0, tip), (-body.length, 0.0, -tip)]
    silicone, _ = occ.intersect(blank, _drawn_out(occ, top, (0.0, body.height, 0.0)))
    base = occ.addBox(-body.base_length, 0.0, -half, body.base_length, body.height, body.width)
    held, _ = occ.intersect(silicone, [(3, base)], removeObject=False)
    occ.fragment(silicone, held)
    occ.synchronize()


def _drawn_out(occ: Any, corners: list[tuple[float, float, float]], way: tuple[float, float, float]) -> Any:
    """The solid between a polygon and the same one shifted."""
    points = [occ.addPoint(*corner) for corner in corners]
    sides = [occ.addLine(a, b) for a, b in zip(points, points[1:] + points[:1], strict=True)]
    face = occ.addPlaneSurface([occ.addCurveLoop(sides)])
    return [part for part in occ.extrude([(2, face)], *way) if part[0] == 3]


def _set_sizes(gmsh: Any, finger: TendonFingerTable) -> None:
    """Small elements in a box around each hinge, growing to the largest."""
    body, notches, sizes, field = finger.body, finger.notches, finger.mesh, gmsh.model.mesh.field
    gmsh.option.setNumber("Mesh.MeshSizeMax", sizes.largest)
    gmsh.option.setNumber("Mesh.MeshSizeMin", sizes.smallest)
    if sizes.smallest == sizes.largest or not notches.count:
        return
    gmsh.option.setNumber("Mesh.MeshSizeFromPoints", 0)
    gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)
    for middle in finger.middles:
        tag = field.add("Box")
        options = {
            "VIn": sizes.smallest,
            "VOut": sizes.largest,
            "Thickness": (sizes.largest - sizes.smallest) / GROWTH,
            "XMin": -(middle + notches.bottom / 2),
            "XMax": -(middle - notches.bottom / 2),
            "YMin": finger.back(middle) - notches.hinge,
            "YMax": finger.back(middle),
            "ZMin": -body.width / 2,
            "ZMax": body.width / 2,
        }
        for option, value in options.items():
            field.setNumber(tag, option, value)
    obey_size_fields(gmsh)
