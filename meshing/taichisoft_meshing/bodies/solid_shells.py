"""The closed surfaces of a solid that OpenCASCADE has made."""

from typing import Any

import numpy as np

from taichisoft_meshing.gmsh_session import GmshFailure


def shells_of_solid(occ: Any, solid: int) -> list[list[int]]:
    """Faces of the outside of a solid, then those of each void, in OpenCASCADE's order.

    Args:
        occ: `gmsh.model.occ`.
        solid: gmsh's number of the volume.

    Raises:
        GmshFailure: it has no surface.
    """
    shells = [faces.tolist() for faces in occ.getSurfaceLoops(solid)[1]]
    if not shells:
        raise GmshFailure("the body has no closed surface")
    outside = max(range(len(shells)), key=lambda number: _extent(occ, shells[number]))
    return [shells.pop(outside), *shells]


def _extent(occ: Any, faces: list[int]) -> float:
    boxes = np.array([occ.getBoundingBox(2, face) for face in faces])
    return float(np.linalg.norm(boxes[:, 3:].max(axis=0) - boxes[:, :3].min(axis=0)))
