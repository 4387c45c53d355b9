"""Several ways to mesh a body: the next one is tried when one fails."""

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

from taichisoft.errors import MeshError
from taichisoft.meshes.volume_mesh import VolumeMesh
from taichisoft_meshing.gmsh_session import GmshFailure, gmsh_session

Way = TypeVar("Way")

FRONTAL, MESH_ADAPT, DELAUNAY = 6, 1, 5
SURFACE_ALGORITHMS = (FRONTAL, MESH_ADAPT, DELAUNAY)
"""gmsh's numbers: the first gives the best triangles, the others fail less on surfaces that are hard to unroll."""


def mesh_in_some_way(body: str, ways: Sequence[Way], make: Callable[[Any, Way], VolumeMesh]) -> VolumeMesh:
    """The mesh of the first way that does not fail.

    Args:
        body: what is meshed, as errors call it.
        ways: in the order in which they are tried.
        make: meshes in a session of gmsh, in one of the ways.

    Raises:
        MeshError: that of the last way.
    """
    for number, way in enumerate(ways, 1):
        with gmsh_session(body) as gmsh:  # each its own: gmsh does nothing more after it has failed
            try:
                return make(gmsh, way)
            except Exception as error:
                if type(error) not in (Exception, GmshFailure, MeshError) or number == len(ways):
                    raise
    raise ValueError("there is no way to try")
