"""The search for contacts of round shapes; scenes without them do not launch it."""

from taichisoft.kernels.bounding_volumes import Trees
from taichisoft.kernels.contacts import Contacts, SearchSpace, put_in_order
from taichisoft.kernels.launch import kernel
from taichisoft.kernels.runtime import ScalarTable, ti
from taichisoft.kernels.shape_contacts import shapes_against_planes, shapes_against_shapes
from taichisoft.kernels.shape_surface_contacts import FEATURES, shapes_against_surfaces
from taichisoft.kernels.shapes import MovedShapes, Shapes
from taichisoft.kernels.surfaces import MovedSurfaces, Planes, Surfaces


@kernel
def find_shape_contacts(
    reach: ScalarTable,
    depth: ti.f64,
    surfaces: Surfaces,
    trees: Trees,
    planes: Planes,
    moved: MovedSurfaces,
    shapes: Shapes,
    there: MovedShapes,
    space: SearchSpace,
    found: Contacts,
    contacts: Contacts,
):
    """Add the contacts of shapes nearer than the `reach` of their bodies [mm] to those that `find_contacts` found.

    If there are more than `found` has room for, its count tells, and `contacts` is not filled.
    """
    ti.loop_config(serialize=True)
    for _ in range(1):
        # Behind the groups of `find_contacts`, whose places are still there.
        group = 3 * surfaces.pairs.shape[0] + planes.point.shape[0]
        shapes_against_surfaces(reach, depth, group, surfaces, trees, moved, shapes, there, space, found)
        group += FEATURES * shapes.surface_pairs.shape[0]
        shapes_against_planes(reach, group, planes, shapes, there, space, found)
        shapes_against_shapes(reach, group + planes.point.shape[0], shapes, there, space, found)
        if found.count[0] <= found.distance.shape[0]:
            put_in_order(space, found, contacts)
