"""Search for contacts of round shapes, in kernels that only scenes with such shapes compile and launch."""

from taichisoft.contact.kernels.box_trees import Trees
from taichisoft.contact.kernels.contacts import Contacts, SearchSpace
from taichisoft.contact.kernels.round_shapes import MovedShapes, RoundShapes
from taichisoft.contact.kernels.shape_contacts import shapes_against_planes, shapes_against_shapes
from taichisoft.contact.kernels.shape_surface_contacts import shapes_against_surfaces
from taichisoft.contact.kernels.surface_vertices import MovedSurfaces, Planes, Surfaces
from taichisoft.runtime.language import ScalarTable, ti
from taichisoft.runtime.launch import kernel

# First groups, larger than all groups of `find_contacts`, whose numbers grow with the pairs of surfaces.
ON_SURFACES, ON_PLANES, ON_SHAPES = 1 << 28, 1 << 29, 1 << 30


@kernel
def find_on_surfaces(
    reach: ScalarTable,
    depth: ti.f64,
    surfaces: Surfaces,
    trees: Trees,
    moved: MovedSurfaces,
    shapes: RoundShapes,
    there: MovedShapes,
    space: SearchSpace,
    found: Contacts,
):
    """Add the contacts of shapes with surfaces, see `shapes_against_surfaces`; the count may exceed the capacity."""
    ti.loop_config(serialize=True)
    for _ in range(1):
        shapes_against_surfaces(reach, depth, ON_SURFACES, surfaces, trees, moved, shapes, there, space, found)


@kernel
def find_on_planes(
    reach: ScalarTable, planes: Planes, shapes: RoundShapes, there: MovedShapes, space: SearchSpace, found: Contacts
):
    """Add the contacts of shapes with planes within their reach [mm]; the count may exceed the capacity."""
    ti.loop_config(serialize=True)
    for _ in range(1):
        shapes_against_planes(reach, ON_PLANES, planes, shapes, there, space, found)


@kernel
def find_on_shapes(reach: ScalarTable, shapes: RoundShapes, there: MovedShapes, space: SearchSpace, found: Contacts):
    """Add the contacts of two shapes within their reach [mm]; the count may exceed the capacity."""
    ti.loop_config(serialize=True)
    for _ in range(1):
        shapes_against_shapes(reach, ON_SHAPES, shapes, there, space, found)
