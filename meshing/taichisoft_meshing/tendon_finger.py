"""The geometry kind `tendon_finger`: a tapered beam whose inner side has a notch at each joint, up to a thin hinge.

Axes as for `pneunet_finger`: the base is the plane x = 0 and the finger points to -x; y goes from the inner side
(0), along which the cable runs, to the back; z is centred. Positions along the finger are distances from the base [mm].
"""

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from taichisoft.mesh import VolumeMesh, with_middle_nodes
from taichisoft.scene import NotNegative, Positive, Table
from taichisoft_meshing.body_tables import add_box_of_size, element_count, refuse_too_many
from taichisoft_meshing.geometry_file import ROUNDING, CheckedGeometry, at_least, at_most
from taichisoft_meshing.gmsh_session import compare_volumes, gmsh_session, obey_size_fields, tetrahedra
from taichisoft_meshing.pneunet_finger import TOUCH, drawn_out, surface_groups

THINNEST = 0.1
"""Least silicone that must remain anywhere [mm]."""


class BeamBody(Table):
    """The beam without its notches."""

    length: Positive = 90.0
    """Length along x from the base to the tip [mm]."""
    height: Positive = 22.0
    """Height along y at the base [mm]."""
    tip_height: Positive = 13.0
    """Height along y at the tip [mm]; the back slopes evenly."""
    width: Positive = 20.0
    """Width along z at the base [mm]."""
    tip_width: Positive = 14.0
    """Width along z at the tip [mm]."""
    tip_bevel: NotNegative = 4.0
    """Length by which both edges across the tip are cut off, along x and along y [mm]; 0: sharp edges."""
    base_length: Positive = 14.0
    """Length along x of the part that is held [mm]: element group "base_block"."""


class Notches(Table):
    """Cuts across the inner side, one at each joint, narrower towards the hinge."""

    count: Annotated[int, Field(strict=True, ge=0)] = 3
    """Number of joints."""
    first: Positive = 24.0
    """Distance from the base to the middle of the first notch [mm]."""
    pitch: Positive = 21.0
    """Distance along x from one notch to the next [mm]."""
    width: Positive = 9.0
    """Width of each notch along x at the inner side [mm]."""
    bottom: Positive = 3.0
    """Width of each notch along x at the hinge [mm]."""
    hinge: Positive = 4.0
    """Thickness along y of the silicone that is left at the back [mm]."""


class TendonElementSizes(Table):
    """Sizes of the tetrahedra."""

    largest: Positive = 7.0
    """Edge length far from the hinges [mm]; --size replaces it and scales the other."""
    smallest: Positive = 3.5
    """Edge length in the hinges [mm]."""
    order: Literal[1, 2] = 1
    """1: tetrahedra of four nodes; 2: of ten, for `element = "quadratic"`; all faces are flat, and so are theirs."""


class TendonFingerTable(Table):
    """A geometry file of the kind `tendon_finger`: all tables of a finger, whose values fit together."""

    body: BeamBody = BeamBody()
    notches: Notches = Notches()
    mesh: TendonElementSizes = TendonElementSizes()

    @property
    def middles(self) -> list[float]:
        """Distances from the base to the middles of the notches [mm]."""
        return [self.notches.first + joint * self.notches.pitch for joint in range(self.notches.count)]

    def back(self, distance: float) -> float:
        """Position y of the back at a distance from the base [mm]."""
        body = self.body
        return body.height + (body.tip_height - body.height) * distance / body.length

    @property
    def outline(self) -> list[tuple[float, float]]:
        """Corners (x, y) of the side view, in order around it, from the inner corner of the base [mm]."""
        body, notches, bevel = self.body, self.notches, self.body.tip_bevel
        flat = body.length - bevel
        corners = [(0.0, 0.0), (0.0, body.height)]
        if bevel:
            corners += [(-flat, self.back(flat)), (-body.length, body.tip_height - bevel)]
            corners += [(-body.length, bevel), (-flat, 0.0)]
        else:
            corners += [(-body.length, body.tip_height), (-body.length, 0.0)]
        for middle in reversed(self.middles):
            far, near = middle + notches.bottom / 2, middle - notches.bottom / 2
            corners += [(-(middle + notches.width / 2), 0.0), (-far, self.back(far) - notches.hinge)]
            corners += [(-near, self.back(near) - notches.hinge), (-(middle - notches.width / 2), 0.0)]
        return corners

    @property
    def volume(self) -> float:
        """Volume of the silicone [mm^3]: the side view's area times the width at its centroid, which varies evenly."""
        body, corners = self.body, self.outline
        area = moment = 0.0
        for (x, y), (next_x, next_y) in zip(corners, corners[1:] + corners[:1], strict=True):
            cross = x * next_y - next_x * y  # corners go anticlockwise
            area += cross / 2
            moment += cross * (x + next_x) / 6
        return area * body.width + moment * (body.width - body.tip_width) / body.length

    @model_validator(mode="after")
    def _check_body(self) -> "TendonFingerTable":
        body = self.body
        at_most("body.tip_height", body.tip_height, body.height, "body.height")
        at_most("body.tip_width", body.tip_width, body.width, "body.width")
        at_most("body.tip_bevel", body.tip_bevel, (body.tip_height - THINNEST) / 2, "to leave a face at the tip")
        rest = body.length - body.tip_bevel - THINNEST
        at_most("body.base_length", body.base_length, rest, "to end before the tip's bevel")
        return self

    @model_validator(mode="after")
    def _check_notches(self) -> "TendonFingerTable":
        body, notches = self.body, self.notches
        if notches.count == 0:
            return self
        at_most("notches.bottom", notches.bottom, notches.width, "notches.width")
        if notches.count > 1:
            at_least("notches.pitch", notches.pitch, notches.width + THINNEST, "beyond notches.width")
        near = body.base_length + notches.width / 2 + THINNEST
        at_least("notches.first", notches.first, near, "to leave body.base_length uncut")
        last, rest = self.middles[-1] + notches.width / 2, body.length - body.tip_bevel - THINNEST
        if last > rest + ROUNDING:
            raise ValueError(
                f"notches.count = {notches.count}: the last notch would end {last:g} mm from the base; must end "
                f"before the tip, at most at {rest:g}"
            )
        thickest = self.back(self.middles[-1] + notches.bottom / 2) - THINNEST
        at_most("notches.hinge", notches.hinge, thickest, "to leave a notch below it")
        return self

    @model_validator(mode="after")
    def _check_sizes(self) -> "TendonFingerTable":
        sizes = self.mesh
        at_most("mesh.largest", sizes.largest, self.body.length, "body.length: elements larger than the body")
        at_most("mesh.smallest", sizes.smallest, sizes.largest, "mesh.largest")
        refuse_too_many(element_count(self.volume, sizes.largest, sizes.largest), "mesh.largest", sizes.largest)
        return self


VOLUME_TOLERANCE = 1e-6
"""Largest error of the volume, as a share of it [-]: between flat faces only rounding is missing."""

PRESETS = {"coarse": 1.75, "medium": 1.0, "fine": 0.6}
"""Largest element size over the thickness of the hinges [-]."""


class TendonFinger(CheckedGeometry):
    """A finger that the tables of a file describe."""

    table_type = TendonFingerTable

    @property
    def presets(self) -> dict[str, float]:
        """Largest element size [mm] by name."""
        return {name: times * self.table.notches.hinge for name, times in PRESETS.items()}

    def mesh(self, size: float | None = None) -> VolumeMesh:
        """Mesh the finger with gmsh; `size` [mm] replaces the largest element size and scales the smallest with it.

        Surface groups are "outer", closed, and "base", its part in the plane x = 0. Element groups are "silicone", all
        of it, and "base_block", the part that is held; elements end at its end.

        Raises:
            MeshError: the size is not valid, gmsh cannot be loaded, fails, or gives a body of another volume.
        """
        finger, source = self.sized(size), str(self.file)
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


def _build(gmsh: Any, finger: TendonFingerTable) -> None:
    """The side view drawn out across the finger, less what the top view leaves away, cut at the end of the base."""
    occ, body = gmsh.model.occ, finger.body
    side = [(x, y, -body.width / 2) for x, y in finger.outline]
    blank = drawn_out(occ, side, (0.0, 0.0, body.width))
    half, tip = body.width / 2, body.tip_width / 2
    top = [(0.0, 0.0, -half), (0.0, 0.0, half), (-body.length, 0.0, tip), (-body.length, 0.0, -tip)]
    silicone, _ = occ.intersect(blank, drawn_out(occ, top, (0.0, body.height, 0.0)))
    base = occ.addBox(-body.base_length, 0.0, -half, body.base_length, body.height, body.width)
    held, _ = occ.intersect(silicone, [(3, base)], removeObject=False)
    occ.fragment(silicone, held)
    occ.synchronize()


def _set_sizes(gmsh: Any, finger: TendonFingerTable) -> None:
    """Small elements in a box around each hinge, growing to the largest."""
    body, notches, sizes = finger.body, finger.notches, finger.mesh
    gmsh.option.setNumber("Mesh.MeshSizeMax", sizes.largest)
    gmsh.option.setNumber("Mesh.MeshSizeMin", sizes.smallest)
    if sizes.smallest == sizes.largest or not notches.count:
        return
    gmsh.option.setNumber("Mesh.MeshSizeFromPoints", 0)
    gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)
    for middle in finger.middles:
        lower = -(middle + notches.bottom / 2), finger.back(middle) - notches.hinge, -body.width / 2
        upper = -(middle - notches.bottom / 2), finger.back(middle), body.width / 2
        add_box_of_size(gmsh, lower, upper, sizes.smallest, sizes.largest)
    obey_size_fields(gmsh)
