"""Contact: pipeline, response, planes and collision surfaces."""

import re

import numpy as np
import trimesh

from taichisoft_sofa.components.draft import DraftBody, DraftPlane, DraftSurface, SceneDraft
from taichisoft_sofa.components.reading import TOPOLOGIES, described, nearest, node_of
from taichisoft_sofa.components.topologies import collision_triangles
from taichisoft_sofa.tree.component import Component, component, unused, without_effect
from taichisoft_sofa.tree.value_kinds import ABOVE_0, ANY, FROM_0, INDICES, fixed

DEFAULT_FRICTION = 0.8
"""Default friction coefficient of SOFA's frictional contacts [-]."""
WITHOUT_FRICTION = "PenalityContactForceField"
"""SOFA's default response."""


@component("CollisionPipeline")
def pipeline(component: "Component", draft: "SceneDraft") -> None:
    """The pipeline of contacts."""
    draft.pipeline["pipeline"] = component


@component(
    *("BruteForceBroadPhase", "BruteForceDetection", "IncrSAP", "DirectSAP", "ParallelBruteForceBroadPhase"),
    **without_effect("box"),
)
def broad_phase(component: "Component", draft: "SceneDraft") -> None:
    """The broad phase of contacts."""
    draft.pipeline["broad phase"] = component
    if component.type_name == "BruteForceDetection":  # both phases, in older versions
        draft.pipeline["narrow phase"] = component


@component("BVHNarrowPhase", "ParallelBVHNarrowPhase")
def narrow_phase(component: "Component", draft: "SceneDraft") -> None:
    """The narrow phase of contacts."""
    draft.pipeline["narrow phase"] = component


@component(
    "RuleBasedContactManager",
    response="",
    responseParams="",
    default="",
    rules=unused(""),
    variables=unused(""),
)
def response(component: "Component", draft: "SceneDraft") -> None:
    """The response to contacts, with their friction."""
    kind = response_of(component)
    if not re.match("Penal|Friction(less)?Contact(Constraint)?$", kind):
        raise component.refused(f"response '{kind}'; known are FrictionContactConstraint and {WITHOUT_FRICTION}")
    draft.pipeline["response"] = component


@component(
    *("LocalMinDistance", "MinProximityIntersection", "NewProximityIntersection", "DiscreteIntersection"),
    alarmDistance=(1.0, ABOVE_0),
    contactDistance=(0.5, FROM_0),
)
def distance(component: "Component", draft: "SceneDraft") -> None:
    """The distances at which contacts begin."""
    draft.pipeline["distance"] = component


CONSTRAINT_SOLVERS = (
    *("BlockGaussSeidelConstraintSolver", "ProjectedGaussSeidelConstraintSolver"),
    *("UnbuiltGaussSeidelConstraintSolver", "NNCGConstraintSolver", "ImprovedJacobiConstraintSolver"),
    "LCPConstraintSolver",
)
MEASURED = ("currentNumConstraints", "currentNumConstraintGroups", "currentIterations", "currentError")
"""Data that scenes print, which have no value here."""
SOLVER = {
    "constraintForces": (),
    "regularizationTerm": unused(0.0),
    **dict.fromkeys(MEASURED, ANY),
    **without_effect("computeConstraintForces"),
}


@component(*CONSTRAINT_SOLVERS[:-1], **SOLVER)
def accept_any(component: "Component", draft: "SceneDraft") -> None:
    """Accept a solver of constraints; the engine's own stands for any."""


@component("LCPConstraintSolver", **SOLVER, mu=(0.6, FROM_0))
def solver_with_friction(component: "Component", draft: "SceneDraft") -> None:
    """The solver of constraints whose own friction holds for all contacts, whatever their response says, as in SOFA."""
    draft.pipeline["friction"] = component


def response_of(manager: "Component") -> str:
    """Type of the response of a contact manager."""
    written = manager.read_text("response") or manager.read_text("default") or WITHOUT_FRICTION
    return WITHOUT_FRICTION if written == "default" else written.partition("?")[0]


def friction_of(manager: "Component", draft: "SceneDraft") -> float:
    """Friction coefficient of a contact manager for all pairs of bodies [-]; 0 if its contacts have none in SOFA."""
    sources = {name: manager.read_text(name) for name in ("responseParams", "response", "default")}
    kind = response_of(manager)
    if "Friction" not in kind or kind.startswith("Frictionless"):
        draft.depart(f"{described(manager)}: response '{kind}': surfaces touch without friction, and do not give way")
        return 0.0
    if "friction" in draft.pipeline:
        return draft.pipeline["friction"].read_number("mu")
    for name, source in sources.items():
        if found := re.search(r"(?:^|[?&\s])mu\s*=\s*([^&\s]*)", source):
            try:
                friction = float(found[1])
            except ValueError:
                friction = -1.0
            if not 0.0 <= friction < np.inf:
                raise manager.refused(f"{name} = '{source}': mu must be 0 or more")
            return friction
    if sources["responseParams"]:
        draft.depart(f"{described(manager)}: responseParams has no mu; friction is SOFA's {DEFAULT_FRICTION:g}")
    return DEFAULT_FRICTION


@component(
    "PlaneForceField",
    normal=(fixed(3), (0.0, 1.0, 0.0)),
    planeNormal=(fixed(3), (0.0, 1.0, 0.0)),
    d=0.0,
    planeD=0.0,
    bilateral=False,
    maxForce=unused(0.0),
    stiffness=(500.0, FROM_0),
    indices=unused(()),
    localRange=unused(()),
)
def penalty_plane(component: "Component", draft: "SceneDraft") -> None:
    """Translate a plane that pushes the points of a body out of what is behind it."""
    body = draft.own_body_of(component)
    if body.rigid and len(body.position) > 1:
        raise component.refused(f"acts on {len(body.position)} frames; give each a MechanicalObject with one")
    normal = component.read_vector("normal", "planeNormal")
    length = float(np.linalg.norm(normal))
    if length == 0.0:
        raise component.refused("normal = 0 0 0 has no direction")
    if component.read_flag("bilateral"):
        raise component.refused("bilateral = true; planes push from one side here")
    draft.planes.append(DraftPlane(component, body, normal / length, component.read_number("d", "planeD") / length))


MODEL = {
    "group": INDICES,
    "selfCollision": False,
    "active": True,
    "contactResponse": unused(""),
    "contactStiffness": unused(10.0),
    **{name: unused(0.0) for name in ("proximity", "contactDistance", "contactFriction", "contactRestitution")},
}
"""Data of every collision model."""


@component("TriangleCollisionModel", "LineCollisionModel", "PointCollisionModel", **MODEL)
def collision_model(component: "Component", draft: "SceneDraft") -> None:
    """Translate a collision model; all models of a node are one surface."""
    body = draft.carrier_of(component)
    if body is None or not component.read_flag("active"):
        return
    path = node_of(component).getPathName()
    groups = frozenset(component.read_numbers("group").astype(int).tolist())
    if path not in body.surfaces:
        triangles = collision_triangles(nearest(node_of(component), TOPOLOGIES))
        points = draft.points_of(component)
        draft.check_points(component, triangles, len(points))
        body.surfaces[path] = DraftSurface(component, points, triangles, groups, False)
    surface = body.surfaces[path]
    if groups != surface.groups:
        draft.depart(f"{path}: its collision models have different groups; here its surface has all of them")
        surface.groups |= groups
    surface.self_collision |= component.read_flag("selfCollision")


# Collision spheres about the points of mechanical objects.

FINEST, COARSEST = 2, 1
"""Subdivisions of an icosahedron for a few spheres, and for many."""
FEW = 20


@component("SphereCollisionModel", **MODEL, radius=(1.0, ABOVE_0), listRadius=((), ABOVE_0))
def sphere_model(component: "Component", draft: "SceneDraft") -> None:
    """Translate spheres about points: a single one of a rigid body or point stays round, others become polyhedra."""
    body = draft.carrier_of(component)
    if body is None or not component.read_flag("active"):
        return
    centres = draft.points_of(component)
    each = component.read_numbers("listRadius")
    radii = each if len(each) else np.full(len(centres), component.read_number("radius"))
    if len(radii) != len(centres):
        raise component.refused(f"listRadius has {len(radii)} numbers for {len(centres)} points")
    if not len(centres):
        raise component.refused("has no points to be the centres of its spheres")
    ball = trimesh.creation.icosphere(subdivisions=FINEST if len(centres) <= FEW else COARSEST)
    points = (centres[:, None] + radii[:, None, None] * np.array(ball.vertices)).reshape(-1, 3)
    triangles = (np.arange(len(centres))[:, None, None] * len(ball.vertices) + np.array(ball.faces)).reshape(-1, 3)
    groups = frozenset(component.read_numbers("group").astype(int).tolist())
    own = component.read_flag("selfCollision")
    spheres = np.column_stack([centres, radii])
    surface = DraftSurface(component, points, triangles, groups, own, spheres=spheres)
    body.surfaces[f"{node_of(component).getPathName()} {component.getName()}"] = surface
    moves_as_one = not isinstance(body, DraftBody) or body.rigid or len(body.position) == 1
    if len(centres) > 1 or not moves_as_one:
        draft.depart(
            f"{component.getPathName()}: each sphere is a polyhedron of {len(ball.faces)} triangles, which deforms "
            "with a soft body"
        )
