"""The search for contacts: pairs of close points on two surfaces, each a local minimum of the distance."""

from taichisoft.contact.kernels.box_trees import Trees
from taichisoft.contact.kernels.contacts import Contacts, SearchSpace, put_in_order
from taichisoft.contact.kernels.edge_contacts import edges_against_edges
from taichisoft.contact.kernels.surface_vertices import MovedSurfaces, Planes, Surfaces
from taichisoft.contact.kernels.vertex_contacts import vertices_against_planes, vertices_against_triangles
from taichisoft.runtime.language import Scalars, ScalarTable, ti
from taichisoft.runtime.launch import kernel


@kernel
def find_contacts(
    reach: ScalarTable,
    depth: ti.f64,
    extent: Scalars,
    surfaces: Surfaces,
    trees: Trees,
    planes: Planes,
    moved: MovedSurfaces,
    space: SearchSpace,
    found: Contacts,
    contacts: Contacts,
):
    """Find all contacts closer than the `reach` of their two bodies or penetrating by up to `depth` [mm].

    Edges penetrate by no more than the smallest `extent` of both bodies [mm], shape (body_count,).
    A negative `reach` [mm], shape (body_count, body_count), skips a pair of bodies. If the capacity of `found` does not
    suffice, its count exceeds the capacity, and `contacts` is not filled.
    """
    ti.loop_config(serialize=True)
    for _ in range(1):
        found.count[0] = 0
        vertices_against_triangles(reach, depth, surfaces, trees, moved, space, found)
        edges_against_edges(reach, depth, extent, surfaces, trees, moved, space, found)
        vertices_against_planes(reach, surfaces, trees, planes, moved, space, found)
        if found.count[0] <= found.distance.shape[0]:
            put_in_order(space, found, contacts)


@kernel
def order_contacts(space: SearchSpace, found: Contacts, contacts: Contacts):
    """Write all contacts found to `contacts` in the order of their places, if the capacity suffices."""
    ti.loop_config(serialize=True)
    for _ in range(1):
        if found.count[0] <= found.distance.shape[0]:
            put_in_order(space, found, contacts)
