"""Nodes inside a mesh that leave its surfaces unchanged: put into walls, and moved where tetrahedra are nearly flat."""

from collections import defaultdict
from dataclasses import replace
from itertools import combinations, product

import numpy as np

from taichisoft.mesh import CAVITY, VolumeMesh, boundary_triangles, element_volumes, tetrahedron_volumes
from taichisoft_meshing.body_tables import FittedSizes
from taichisoft_meshing.closed_shells import undirected_sides
from taichisoft_meshing.gmsh_session import TETRAHEDRON, TRIANGLE, gmsh_session
from taichisoft_meshing.mesh_quality import QualityLimits
from taichisoft_meshing.wall_quality import FACES, dihedral_angles, radius_ratios

# Two elements across every wall, by cuts inside a mesh that leave its surfaces unchanged.
#
# An edge that leads through the silicone from one point of the boundary to another makes a wall one element thick
# there, which bends much too stiffly; so does one through a layer, from one of its faces to another. gmsh puts no node
# into a thin wall, however small the size asked for; so such edges are cut in the middle, and all tetrahedra around
# them with them.

Edge = tuple[int, int]


def with_elements_across(mesh: VolumeMesh, sizes: FittedSizes) -> VolumeMesh:
    """Cut a mesh so that no edge leads through a wall or layer, if its sizes ask for two elements across walls.

    Nodes and triangles of its surfaces keep their numbers and places; triangles between element groups are cut, too.
    """
    if sizes.elements_across_walls == 1:
        return mesh
    part = np.zeros(len(mesh.elements), dtype=int)
    for number, group in enumerate(mesh.element_groups.values()):  # the first has all
        part[group] = number
    numbers = np.unique(part)
    layers = [mesh.elements[part == number] for number in numbers] if len(numbers) > 1 else []
    through = np.unique(np.vstack([through_edges(its) for its in (mesh.elements, *layers)]), axis=0)
    nodes, elements, parents = cut_edges(mesh.nodes, mesh.elements, through)
    faces = [boundary_triangles(elements[part[parents] == number]) for number in numbers]
    _, first = np.unique(np.sort(np.vstack(faces), axis=1), axis=0, return_index=True)
    fixed = np.vstack(faces)[np.sort(first)]
    nodes = without_inverted(nodes, _relocated(nodes, elements, fixed, mesh.source), elements)
    groups = mesh.element_groups.items()
    inherited = {name: np.flatnonzero(np.isin(parents, group)).astype(np.int32) for name, group in groups}
    surfaces = {name: _cut_triangles(mesh.nodes, its, through) for name, its in mesh.surface_groups.items()}
    return replace(mesh, nodes=nodes, elements=elements, surface_groups=surfaces, element_groups=inherited).check()


def _cut_triangles(nodes: np.ndarray, triangles: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Triangles cut as `cut_edges` cuts the tetrahedra at them; those without such edges as they are."""
    numbers = np.array([len(nodes), 1])
    cut = np.isin(undirected_sides(triangles).astype(np.int64) @ numbers, edges.astype(np.int64) @ numbers)
    here = cut.reshape(-1, 3).any(axis=1)
    return np.concatenate([triangles[~here], cut_edges(nodes, triangles[here], edges)[1]]) if here.any() else triangles


def through_edges(elements: np.ndarray) -> np.ndarray:
    """Edges inside a body between two nodes of its boundary, shape (count, 2)."""
    sides = np.unique(undirected_sides(boundary_triangles(elements)), axis=0)
    pairs = np.sort(elements[:, list(combinations(range(4), 2))].reshape(-1, 2), axis=1)
    between = np.unique(pairs[np.isin(pairs, sides).all(axis=1)], axis=0)
    both = np.vstack([sides, between])
    _, first, counts = np.unique(both, axis=0, return_index=True, return_counts=True)
    inside: np.ndarray = both[np.sort(first[(counts == 1) & (first >= len(sides))])]
    return inside


def cut_edges(nodes: np.ndarray, elements: np.ndarray, edges: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Put a node in the middle of each edge, the longest first, and halve the tetrahedra, or triangles, around it.

    Args:
        nodes: [mm], shape (node_count, 3).
        elements: tetrahedra or triangles, shape (element_count, 4 or 3).
        edges: each between two nodes, the lower first, shape (edge_count, 2).

    Returns:
        Nodes, the new ones last, tetrahedra, and for each of these the one that it is a part of.
    """
    tetrahedra = dict(enumerate(elements.tolist()))
    parents = list(range(len(elements)))
    around: dict[Edge, set[int]] = defaultdict(set)
    for number, corners in tetrahedra.items():
        for edge in combinations(sorted(corners), 2):
            around[edge].add(number)
    lengths = np.linalg.norm(np.subtract(*nodes[edges.T]), axis=1)
    ordered = edges[np.lexsort((edges[:, 1], edges[:, 0], -lengths))]
    following = len(elements)
    for middle, (begin, end) in enumerate(ordered.tolist(), len(nodes)):
        for number in sorted(around.pop((begin, end), set())):
            corners = tetrahedra.pop(number)
            for edge in combinations(sorted(corners), 2):
                around[edge].discard(number)
            for left_out in (begin, end):
                half = [middle if corner == left_out else corner for corner in corners]
                tetrahedra[following] = half
                parents.append(parents[number])
                for edge in combinations(sorted(half), 2):
                    around[edge].add(following)
                following += 1
    cut = np.array(list(tetrahedra.values()), dtype=np.int32)
    return np.vstack([nodes, nodes[ordered].mean(axis=1)]), cut, np.array(parents)[list(tetrahedra)]


def without_inverted(nodes: np.ndarray, moved: np.ndarray, elements: np.ndarray) -> np.ndarray:
    """Moved nodes, but the nodes of inverted tetrahedra at their old places.

    gmsh's relocation now and then moves a node past the opposite face of a flat tetrahedron, as they are beside thin
    walls. No tetrahedron is inverted with all nodes at their old places, so this ends there at the latest.

    Args:
        nodes: old places, with which all volumes are positive [mm], shape (node_count, 3).
        moved: new places [mm], shape (node_count, 3).
        elements: tetrahedra, shape (element_count, 4).
    """
    moved = moved.copy()
    while True:
        corners = np.unique(elements[element_volumes(moved, elements) <= 0])
        back = corners[(moved[corners] != nodes[corners]).any(axis=1)]
        if len(back) == 0:
            return moved
        moved[back] = nodes[back]


def _relocated(nodes: np.ndarray, elements: np.ndarray, boundary: np.ndarray, source: str) -> np.ndarray:
    """The nodes, those not of the boundary moved to where the worst tetrahedra around them are better."""
    on_boundary = np.unique(boundary)
    inside = np.setdiff1d(np.arange(len(nodes)), on_boundary)
    with gmsh_session(source) as gmsh:
        mesh = gmsh.model.mesh
        surface = gmsh.model.addDiscreteEntity(2)
        volume = gmsh.model.addDiscreteEntity(3, -1, [surface])
        for dimension, entity, numbers in ((2, surface, on_boundary), (3, volume, inside)):
            mesh.addNodes(dimension, entity, numbers + 1, nodes[numbers].ravel())
        mesh.addElementsByType(surface, TRIANGLE, [], (boundary + 1).ravel())
        mesh.addElementsByType(volume, TETRAHEDRON, [], (elements + 1).ravel())
        mesh.optimize("Relocate3D")
        tags, coordinates, _ = mesh.getNodes()
    moved = nodes.copy()
    moved[tags.astype(int) - 1] = coordinates.reshape(-1, 3)
    return moved


# Slivers, which are nearly flat tetrahedra without a short edge, are mended by moving their nodes inside the silicone.

SLIVER, GOOD = 0.04, 0.1
"""Radius ratios [-]: tetrahedra below the first have their nodes moved, until it is above the second."""

SWEEPS = 6
STEPS = 0.4 * 0.5 ** np.arange(5)
"""Lengths by which a node is moved, as parts of the mean length of the edges around it [-]."""

GAIN = 0.02
"""Least gain of the radius ratio in a step, as a share of it [-]; smaller ones take long and help little."""

DIRECTIONS = np.array([signs for signs in product((-1.0, 0.0, 1.0), repeat=3) if any(signs)])
DIRECTIONS /= np.linalg.norm(DIRECTIONS, axis=1, keepdims=True)

MOST_SLIVERS, MOST_SHARE = 40, 0.005
"""With more of them, and a larger share [-], a mesh is too coarse for its walls, and other places do not help."""

FLAT = 30.0
"""Largest angle between sides of a flat tetrahedron, or 180 degrees less it [degrees]."""


def least_shape(nodes: np.ndarray, elements: np.ndarray) -> float:
    """The least of the shapes of tetrahedra over the limits that meshes keep by default [-]: 1 and more keeps all."""
    limits, ratios, angles = QualityLimits(), radius_ratios(nodes, elements), dihedral_angles(nodes, elements)
    shares = (
        ratios.min() / limits.radius_ratio,
        angles.min() / limits.smallest_dihedral_angle,
        (180 - angles.max()) / (180 - limits.largest_dihedral_angle),
    )
    return float(min(shares))


def without_slivers(mesh: VolumeMesh) -> VolumeMesh:
    """Move the nodes of slivers that lie on no surface; the mesh itself where it keeps the default limits.

    Each goes where the worst tetrahedron around it has the largest radius ratio (Freitag and Ollivier-Gooch 1997).
    """
    nodes, elements = mesh.nodes.copy(), mesh.elements
    most = max(MOST_SLIVERS, MOST_SHARE * len(elements))
    if least_shape(nodes, elements) >= 1 or (radius_ratios(nodes, elements) < SLIVER).sum() > most:
        return mesh
    parts = {group.tobytes(): elements[group] for group in mesh.element_groups.values()}
    on_surfaces = np.unique(np.concatenate([boundary_triangles(its) for its in (elements, *parts.values())]))
    for _ in range(SWEEPS):
        ratios = radius_ratios(nodes, elements)
        slivers = np.flatnonzero(ratios < SLIVER)
        worst_first = elements[slivers[np.argsort(ratios[slivers], kind="stable")]].ravel()
        loose = worst_first[~np.isin(worst_first, on_surfaces)].tolist()
        before = nodes.copy()
        for node in dict.fromkeys(loose):
            nodes[node] = _best_place(nodes, elements[(elements == node).any(axis=1)], node)
        if (nodes == before).all():
            break
    return replace(mesh, nodes=nodes)


def without_flat_skin(mesh: VolumeMesh) -> VolumeMesh:
    """Leave out flat slivers with two or three sides on a surface, which then has their other sides.

    No place of an inner node helps them, and they have next to no volume; those with three sides are folds. The mesh
    is one part between closed surfaces that share no node; it is itself the result where it has no such sliver.
    """
    while True:
        elements, skin = mesh.elements, boundary_triangles(mesh.elements)
        on_skin, edges = set(map(frozenset, skin.tolist())), set(map(frozenset, undirected_sides(skin).tolist()))
        kept, touched = np.ones(len(elements), dtype=bool), set[int]()
        slivers = np.flatnonzero(radius_ratios(mesh.nodes, elements) < SLIVER)
        angles = dihedral_angles(mesh.nodes, elements[slivers])
        for sliver in slivers[(np.minimum(angles, 180.0 - angles) < FLAT).all(axis=1)].tolist():
            sides = elements[sliver][FACES]
            outside = np.array([frozenset(side) in on_skin for side in sides.tolist()])
            if outside.sum() not in (2, 3) or touched.intersection(elements[sliver].tolist()):
                continue
            between = frozenset.intersection(*map(frozenset, sides[~outside].tolist()))
            if between not in edges:  # else the skin would touch itself in this edge
                kept[sliver] = False
                touched.update(elements[sliver].tolist())
        if kept.all():
            return mesh
        used, corners = np.unique(elements[kept], return_inverse=True)
        skin = np.searchsorted(used, boundary_triangles(elements[kept])).astype(np.int32)
        groups = {}
        for name, triangles in mesh.surface_groups.items():
            its = skin[np.isin(used[skin[:, 0]], triangles)]
            groups[name] = np.ascontiguousarray(its[:, ::-1]) if name.startswith(CAVITY) else its
        elements = corners.reshape(-1, 4).astype(np.int32)
        parts = {name: np.arange(len(elements), dtype=np.int32) for name in mesh.element_groups}
        mesh = replace(
            mesh, nodes=mesh.nodes[used], elements=elements, surface_groups=groups, element_groups=parts
        ).check()


def _best_place(nodes: np.ndarray, around: np.ndarray, node: int) -> np.ndarray:
    """The place of a node, found by steps, at which the tetrahedra around it are best [mm], shape (3,)."""
    place, least = nodes[node], _least_ratios(nodes, around, node, nodes[node][None])[0]
    size = np.linalg.norm(nodes[around] - place, axis=2).sum() / (3 * len(around))
    for step in STEPS:
        while least < GOOD:
            places = place + step * size * DIRECTIONS
            ratios = _least_ratios(nodes, around, node, places)
            if ratios.max() <= max(least, 0.0) * (1 + GAIN):
                break
            place, least = places[ratios.argmax()], ratios.max()
    return place


def _least_ratios(nodes: np.ndarray, around: np.ndarray, node: int, places: np.ndarray) -> np.ndarray:
    """The least radius ratio around a node at each of the places, negative where a tetrahedron is inverted [-]."""
    corners = np.where((around == node)[..., None], places[:, None, None], nodes[around]).reshape(-1, 3)
    elements = np.arange(len(corners)).reshape(-1, 4)
    ratios = radius_ratios(corners, elements) * np.sign(tetrahedron_volumes(corners, elements))
    least: np.ndarray = ratios.reshape(len(places), -1).min(axis=1)
    return least
