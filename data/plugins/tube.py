"""A plug-in with a geometry kind of its own: a tube, closed at both ends, which grows longer under pressure.

taichisoft mesh tube.toml --plugin tube.py -o out/tube
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import model_validator

from taichisoft.mesh import VolumeMesh
from taichisoft.running import Geometry, hookimpl
from taichisoft.scene import Positive, Table
from taichisoft_meshing import (
    BasePlane,
    FittedSizes,
    checked,
    meshed_body,
    set_sizes,
    shells_of_solid,
    with_base,
)
from taichisoft_meshing.gmsh_session import gmsh_session


class TubeTable(Table):
    """The keys of a file of the kind `tube`; errors name the file, a wrong or unknown key, and what would be valid."""

    length: Positive = 60.0
    """Length along x from the base at x = 0 to the closed end at x = -length [mm]."""
    radius: Positive = 10.0
    """Outer radius [mm]."""
    wall: Positive = 3.0
    """Thickness of the wall, also at the ends [mm]."""
    size: Positive = 4.0
    """Edge length of the largest elements [mm]."""

    @model_validator(mode="after")
    def _check_wall(self) -> "TubeTable":
        thickest = min(self.radius, self.length / 2)
        if self.wall >= thickest:
            raise ValueError(f"wall = {self.wall:g}: leaves no air; must be below {thickest:g}")
        return self


class Tube(Geometry):
    """The geometry kind: made from the path of a file and its tables without `kind`, and asked for a mesh later."""

    presets: Mapping[str, float] = {"coarse": 4.0, "medium": 2.5, "fine": 1.5}  # for --preset

    def __init__(self, tables: Mapping[str, Any], file: Path):
        self.table, self.file = checked(TubeTable, tables, file), file

    def mesh(self, size: float | None = None) -> VolumeMesh:
        """The tube in tetrahedra; `size` [mm] is that of --size, or one of those that --nodes tries."""
        tube, largest = self.table, size or self.table.size
        with gmsh_session(str(self.file)) as gmsh:  # silent, reproducible, and its log is kept when it fails
            occ = gmsh.model.occ
            outside = occ.addCylinder(0, 0, 0, -tube.length, 0, 0, tube.radius)
            air = occ.addCylinder(-tube.wall, 0, 0, 2 * tube.wall - tube.length, 0, 0, tube.radius - tube.wall)
            ((_, solid),), _ = occ.cut([(3, outside)], [(3, air)])
            occ.synchronize()
            set_sizes(gmsh, FittedSizes(largest, smallest=largest, curvature=16), [])
            gmsh.model.mesh.generate(3)
            mesh = meshed_body(gmsh, shells_of_solid(occ, solid), str(self.file))  # names "outer" and "cavity"
        return with_base(mesh, BasePlane(point=(0.0, 0.0, 0.0), normal=(1.0, 0.0, 0.0)))


@hookimpl
def taichisoft_geometry_kinds() -> Mapping[str, Any]:
    """Called when `taichisoft mesh`, or a scene, has read a geometry file, whose `kind` names one of these."""
    return {"tube": Tube}
