"""Actuators of SoftRobots: air chambers, cables, and points and joints that are moved."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import trimesh
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from taichisoft_sofa.components.draft import DraftAnchor, DraftCable, DraftCavity, SceneDraft
from taichisoft_sofa.components.dynamics import HELD, axes_of
from taichisoft_sofa.components.meshes import split_quads
from taichisoft_sofa.components.reading import TOPOLOGIES, nearest, node_of, present_value, topology_of
from taichisoft_sofa.components.states import AnchorTarget, FramePoses, start_values
from taichisoft_sofa.components.topologies import surface_triangles
from taichisoft_sofa.tree.component import Component, component, live, unused, without_effect
from taichisoft_sofa.tree.value_kinds import (
    ABOVE_0,
    BOOLS,
    FROM_0,
    INDICES,
    LIMIT,
    LIMIT_FROM_0,
    LINK,
    fixed,
    index_rows,
    vectors,
)

# Cables that pull at areas of a surface: `method` "sphere" and "geodesic" of a CableConstraint.

METHODS = ("point", "sphere", "geodesic")


def list_areas(component: "Component", points: np.ndarray, draft: "SceneDraft") -> list[Any]:
    """The points and areas of a cable in the format of a native scene; empty if the component was refused.

    A vertex within the radius has the weight radius - distance, with the distance measured in space, or along
    the edges of the surface.

    Args:
        component: the cable.
        points: points of the mechanical object in the cable's node [mm], shape (count, 3).
        draft: draft of the scene, which records refusals and departures.
    """
    method, triangles = component.read_text("method"), surface_triangles(topology_of(component, "surfaceTopology"))
    if not len(triangles) or triangles.max() >= len(points):
        raise component.refused(f"method '{method}' needs a surfaceTopology of the points of its node, with triangles")
    centres = component.read_numbers("centers").reshape(-1, 3)
    if not len(centres):
        centres = points[component.read_numbers("indices").astype(np.int64)]
    radii = component.read_each("radii", len(centres), "places")
    draft.depart(
        f"{component.getPathName()}: its length is measured to the weighted means of its areas; in SOFA to one vertex "
        "of each, which is not what it pulls at"
    )
    along = _along_edges(points, triangles)
    surface, used = trimesh.Trimesh(points, triangles, process=False), np.unique(triangles)
    feet, _, under = trimesh.proximity.closest_point_naive(surface, centres)
    places: list[Any] = []
    for foot, triangle, radius in zip(feet, under, radii, strict=True):
        distance = np.full(len(points), np.inf)
        if method == "sphere":
            distance[used] = np.linalg.norm(points[used] - foot, axis=1)
        else:
            corners = triangles[triangle]
            first = np.linalg.norm(points[corners] - foot, axis=1)
            distance = (first[:, None] + dijkstra(along, indices=corners, limit=float(radius))).min(axis=0)
        within = np.flatnonzero(distance < radius)
        if len(within):
            places.append({"area": points[within].tolist(), "weights": (radius - distance[within]).tolist()})
        else:
            places.append(foot.tolist())
    return places


def _along_edges(points: np.ndarray, triangles: np.ndarray) -> csr_matrix:
    """Lengths of the edges of a surface [mm], as a matrix."""
    edges = np.unique(np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)
    lengths = np.linalg.norm(points[edges[:, 1]] - points[edges[:, 0]], axis=1)
    both = np.vstack([edges, edges[:, ::-1]])
    return csr_matrix((np.tile(lengths, 2), both.T), shape=(len(points), len(points)))


PRESSURE, VOLUME = "pressure", "volumeGrowth"


def value_type(component: "Component") -> str:
    """Type of a cavity's value, PRESSURE or VOLUME; scenes may also write their numbers."""
    given = component.read_text("valueType")
    return {"0": PRESSURE, "1": VOLUME}.get(given, given)


FORCE, DISPLACEMENT = "force", "displacement"


def is_driven_by_force(actuator: "Component") -> bool:
    """Whether an actuator's value is a force, else a displacement."""
    given = actuator.read_text("valueType")
    if given not in (FORCE, DISPLACEMENT, "0", "1"):
        raise actuator.refused(f"valueType '{given}'; valid: {FORCE}, {DISPLACEMENT}")
    return given in (FORCE, "1")


VALUE = {"value": live((0.0,)), "valueIndex": live(0, FROM_0)}


@component(
    "SurfacePressureConstraint",
    **VALUE,
    valueType=PRESSURE,
    triangles=index_rows(3),
    quads=index_rows(4),
    flipNormal=False,
    **dict.fromkeys(("minPressure", "maxPressure", "minVolumeGrowth", "maxVolumeGrowth"), (0.0, LIMIT)),
    **dict.fromkeys(("maxPressureVariation", "maxVolumeGrowthVariation"), live(0.0, LIMIT_FROM_0)),
    **dict.fromkeys(("pressure", "initialCavityVolume", "cavityVolume", "volumeGrowth"), 0.0),
)
def cavity(component: "Component", draft: "SceneDraft") -> None:
    """Translate a closed surface with a pressure on its walls."""
    body = draft.body_of(component)
    if value_type(component) not in (PRESSURE, VOLUME):
        raise component.refused(f"valueType '{value_type(component)}'; valid: {PRESSURE}, {VOLUME}")
    triangles = component.read_numbers("triangles").astype(np.int64).reshape(-1, 3)
    quads = component.read_numbers("quads").astype(np.int64).reshape(-1, 4)
    if not len(triangles) and not len(quads):
        triangles = surface_triangles(nearest(node_of(component), TOPOLOGIES))
    walls = np.vstack([triangles, split_quads(quads)])
    if not len(walls):
        raise component.refused("has no triangles, of its own or in a topology container of its node")
    points = draft.points_of(component)
    draft.check_points(component, walls, len(points))
    if component.read_flag("flipNormal"):
        walls = walls[:, ::-1]
    body.cavities.append(DraftCavity(component, points, walls))


@component(
    "CableConstraint",
    **VALUE,
    valueType=DISPLACEMENT,
    indices=(INDICES, (0,), FROM_0),
    pullPoint=live(fixed(3)),
    hasPullPoint=True,
    **dict.fromkeys(("minForce", "maxForce", "maxPositiveDisp", "maxNegativeDisp"), (0.0, LIMIT)),
    maxDispVariation=live(0.0, LIMIT_FROM_0),
    cableInitialLength=live(0.0, FROM_0),
    **dict.fromkeys(("cableLength", "displacement", "force"), 0.0),
    **dict.fromkeys(("eqForce", "eqDisp"), ()),
    method="point",
    centers=vectors(3),
    radii=((1.0,), ABOVE_0),
    surfaceTopology=LINK,
    **without_effect("drawPullPoint"),
)
def cable(component: "Component", draft: "SceneDraft") -> None:
    """Translate a cable through points of a body, or to areas of its surface."""
    body = draft.body_of(component)
    method = component.read_text("method")
    if method not in METHODS:
        raise component.refused(f"method '{method}'; valid: {', '.join(METHODS)}")
    points = draft.points_of(component)
    indices = component.read_numbers("indices").astype(np.int64)
    if not len(indices) or indices.min() < 0 or indices.max() >= len(points):
        raise component.refused(f"indices must be among the {len(points)} points of its MechanicalObject")
    places = points[indices].tolist() if method == "point" else list_areas(component, points, draft)
    if places:
        body.cables.append(DraftCable(component, places))


# Points and joints that are moved by a value.

MOVED = {
    **VALUE,
    "valueType": DISPLACEMENT,
    **dict.fromkeys(("force", "displacement"), 0.0),
    **{name: unused(0.0) for name in ("minForce", "maxForce")},
}


def _check_moved(component: "Component") -> None:
    if is_driven_by_force(component):
        raise component.refused(f"valueType '{FORCE}'; only a {DISPLACEMENT} is imposed here")
    present_value(component)


@dataclass(frozen=True)
class ShiftedTarget(AnchorTarget):
    """Points that a PositionConstraint shifts: itself, and where they are at the start [mm], shape (count, 3)."""

    constraint: "Component"
    start: np.ndarray

    def places(self, rows: np.ndarray, time: float, poses: FramePoses) -> np.ndarray:
        return self.start[rows] + present_value(self.constraint)


@component(
    "PositionConstraint",
    **MOVED,
    indices=(INDICES, (0,), FROM_0),
    useDirections=(BOOLS, (True, True, True)),
    directions=vectors(3),
    **{name: unused(0.0) for name in ("maxPositiveDisp", "maxNegativeDisp")},
)
def moved_points(component: "Component", draft: "SceneDraft") -> None:
    """Translate points that are shifted by a value along axes."""
    body = draft.own_body_of(component)
    _check_moved(component)
    points, directions = draft.points_in(component, body, "indices"), component.read_numbers("directions")
    if body.rigid or (len(directions) and not np.array_equal(directions, np.eye(3).ravel())):
        raise component.refused(
            "moves points of soft bodies along x, y and z, not rigid bodies or along other directions"
        )
    axes = axes_of(component, "useDirections", component.read_numbers("useDirections"))
    target = ShiftedTarget(component, body.position[points])
    # As in SOFA: without any axis, along all.
    body.anchors.append(DraftAnchor(component, points, HELD, False, axes or "xyz", target))


@component(
    "JointConstraint",
    **MOVED,
    index=(0, FROM_0),
    **{name: unused(0.0) for name in ("minDisplacement", "maxDisplacement")},
)
def moved_joint(component: "Component", draft: "SceneDraft") -> None:
    """Translate an angle of a mechanical object of Vec1 that is turned by a value from where it is at the start."""
    joint, index = draft.joint_of(component), int(component.read_number("index"))
    if joint is None:
        raise component.refused("acts on no angle; its node must have a MechanicalObject of Vec1")
    _check_moved(component)
    draft.check_points(component, np.array([index]), len(start_values(joint.state)))
    joint.moved[index] = component
