"""Time integration, solvers, masses, joints, supports, forces and springs."""

from dataclasses import replace
from itertools import combinations

import numpy as np

from taichisoft_sofa.components.draft import SPRING, DraftAnchor, DraftForces, DraftSprings, Mass, SceneDraft
from taichisoft_sofa.components.mappings import weigh_joint
from taichisoft_sofa.components.reading import (
    STATE,
    described,
    inputs_of,
    linked_state,
    mapping_of,
    nearest,
    node_of,
    topology_of,
)
from taichisoft_sofa.components.states import (
    FrameMotion,
    FramePoses,
    MotionTarget,
    PointsTarget,
    composed,
    is_rigid,
    local_position,
    rest_position,
    rigid_indices,
    start_position,
    start_values,
)
from taichisoft_sofa.components.topologies import all_cells
from taichisoft_sofa.tree.component import Component, component, unused
from taichisoft_sofa.tree.value_kinds import ABOVE_0, BOOLS, FROM_0, INDICES, LINK, ValueKind, canonical, fixed, vectors

HELD = 1e12
"""Stiffness for points fixed by a constraint [mN/mm]."""
ENGINES = {"BoxROI", "SphereROI"}


@component("FreeMotionAnimationLoop", solveVelocityConstraintFirst=unused(False))
@component("DefaultAnimationLoop")
def animation_loop(component: Component, draft: "SceneDraft") -> None:
    """Translate the animation loop: FreeMotionAnimationLoop solves constraints, the default loop does not."""
    draft.free_motion = component.type_name.startswith("FreeMotion")


@component(
    "EulerImplicitSolver",
    rayleighStiffness=(0.0, FROM_0),
    rayleighMass=(0.0, FROM_0),
    firstOrder=False,
    trapezoidalScheme=False,
    vdamping=unused(0.0),
    solveConstraint=unused(False),
)
@component("StaticSolver")
def time_integration(component: Component, draft: "SceneDraft") -> None:
    """Translate implicit Euler with Rayleigh damping, or equilibrium, for the bodies in its node and below."""
    if id(node_of(component)) in draft.solvers:
        raise component.refused("is a second time integration in its node, where SOFA makes the step of each")
    draft.solvers[id(node_of(component))] = component
    if component.read_flag("trapezoidalScheme"):
        draft.refuse(component, "trapezoidalScheme; only the implicit Euler method is there")


@component(
    *("SparseLDLSolver", "AsyncSparseLDLSolver", "SparseCholeskySolver", "SparseLUSolver", "EigenSimplicialLDLT"),
    *("EigenSimplicialLLT", "EigenSparseLU", "EigenSparseQR", "BTDLinearSolver", "PrecomputedLinearSolver"),
    *("CGLinearSolver2", "ParallelCGLinearSolver", "MinResLinearSolver", "PCGLinearSolver", "ShewchukPCGLinearSolver"),
    "CholeskySolver",
)
@component("CGLinearSolver", threshold=(1e-5, FROM_0))
def linear_solver(component: Component, draft: "SceneDraft") -> None:
    """Accept any linear solver: the system is solved directly."""
    draft.linear_solvers[id(node_of(component))] = component


@component(
    *("LinearSolverConstraintCorrection", "GenericConstraintCorrection", "PrecomputedConstraintCorrection"),
    regularizationTerm=unused(0.0),
)
@component(
    "UncoupledConstraintCorrection",
    regularizationTerm=unused(0.0),
    compliance=unused(()),
    defaultCompliance=unused(1e-5),
)
def constraint_correction(component: Component, draft: "SceneDraft") -> None:
    """Translate a constraint correction: contacts and actuators act on bodies with one."""
    draft.corrections[id(node_of(component))] = component


@component(
    "UniformMass",
    totalMass=(1.0, FROM_0),
    vertexMass=(),
    mass=(),
    filename="",
    indices=(INDICES, (), FROM_0),
    localRange=INDICES,
    rayleighMass=unused(0.0),
)
def uniform_mass(component: Component, draft: "SceneDraft") -> None:
    """Translate equal masses of all points, mass and inertia of a rigid body, or inertia of a joint."""
    if (joint := draft.joint_of(component)) is not None:
        weigh_joint(component, joint)
        return
    body = draft.own_body_of(component)
    if component.read_text("filename"):
        raise component.refused(f"filename '{component.read_text('filename')}' is not read; give vertexMass")
    chosen = np.unique(draft.points_in(component, body, "indices"))
    if (len(chosen) and len(chosen) < len(body.position)) or (component.read_numbers("localRange") >= 0).any():
        raise component.refused("gives some of the points a mass; all points of a body have the same here")
    total = component.read_number("totalMass")
    each = component.read_numbers("vertexMass", "mass")
    if component.is_given("totalMass") and total == 0.0 and not len(each):
        raise component.refused("totalMass = 0; a body needs a mass above 0")
    total_counts = component.is_given("totalMass") and total > 0.0
    if len(each) and (each[0] < 0.0 or (each[0] == 0.0 and not total_counts)):
        raise component.refused(f"vertexMass = {each[0]:g} must be above 0")
    inertia = _inertia(each)
    if len(each) > 1 and inertia is None:
        raise component.refused(f"vertexMass has {len(each)} numbers; mass, volume and nine of the inertia are known")
    if not len(each) and not component.is_given("totalMass"):
        draft.depart(f"{described(component)}: has no totalMass; here 1 kg, as in SOFA before v23.12, and none since")
    given = {"each": float(each[0])} if len(each) and not total_counts else {"total": total}
    draft.weigh(body, Mass(component, inertia=inertia, **given))


BY_VOLUME = {
    "totalMass": (1.0, ABOVE_0),
    **dict.fromkeys(("vertexMass", "mass"), ((), ABOVE_0)),
    "filename": "",
    "massDensity": ((1.0,), ABOVE_0),
    "rayleighMass": unused(0.0),
}


@component("MeshMatrixMass", **BY_VOLUME, lumping=False, edgeMass=unused(()))
@component("DiagonalMass", **BY_VOLUME)
def mass_by_volume(component: Component, draft: "SceneDraft") -> None:
    """Translate a mass by volume, which each element distributes to its corners, or one mass for all points."""
    body = draft.own_body_of(component)
    each = component.read_numbers("vertexMass", "mass")
    if component.read_text("filename"):
        raise component.refused(
            f"filename '{component.read_text('filename')}' is not read; give totalMass or massDensity"
        )
    # As in SOFA: the total counts before the density, the density before masses of points, and 1 kg without any.
    if not component.is_given("totalMass") and component.is_given("massDensity"):
        density = component.read_numbers("massDensity")
        if not len(density) or (density != density[0]).any():
            raise component.refused(f"massDensity has {len(density)} numbers; a body has one density here")
        draft.weigh(body, Mass(component, density=float(density[0])))
    elif not component.is_given("totalMass") and len(each):
        if component.type_name == "MeshMatrixMass" and not component.read_flag("lumping"):
            raise component.refused("vertexMass without lumping is an error in SOFA; set lumping, or give totalMass")
        if len(each) != len(body.position) or (each != each[0]).any():
            raise component.refused(
                f"vertexMass has {len(each)} numbers, not one for all of {len(body.position)} points"
            )
        draft.weigh(body, Mass(component, each=float(each[0])))
    else:
        draft.weigh(body, Mass(component, total=component.read_number("totalMass"), density=0.0))
    if component.type_name == "MeshMatrixMass" and not component.read_flag("lumping"):
        draft.depart(
            f"{node_of(component).getPathName()}: MeshMatrixMass couples neighbours; here each point has its share"
        )


def _inertia(values: np.ndarray) -> np.ndarray | None:
    """Inertia over mass [mm^2] in "mass volume inertia", with nine or six numbers, or None."""
    if len(values) in (11, 12):
        return values[2:11].reshape(3, 3)
    if len(values) == 10:
        return values[1:].reshape(3, 3)
    if len(values) in (7, 8):
        xx, xy, xz, yy, yz, zz = values[-6:]
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return None


@component(
    "RestShapeSpringsForceField",
    points=(INDICES, (), FROM_0),
    indices=(INDICES, (), FROM_0),
    stiffness=((), FROM_0),
    angularStiffness=((), FROM_0),
    external_rest_shape=LINK,
    **dict.fromkeys(("external_points", "external_indices"), (INDICES, (), FROM_0)),
    pivotPoints=unused(()),
    rayleighStiffness=unused(0.0),
    isCompliance=unused(False),
    activeDirections=unused(()),
)
def rest_shape_springs(component: Component, draft: "SceneDraft") -> None:
    """Translate springs from points, or all of them, to rest positions or others; those of a joint hold its angle."""
    if (joint := draft.joint_of(component)) is not None:
        if joint.springs is not None:
            raise component.refused("holds angles that other springs hold already")
        joint.springs = component
        return
    body = draft.own_body_of(component)
    points = draft.points_in(component, body, "points", "indices")
    stiffness = component.read_numbers("stiffness", default=[SPRING])
    every = np.arange(len(body.position))
    chosen = points if len(points) else every
    if not len(stiffness):
        stiffness = np.array([SPRING])
    # As in SOFA: the first stiffness holds for all points unless there is one per point.
    turning = component.read_numbers("angularStiffness")[: len(stiffness)]
    turning = np.pad(turning, (0, len(stiffness) - len(turning)), constant_values=SPRING)
    each = np.column_stack([stiffness, turning if body.rigid else 0.0 * turning])
    each = each if len(each) == len(chosen) else np.tile(each[0], (len(chosen), 1))
    external, rest = _external_points(component, chosen), rest_position(body.state)
    if external is None and not body.state.is_given("rest_position") and (rest != body.position).any():
        body.state.set_all({"rest_position": rest})  # the springs pull from the first step on
    for kind in np.unique(each, axis=0):
        alike = (each == kind).all(axis=1)
        target = None if external is None else replace(external, indices=external.indices[alike])
        value, angular = kind.tolist()
        body.anchors.append(
            DraftAnchor(component, chosen[alike], value, target is None, target=target, angular=angular)
        )
    _note_selection(component, "points", draft)


def _external_points(component: Component, chosen: np.ndarray) -> PointsTarget | None:
    """Points of another mechanical object to which springs lead, or None."""
    if not component.read_text("external_rest_shape"):
        return None
    ((path, target), *_) = component.linked_all("external_rest_shape") or [("", None)]
    state = linked_state(component, path, target)
    count = len(start_position(state))
    indices = component.read_numbers("external_points", "external_indices").astype(np.int64)
    if not len(indices):
        indices = np.arange(count)  # as in SOFA, which has no springs if these are more or fewer
    if len(indices) != len(chosen) or (len(indices) and indices.max() >= count):
        raise component.refused(
            f"external_points has {len(indices)} points, of {count} in {state.getPathName()}; {len(chosen)} are needed",
        )
    return PointsTarget(state, indices)


def _forces(component: Component) -> ValueKind:
    """Forces on points, or with torques on frames."""
    return vectors(_width(component))


def _force(component: Component) -> ValueKind:
    """A force on a point, or with a torque on a frame."""
    return fixed(_width(component))


def _width(component: Component) -> int:
    state = nearest(node_of(component), {STATE}) if component.getContext() is not None else None
    rigid = component.read_text("template").removeprefix("Cuda").startswith("Rigid") or (
        state is not None and is_rigid(state)
    )
    return 6 if rigid else 3


@component(
    "ConstantForceField",
    indices=(INDICES, (), FROM_0),
    points=(INDICES, (), FROM_0),
    force=_forces,
    forces=_forces,
    totalForce=_force,
    indexFromEnd=False,
)
def constant_forces(component: Component, draft: "SceneDraft") -> None:
    """Translate constant forces on points: one for each, the same for all, or shares of `totalForce`."""
    mapping = draft.mapping_above(component)
    follows = mapping is not None and canonical(mapping.type_name) == "BarycentricMapping"
    body = draft.body_of(component) if follows else draft.own_body_of(component)
    width = 6 if body.rigid else 3
    places = draft.points_of(component) if follows else body.position
    points = component.read_numbers("indices", "points").astype(np.int64)
    points = points if len(points) else np.arange(len(places))
    if component.read_flag("indexFromEnd"):
        points = len(places) - 1 - points
    draft.check_points(component, points, len(places))
    name = next((name for name in ("forces", "force", "totalForce") if component.is_given(name)), "force")
    values = component.read_numbers(name, default=(0.0,) * width)
    if values.size % width:
        raise component.refused(f"{name} has {values.size} numbers; they are not rows of {width}")
    each = values.reshape(-1, width)
    each = {"totalForce": each[:1] / max(len(points), 1), "forces": each, "force": each[:1]}[name]
    if not len(each):
        raise component.refused("has no force; give force, forces or totalForce")
    if name == "forces" and len(each) != len(points):  # as in older versions
        draft.depart(
            f"{described(component)}: has {len(each)} forces for {len(points)} points, of which the last holds for the "
            "rest; later versions of SOFA report an error"
        )
    forces = each[np.minimum(np.arange(len(points)), len(each) - 1)]
    if forces[:, 3:].any():
        raise component.refused("has a torque on a rigid body; forces alone act on rigid bodies here")
    body.forces.append(DraftForces(component, points, forces[:, :3], places[points] if follows else None))


MOVEMENT = {"indices": (INDICES, (0,), FROM_0), "keyTimes": (), "movements": _forces}


@component("LinearMovementProjectiveConstraint", **MOVEMENT, relativeMovements=True)
@component("PartialLinearMovementProjectiveConstraint", **MOVEMENT, movedDirections=(BOOLS, (True, True, True)))
def prescribed_motion(component: Component, draft: "SceneDraft") -> None:
    """Translate points that are moved along all or some axes, and frames, in time from key to key, linearly."""
    body = draft.own_body_of(component, same="")
    points = draft.points_in(component, body, "indices")
    times, shifts = (
        component.read_numbers("keyTimes"),
        component.read_numbers("movements").reshape(-1, _width(component)),
    )
    if not len(times) or len(times) != len(shifts) or (np.diff(times) <= 0.0).any():
        raise component.refused(
            f"keyTimes has {len(times)} times, movements {len(shifts)}; there must be one for each, rising"
        )
    start = body.position[points]
    axes = component.read_numbers("movedDirections", default=(True, True, True))
    if body.rigid and not axes.all():
        raise component.refused("moves a rigid body along some axes; all are moved here")
    if component.is_given("relativeMovements") and not component.read_flag("relativeMovements"):
        if body.rigid:
            raise component.refused("relativeMovements = false of a rigid body; give movements from its start")
        start = np.zeros_like(start)  # as in SOFA: all points go to one place, or one coordinate
    if body.rigid and len(body.position) > 1:
        raise component.refused(f"moves one of {len(body.position)} frames; give it a MechanicalObject with one")
    target = FrameMotion(start, times, shifts) if body.rigid else MotionTarget(start, times, shifts)
    if directions := "xyz" if body.rigid else axes_of(component, "movedDirections", axes):
        body.anchors.append(DraftAnchor(component, points, HELD, False, directions, target))


FIXED = {"indices": (INDICES, (0,), FROM_0), "fixAll": False, "fixedDirections": (BOOLS, (True, True, True))}


@component("FixedProjectiveConstraint", **FIXED, activate_projectVelocity=unused(False))
@component("PartialFixedProjectiveConstraint", **FIXED, projectVelocity=unused(False))
def fixed_points(component: Component, draft: "SceneDraft") -> None:
    """Translate points fixed along all or some axes."""
    body = draft.own_body_of(component, same="")
    held, points = component.read_numbers("fixedDirections").astype(bool), draft.points_in(component, body, "indices")
    if body.rigid and len(held) == 6:
        place, axes = set(held[:3].tolist()), set(held[3:].tolist())
        if len(place) > 1 or len(axes) > 1:
            raise component.refused("holds a rigid body along some axes; its place, its axes or both are held here")
        if place != axes:
            stiffness = HELD * held[[0, 3]]
            body.anchors.append(DraftAnchor(component, points, stiffness[0], True, angular=float(stiffness[1])))
            return
        held = held[:3]
    directions = axes_of(component, "fixedDirections", held)
    chosen = np.arange(len(body.position)) if component.read_flag("fixAll") else points
    if directions:
        body.anchors.append(DraftAnchor(component, chosen, HELD, follows_rest=False, directions=directions))


def axes_of(component: "Component", name: str, held: np.ndarray) -> str:
    """The axes along which a component with these three flags acts on points."""
    if len(held) != 3:
        raise component.refused(f"{name} has {len(held)} numbers; three are needed, for x, y and z")
    return "".join(np.array(["x", "y", "z"])[held.astype(bool)])


def _note_selection(component: "Component", name: str, draft: "SceneDraft") -> None:
    """Record that SOFA repeats a selection whenever rest positions change, and may then hold other points."""
    data = component.findData(name)
    parent = data.getParent() if data is not None else None
    source = parent.owner if parent is not None else None
    if isinstance(source, Component) and canonical(source.type_name) in ENGINES and source.read_flag("doUpdate"):
        draft.depart(
            f"{source.getPathName()}: selects its points once, at the start; SOFA repeats this whenever rest positions "
            "change (doUpdate)"
        )


# Springs between two points, of one mechanical object or of two.

STIFFNESS, DAMPING = 100.0, 5.0
"""SOFA's defaults of springs that are given one by one [mN/mm] and [mN s/mm]."""
MOST = 500
"""Largest number of springs between bodies: each is a row of the constraint solver."""
CELLS = {"lines": ("edges", 2), "triangles": ("triangles", 3), "quads": ("quads", 4)}
CELLS |= {"tetrahedra": ("tetrahedra", 4), "tetras": ("tetrahedra", 4), "cubes": ("hexahedra", 8)}
"""Kinds of cells whose corners springs of a mesh join, with their number of corners."""


@component(
    "StiffSpringForceField",
    "SpringForceField",
    object1=LINK,
    object2=LINK,
    spring=(),
    springs=(),
    indices1=(INDICES, (), FROM_0),
    indices2=(INDICES, (), FROM_0),
    lengths=((), FROM_0),
    length=((), FROM_0),
    stiffness=((STIFFNESS,), FROM_0),
    damping=((DAMPING,), FROM_0),
    noCompression=False,
    elongationOnly=BOOLS,
    enabled=(BOOLS, (True,)),
    rayleighStiffness=unused(0.0),
)
def single_springs(component: "Component", draft: "SceneDraft") -> None:
    """Translate springs that are listed: by `spring`, rows of two indices, stiffness, damping and length at rest, or by
    `indices1` and `indices2`."""
    ends = _ends(component)
    rows = component.read_numbers("spring", "springs")
    if rows.size % 5:
        raise component.refused(f"spring has {rows.size} numbers; they are not rows of five")
    rows = rows.reshape(-1, 5)
    if not len(rows):
        first, second = (component.read_numbers(f"indices{end}").astype(np.int64) for end in (1, 2))
        if len(first) != len(second):
            raise component.refused(f"indices1 has {len(first)} points, indices2 {len(second)}")
        # As in SOFA: springs beyond a list have its last number, or 0.
        lists = (component.read_numbers(*names) for names in (("stiffness",), ("damping",), ("lengths", "length")))
        numbers = np.arange(len(first))
        each = [one[np.minimum(numbers, len(one) - 1)] if len(one) else np.zeros(len(first)) for one in lists]
        rows = np.column_stack([first, second, *each])
    pushes: np.ndarray | bool = True
    if len(component.read_numbers("elongationOnly")):
        pushes = component.read_each("elongationOnly", len(rows), "springs") == 0.0
    rows[component.read_each("enabled", len(rows), "springs") == 0.0, 2:4] = 0.0
    pairs, (stiffness, damping, lengths) = rows[:, :2].astype(np.int64), rows[:, 2:].T
    _add(component, draft, ends, pairs, stiffness, damping, lengths, pushes)


@component(
    "MeshSpringForceField",
    object1=LINK,
    object2=LINK,
    topology=LINK,
    noCompression=False,
    localRange=unused(()),
    rayleighStiffness=unused(0.0),
    **{f"{cells}{what}": (0.0, FROM_0) for cells in CELLS for what in ("Stiffness", "Damping")},
    stiffness=(0.0, FROM_0),
    damping=(0.0, FROM_0),
)
def mesh_springs(component: "Component", draft: "SceneDraft") -> None:
    """Translate springs along edges and across cells of a topology; their stiffness is by relative stretch."""
    ends = _ends(component)
    topology = topology_of(component)
    if ends[0] is not ends[1]:
        raise component.refused("has springs between two mechanical objects, where SOFA makes none")
    if topology is None:
        raise component.refused("finds no topology in its node or above")
    pairs, moduli = np.zeros((0, 2), dtype=np.int64), np.zeros((0, 2))
    for name, (kind, corners) in CELLS.items():
        given = [component.read_number(f"{name}{what}", what.lower()) for what in ("Stiffness", "Damping")]
        if any(given):
            cells = all_cells(topology, kind)
            own = np.sort(cells[:, list(combinations(range(corners), 2))].reshape(-1, 2), axis=1)
            pairs, moduli = np.vstack([pairs, own]), np.vstack([moduli, np.tile(given, (len(own), 1))])
    # As in SOFA: the first kind of cell that joins two points gives their stiffness.
    _, first = np.unique(pairs, axis=0, return_index=True)
    first.sort()
    _add(component, draft, ends, pairs[first], *moduli[first].T)


def _ends(component: "Component") -> "tuple[Component, Component]":
    """The mechanical objects of the first and the second points: linked ones, else the one of the node."""
    own, found = nearest(node_of(component), {STATE}), []
    for name in ("object1", "object2"):
        links = component.linked_all(name) if component.is_given(name) else []
        state = linked_state(component, *links[0]) if links else own
        if state is None:
            raise component.refused("finds no MechanicalObject in its node or above")
        found.append(state)
    return found[0], found[1]


def _add(
    component: "Component",
    draft: "SceneDraft",
    ends: "tuple[Component, Component]",
    pairs: np.ndarray,
    stiffness: np.ndarray,
    damping: np.ndarray,
    lengths: np.ndarray | None = None,
    pushes: np.ndarray | bool = True,
) -> None:
    """Add springs between pairs of points; without lengths they are at rest, with stiffness and damping by stretch."""
    for state, points in zip(ends, pairs.T, strict=True):
        draft.check_points(component, points, len(start_position(state)))
    places = [_places(state, points) for state, points in zip(ends, pairs.T, strict=True)]
    distances = np.linalg.norm(places[1] - places[0], axis=1)
    is_inside = ends[0] is ends[1] and mapping_of(ends[0]) is None and not is_rigid(ends[0])
    needs_length = (
        (pairs[:, 0] == pairs[:, 1]) if is_inside and lengths is not None else np.ones(len(pairs), dtype=bool)
    )
    there = (stiffness > 0.0) | (is_inside & (damping > 0.0))
    if len(at_one_place := np.flatnonzero(there & needs_length & (distances == 0.0))):
        one, other = pairs[at_one_place[0]]
        raise component.refused(f"joins points {one} and {other} at one place; a spring needs a length here")
    if lengths is None:
        lengths, stiffness, damping = distances, stiffness / distances, damping / distances
    pushes = np.broadcast_to(pushes & (not component.read_flag("noCompression")), len(pairs))
    columns = (one[there] for one in (pairs, distances, stiffness, damping, lengths, pushes))
    draft.springs.append(DraftSprings(component, ends, is_inside, *columns))
    if not is_inside and sum(len(one.pairs) for one in draft.springs if not one.is_inside) > MOST:
        raise component.refused(f"makes more than {MOST} springs between bodies; within one any number is possible")
    if damping[there].any():
        inside = "its damping takes the velocities at the end of a step; in SOFA those at its start"
        draft.depart(
            f"{component.getPathName()}: {inside if is_inside else 'its springs have no damping of their own here'}"
        )


def _places(state: "Component", points: np.ndarray) -> np.ndarray:
    """Where points of a mechanical object are at the start [mm]."""
    mapping, local = mapping_of(state), local_position(state)[points, :3]
    if mapping is not None and canonical(mapping.type_name) == "RigidMapping" and inputs_of(mapping):
        frames = FramePoses(start_values).of(inputs_of(mapping)[0])
        return composed(frames[rigid_indices(mapping, len(start_position(state)))[points]], local)
    return local
