"""Soft bodies: tetrahedra with materials, masses, anchors, and the surfaces that follow them."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from taichisoft.mechanics import embed
from taichisoft.mesh import VolumeMesh, count_open_edges, enclosed_volume, tetrahedron_volumes
from taichisoft.scene import lame_parameters
from taichisoft_sofa.components.air_and_cables import PRESSURE, is_driven_by_force, value_type
from taichisoft_sofa.components.draft import DraftAnchor, DraftBody, DraftMaterial, Mass, SceneDraft
from taichisoft_sofa.components.reading import TOPOLOGIES, computed, nearest, node_of
from taichisoft_sofa.components.states import (
    FrameMotion,
    PointsTarget,
    rest_position,
    start_velocity,
)
from taichisoft_sofa.translation.parts import (
    NO_TRIANGLES,
    SoftPart,
    Translation,
    actuator_names,
    clean,
    collides,
    unique,
)
from taichisoft_sofa.tree.component import Component
from taichisoft_sofa.tree.value_kinds import canonical

STANDING = 1e12
"""Stiffness that holds every node of a body without a solver in SOFA [mN/mm]."""

PRESSURE_LIMITS = {"lowest_pressure": ("minPressure", 1.0), "highest_pressure": ("maxPressure", 1.0)}
VOLUME_LIMITS = {"lowest_volume_growth": ("minVolumeGrowth", 1.0), "highest_volume_growth": ("maxVolumeGrowth", 1.0)}
TENSION_LIMITS = {"lowest_tension": ("minForce", 1.0), "highest_tension": ("maxForce", 1.0)}
PULL_LIMITS = {"lowest_pull": ("maxNegativeDisp", -1.0), "highest_pull": ("maxPositiveDisp", 1.0)}
"""Limits of actuators: data and sign of each."""
SAME = 1e-9
"""Difference of a rest position that is round-off, over the size of a body [-]."""
MASSLESS = 1e-12
"""Mass of a body to which its scene gives none, so that stiffness alone moves it [kg]."""
LARGEST = 1e30
"""Beyond any tension [mN] and pull [mm]: scenes use the largest number as no limit."""


def body_tetrahedra(body: DraftBody) -> np.ndarray:
    """Tetrahedra of a body: from its topology, then additional ones from force fields, shape (count, 4)."""
    rows = np.vstack(
        [computed(_topology(body), "tetrahedra", 4), *(material.tetrahedra for material in body.materials)]
    )
    _, first = np.unique(np.sort(rows, axis=1), axis=0, return_index=True)
    return rows[np.sort(first)]


def _topology(body: DraftBody) -> Component | None:
    return nearest(body.node, TOPOLOGIES, lambda container: len(computed(container, "tetrahedra", 4)) > 0)


def add_soft_body(
    name: str, body: DraftBody, solver: Component | None, draft: SceneDraft, translation: Translation
) -> None:
    """Add a soft body to a translation; without a solver it stands still."""
    moves = solver is not None
    tetrahedra = body_tetrahedra(body)
    draft.check_points(_topology(body) or body.state, tetrahedra, len(body.position))
    young, poisson = add_moduli(tetrahedra, body.materials)
    if moves and not body.materials:
        raise body.state.refused("moves, but no force field gives its tetrahedra a stiffness")
    if moves and body.mass is None:
        draft.depart(f"{body.node.getPathName()}: has no mass; here it has {MASSLESS:g} kg, with the same motion")
    if _strain(rest_position(body.state).reshape(-1, 3), body.position) > SAME:
        raise body.state.refused("position differs from rest_position; a body begins at rest here")
    if moves and (young <= 0.0).all():
        raise body.state.refused("moves, but youngModulus = 0 leaves its tetrahedra without stiffness")
    if moves and (young <= 0.0).any():
        count = int((young <= 0.0).sum())
        draft.depart(f"{body.node.getPathName()}: {count} tetrahedra without stiffness are left out")
        tetrahedra, young, poisson = tetrahedra[young > 0.0], young[young > 0.0], poisson[young > 0.0]
    points, corners = np.unique(tetrahedra, return_inverse=True)
    elements = corners.reshape(-1, 4)
    node_position = body.position[points]
    if len(points) < len(body.position):
        unused = len(body.position) - len(points)
        draft.depart(f"{body.node.getPathName()}: {unused} points that belong to no tetrahedron are left out")
    inverted = tetrahedron_volumes(node_position, elements) < 0.0
    # Keeps the first edge and the plane of the first two edges, and so the rotation of the element.
    elements[inverted] = elements[inverted][:, [1, 0, 2, 3]]
    element_material, regions = _regions(young, poisson)
    groups = {f"material{number}": np.flatnonzero(element_material == number) for number in range(1, len(regions))}
    table: dict[str, Any] = {
        "points_outside": "extrapolated",
        "mesh": translation.files.volume(name, VolumeMesh(name, node_position, elements, {}, groups)),
        "element": body.materials[0].element if body.materials else "linear",
        **_mass(body.mass if moves else None, len(points), len(body.position), node_position, elements),
        "young_modulus": regions[0]["young_modulus"],
        "poisson_ratio": regions[0]["poisson_ratio"],
        "regions": [{"group": f"material{number}", **region} for number, region in enumerate(regions[1:], 1)],
    }
    if solver is not None:
        if (velocity := start_velocity(body.state)).any() and not translation.is_static:
            table["velocity"] = velocity.tolist()
        table["rayleigh_mass"] = solver.read_number("rayleighMass", default=0.0)
        table["rayleigh_stiffness"] = solver.read_number("rayleighStiffness", default=0.0)
        # Nodes on frames and in prescribed motions are where these are: the lag is that of a joint's angle.
        sprung = (type(None), PointsTarget)
        table["damped_anchors"] = all(isinstance(anchor.target, sprung) for anchor in body.anchors)
    topology = _topology(body)
    if topology is not None and canonical(topology.type_name) == "TetrahedronSetTopologyContainer":
        table["embedding"] = "grid"
    kinds = {
        (material.corotation, material.law, material.element, *material.coefficients.items())
        for material in body.materials
    }
    if len(kinds) > 1:
        draft.refuse(
            body.materials[1].component,
            "force fields of one body must take law, element and rotation of elements alike",
        )
    table["corotation"], table["law"], *_ = next(iter(kinds), ("edges", "hooke", "linear"))
    if body.materials and body.materials[0].coefficients:
        table["coefficients"] = dict(body.materials[0].coefficients)
        del table["young_modulus"]
    node_of_point = np.full(len(body.position), -1)
    node_of_point[points] = np.arange(len(points))
    anchors = body.anchors if moves else [DraftAnchor(body.state, np.arange(len(body.position)), STANDING, False)]
    table["anchors"] = _anchors(anchors, node_of_point)
    if moves and (forces := _forces(body, node_of_point, node_position, elements, table.get("embedding"), draft)):
        table["forces"] = forces
    _add_surfaces(name, body, table, draft, translation)
    _add_cavities(name, body, table, draft, translation)
    _add_cables(name, body, table, draft, translation)
    translation.tables.setdefault("soft_bodies", {})[name] = table
    translation.names[body.state] = name
    translation.soft[name] = _held_part(SoftPart(body, points, elements, element_material), anchors, node_of_point)


def _strain(rest: np.ndarray, position: np.ndarray) -> float:
    """How far points differ from a rigid motion of their rest positions, over the size of the body."""
    size = float(np.ptp(position, axis=0).max(initial=0.0))
    if rest.shape != position.shape or size == 0.0:
        return 0.0
    before, after = rest - rest.mean(axis=0), position - position.mean(axis=0)
    # Rotation by Kabsch; points without extent in some direction are turned about it by any angle.
    left, _, right = np.linalg.svd(before.T @ after)
    turn = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    return float(np.abs(before @ turn - after).max()) / size


def _held_part(part: SoftPart, anchors: Sequence[DraftAnchor], node_of_point: np.ndarray) -> SoftPart:
    """A soft body with what its anchored nodes follow; of two anchors along one axis of a node the later decides."""
    count = len(part.points)
    by, follows = np.full((count, 3), -1), np.ones((count, 3), dtype=bool)
    for place, anchor in enumerate(anchors):
        nodes = node_of_point[anchor.points]
        held_here = np.ix_(nodes[nodes >= 0], anchor.axes)
        by[held_here] = place
        follows[held_here] &= anchor.follows_rest
    held = (by >= 0).any(axis=1)
    targets = []
    for place, anchor in enumerate(anchors):
        if anchor.target is not None and not isinstance(anchor.target, FrameMotion):
            there, row = np.flatnonzero(node_of_point[anchor.points] >= 0), np.zeros(count, dtype=np.int64)
            row[node_of_point[anchor.points[there]]] = there
            own = by[held] == place
            for axes in np.unique(own[own.any(axis=1)], axis=0):
                chosen = np.flatnonzero((own == axes).all(axis=1))
                targets.append((anchor.target, chosen, row[held][chosen], np.flatnonzero(axes)))
    return replace(part, anchored=np.flatnonzero(held), anchored_follows=follows[held], targets=tuple(targets))


def add_moduli(tetrahedra: np.ndarray, materials: Sequence[DraftMaterial]) -> tuple[np.ndarray, np.ndarray]:
    """Young's modulus [kPa] and Poisson's ratio of the sum of force fields on each tetrahedron; 0 without any."""
    place = {tuple(sorted(row)): index for index, row in enumerate(tetrahedra.tolist())}
    lame, young = np.zeros((len(tetrahedra), 2)), np.zeros(len(tetrahedra))
    poisson, differs = np.full(len(tetrahedra), np.nan), np.zeros(len(tetrahedra), dtype=bool)
    for material in materials:
        rows = np.array([place.get(tuple(sorted(row)), -1) for row in material.tetrahedra.tolist()], dtype=np.int64)
        there = rows >= 0
        rows, own_young, own_poisson = rows[there], material.young_modulus[there], material.poisson_ratio[there]
        np.add.at(lame, rows, lame_parameters(own_young, own_poisson))
        np.add.at(young, rows, own_young)
        differs[rows] |= ~np.isnan(poisson[rows]) & (poisson[rows] != own_poisson)
        poisson[rows] = own_poisson
    first, second = lame[differs].T
    young[differs] = second * ((3 * first + 2 * second) / (first + second))
    poisson[differs] = first / (2 * (first + second))
    return young, np.nan_to_num(poisson)


def _regions(young: np.ndarray, poisson: np.ndarray) -> tuple[np.ndarray, list[dict[str, Any]]]:
    """Number of each element's material, and all materials, the most frequent first."""
    kinds, kind_of = np.unique(np.column_stack([young, poisson]), axis=0, return_inverse=True)
    kind_of = kind_of.reshape(-1)
    counts = Counter(kind_of.tolist())
    order = sorted(counts, key=lambda kind: (-counts[kind], kind))
    number_of = np.argsort(np.array(order))
    # A static body may have no stiffness in SOFA, but a native body needs one.
    materials = [{"young_modulus": kinds[kind, 0] or 1.0, "poisson_ratio": kinds[kind, 1]} for kind in order]
    return number_of[kind_of], [{key: float(value) for key, value in region.items()} for region in materials]


def merged_triangles(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Triangles with vertices at the same place merged, as when read from the file."""
    _, same = np.unique(points, axis=0, return_inverse=True)
    merged = same.reshape(-1)[triangles]
    return merged[(merged != np.roll(merged, 1, axis=1)).all(axis=1)]


def _mass(mass: Mass | None, kept: int, all_points: int, nodes: np.ndarray, elements: np.ndarray) -> dict[str, float]:
    """Mass or density, without the share of omitted points."""
    if mass is None:
        return {"mass": MASSLESS}
    if mass.density:
        return {"density": mass.density}
    if mass.density == 0.0 and mass.total is not None:
        return {"density": mass.total / float(np.abs(tetrahedron_volumes(nodes, elements)).sum())}
    each = mass.each if mass.each is not None else (mass.total or 0.0) / all_points
    return {"mass": mass.total if mass.total is not None and kept == all_points else each * kept}


def _anchors(anchors: list[DraftAnchor], node_of_point: np.ndarray) -> list[dict[str, Any]]:
    tables = []
    for anchor in anchors:
        nodes = np.unique(node_of_point[anchor.points])
        nodes = nodes[nodes >= 0]
        if len(nodes) and anchor.stiffness > 0.0:
            table = {"nodes": nodes.tolist(), "stiffness": anchor.stiffness}
            tables.append(table if anchor.directions == "xyz" else table | {"directions": [*anchor.directions]})
    return tables


def _part_open_surfaces(
    surfaces: list[dict[str, Any]], name: str, draft: SceneDraft, parts_touch: bool = False
) -> None:
    """Give the open surfaces of a body a group in common, or all if some are those of rigid parts, which overlap.

    What lies behind an open surface is inside of it, so that two that stand back to back would overlap.
    """
    open_ones = surfaces if parts_touch else [surface for surface in surfaces if surface.get("open")]
    if len(open_ones) < 2:
        return
    taken = {group for body in draft.bodies.values() for one in body.surfaces.values() for group in one.groups}
    group = max(taken, default=0) + 1 + draft.own_groups
    draft.own_groups += 1
    for surface in open_ones:
        surface["groups"] = sorted({*surface.get("groups", []), group})
    kind = "surfaces" if parts_touch else "open surfaces"
    draft.depart(f"{name}: its {len(open_ones)} {kind} do not touch each other; in SOFA they do")


def _forces(
    body: DraftBody,
    node_of_point: np.ndarray,
    position: np.ndarray,
    elements: np.ndarray,
    embedding: Any,
    draft: SceneDraft,
) -> list[dict[str, Any]]:
    """Constant forces, those of nodes with the same force together."""
    each = np.zeros((len(position), 3))
    for one in body.forces:
        if one.places is not None:
            corners, weights = embed(one.places, position, elements, embedding or "deepest")
            np.add.at(each, corners, weights[:, :, None] * one.forces[:, None])
            continue
        nodes = node_of_point[one.points]
        np.add.at(each, nodes[nodes >= 0], one.forces[nodes >= 0])
        if one.forces[nodes < 0].any():
            draft.depart(f"{one.component.getPathName()}: forces on points that are left out have no effect")
    kinds, kind_of = np.unique(each, axis=0, return_inverse=True)
    groups = [(force, np.flatnonzero(kind_of.reshape(-1) == kind)) for kind, force in enumerate(kinds) if force.any()]
    return [{"nodes": nodes.tolist(), "force": (force * len(nodes)).tolist()} for force, nodes in groups]


def _add_surfaces(
    name: str, body: DraftBody, table: dict[str, Any], draft: SceneDraft, translation: Translation
) -> None:
    surfaces = [surface for surface in body.surfaces.values() if len(surface.triangles)]
    for surface in body.surfaces.values():
        if not len(surface.triangles):
            draft.refuse(surface.component, NO_TRIANGLES)
        if surface.self_collision:
            table["self_contact"] = True
            draft.depart(
                f"{node_of(surface.component).getPathName()}: touches itself where it is not nearer to itself at rest "
                "than twice the contact distance; in SOFA neighbours in the mesh alone are left out"
            )
    if table.get("self_contact") and not all(surface.self_collision for surface in surfaces):
        draft.depart(f"{name}: all its surfaces touch themselves; selfCollision is set for some of them")
    if not surfaces or not collides(draft):
        table["collides"] = False
    names = unique([clean(node_of(surface.component).getName()) for surface in surfaces])
    for surface_name, surface in zip(names, surfaces, strict=True):
        made: dict[str, Any] = {
            "file": translation.files.surface(f"{name}-{surface_name}", surface.points, surface.triangles)
        }
        if surface.groups:
            made["groups"] = sorted(surface.groups)
        if count_open_edges(merged_triangles(surface.points, surface.triangles)):
            made["open"] = True
        table.setdefault("collision_surface", []).append(made)
    parts_touch = any(surface.is_carried for surface in surfaces)
    _part_open_surfaces(table.get("collision_surface", []), name, draft, parts_touch)


def _add_cavities(
    name: str, body: DraftBody, table: dict[str, Any], draft: SceneDraft, translation: Translation
) -> None:
    names = unique(actuator_names([cavity.component for cavity in body.cavities]))
    for cavity_name, cavity in zip(names, body.cavities, strict=True):
        component = cavity.component
        sign = 1.0 if enclosed_volume(cavity.points, cavity.triangles) > 0.0 else -1.0
        path = translation.files.surface(f"{name}-{cavity_name}", cavity.points, cavity.triangles)
        limits = _limits(component, PRESSURE_LIMITS, sign * draft.effort_of_value) | _limits(
            component, VOLUME_LIMITS, 1.0
        )
        table.setdefault("cavities", {})[cavity_name] = {"surface": path, **limits}
        if value_type(component) == PRESSURE:
            _note_stops(component, VOLUME_LIMITS, draft)
        translation.names[component] = f"{name}.{cavity_name}"
        translation.signs[component] = sign


def _add_cables(name: str, body: DraftBody, table: dict[str, Any], draft: SceneDraft, translation: Translation) -> None:
    cavities = list(table.get("cavities", {}))
    names = unique([*cavities, *actuator_names([cable.component for cable in body.cables])])[len(cavities) :]
    for cable_name, cable in zip(names, body.cables, strict=True):
        component = cable.component
        made: dict[str, Any] = {"points": cable.places, "pull_point_moves": False}
        if component.read_flag("hasPullPoint"):
            made["pull_point"] = component.read_vector("pullPoint").tolist()
        if not component.is_given("minForce") or component.read_number("minForce") < 0.0:
            made["rod"] = True
        made |= _limits(component, TENSION_LIMITS, draft.effort_of_value)
        made |= _limits(component, PULL_LIMITS, 1.0)
        if is_driven_by_force(component):
            _note_stops(component, PULL_LIMITS, draft)
        table.setdefault("cables", {})[cable_name] = made
        translation.names[component] = f"{name}.{cable_name}"


def _note_stops(component: Component, names: Mapping[str, tuple[str, float]], draft: SceneDraft) -> None:
    """Record that stops engage later than in SOFA, which counts the response to a force or pressure twice."""
    given = [data for data, _ in names.values() if component.is_given(data)]
    if given:
        draft.depart(f"{component.getPathName()}: {' and '.join(given)} engages where it is reached; in SOFA earlier")


def _limits(component: Component, names: Mapping[str, tuple[str, float]], factor: float) -> dict[str, float]:
    """Native limits of an actuator; a negative factor exchanges lowest and highest."""
    found = {
        key: max(-LARGEST, min(LARGEST, sign * factor * component.read_number(data)))
        for key, (data, sign) in names.items()
        if component.is_given(data)
    }
    if factor >= 0.0:
        return found
    opposite = {"lowest": "highest", "highest": "lowest"}
    return {f"{opposite[end]}_{what}": limit for key, limit in found.items() for end, _, what in [key.partition("_")]}
