"""Time integration, solvers, masses, joints, supports, forces and springs."""

from dataclasses import replace
from itertools import combinations

import numpy as np

from taichisoft_sofa.components.draft import DraftAnchor, DraftForces, DraftSpring, Mass, SceneDraft
from taichisoft_sofa.components.mappings import weigh_joint
from taichisoft_sofa.components.reading import STATE, inputs_of, linked_state, mapping_of, nearest, node_of, topology_of
from taichisoft_sofa.components.states import (
    FrameMotion,
    FramePoses,
    MotionTarget,
    PointsTarget,
    composed,
    is_rigid,
    local_position,
    rigid_indices,
    start_position,
    start_values,
)
from taichisoft_sofa.components.topologies import all_cells
from taichisoft_sofa.tree.component import Component, component, unused
from taichisoft_sofa.tree.value_kinds import ABOVE_0, BOOLS, FROM_0, INDICES, LINK, ValueKind, canonical, fixed, vectors

HELD = 1e12
"""Stiffness for points fixed by a constraint [mN/mm]."""
SPRING = 100.0
"""SOFA's default stiffness of rest shape springs [mN/mm]."""
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
    chosen = np.unique(component.read_numbers("indices")).astype(np.int64)
    draft.check_points(component, chosen, len(body.position))
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
    if len(each) and (len(each) != len(body.position) or (each != each[0]).any()):
        raise component.refused(f"vertexMass has {len(each)} numbers, not one for all of {len(body.position)} points")
    if len(each):
        draft.weigh(body, Mass(component, each=float(each[0])))
    elif component.is_given("totalMass"):
        draft.weigh(body, Mass(component, total=component.read_number("totalMass"), density=0.0))
    else:
        density = component.read_numbers("massDensity")
        if not len(density) or (density != density[0]).any():
            raise component.refused(f"massDensity has {len(density)} numbers; a body has one density here")
        draft.weigh(body, Mass(component, density=float(density[0])))
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
    points = component.read_numbers("points", "indices").astype(np.int64)
    draft.check_points(component, points, len(body.position))
    stiffness = component.read_numbers("stiffness", default=[SPRING])
    every = np.arange(len(body.position))
    chosen = points if len(points) else every
    if not len(stiffness):
        stiffness = np.array([SPRING])
    # As in SOFA: the first stiffness holds for all points unless there is one per point.
    each = stiffness if len(stiffness) == len(chosen) else np.full(len(chosen), stiffness[0])
    external = _external_points(component, chosen)
    for value in np.unique(each):
        target = None if external is None else replace(external, indices=external.indices[each == value])
        own = DraftAnchor(component, chosen[each == value], float(value), follows_rest=target is None, target=target)
        body.anchors.append(own)
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
        indices = chosen if count > int(chosen.max(initial=-1)) and count != len(chosen) else np.arange(len(chosen))
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
    name = next((name for name in ("totalForce", "forces") if component.is_given(name)), "force")
    values = component.read_numbers(name, default=(0.0,) * width)
    if values.size % width:
        raise component.refused(f"{name} has {values.size} numbers; they are not rows of {width}")
    each = values.reshape(-1, width)
    each = {"totalForce": each[:1] / max(len(points), 1), "forces": each, "force": each[:1]}[name]
    if not len(each):
        raise component.refused("has no force; give force, forces or totalForce")
    # As in SOFA: points beyond the list have its last force.
    forces = each[np.minimum(np.arange(len(points)), len(each) - 1)]
    if forces[:, 3:].any():
        raise component.refused("has a torque on a rigid body; forces alone act on rigid bodies here")
    body.forces.append(DraftForces(component, points, forces[:, :3], places[points] if follows else None))


@component(
    "LinearMovementProjectiveConstraint",
    indices=(INDICES, (0,), FROM_0),
    keyTimes=(),
    movements=_forces,
    relativeMovements=True,
)
def prescribed_motion(component: Component, draft: "SceneDraft") -> None:
    """Translate points and frames that are moved in time from key to key, linearly."""
    body = draft.own_body_of(component, same="")
    points = component.read_numbers("indices").astype(np.int64)
    times, shifts = (
        component.read_numbers("keyTimes"),
        component.read_numbers("movements").reshape(-1, _width(component)),
    )
    draft.check_points(component, points, len(body.position))
    if not len(times) or len(times) != len(shifts) or (np.diff(times) <= 0.0).any():
        raise component.refused(
            f"keyTimes has {len(times)} times, movements {len(shifts)}; there must be one for each, rising"
        )
    start = body.position[points]
    if component.read_flag("relativeMovements") is False:
        if body.rigid:
            raise component.refused("relativeMovements = false of a rigid body; give movements from its start")
        shifts = shifts - start[:1]
    target = FrameMotion(start, times, shifts) if body.rigid else MotionTarget(start, times, shifts)
    body.anchors.append(DraftAnchor(component, points, HELD, follows_rest=False, target=target))


FIXED = {"indices": (INDICES, (0,), FROM_0), "fixAll": False, "fixedDirections": (BOOLS, (True, True, True))}


@component("FixedProjectiveConstraint", **FIXED, activate_projectVelocity=unused(False))
@component("PartialFixedProjectiveConstraint", **FIXED, projectVelocity=unused(False))
def fixed_points(component: Component, draft: "SceneDraft") -> None:
    """Translate points fixed along all or some axes."""
    body = draft.own_body_of(component, same="")
    held = component.read_numbers("fixedDirections").astype(bool)
    if body.rigid and len(held) == 6:
        place, axes = set(held[:3].tolist()), set(held[3:].tolist())
        if len(place) > 1 or len(axes) > 1:
            raise component.refused("holds a rigid body along some axes; its place, its axes or both are held here")
        if place != axes:
            draft.check_points(component, component.read_numbers("indices").astype(np.int64), len(body.position))
            stiffness = HELD * held[[0, 3]]
            own = DraftAnchor(component, np.zeros(1, dtype=np.int64), stiffness[0], True, angular=float(stiffness[1]))
            body.anchors.append(own)
            return
        held = held[:3]
    if len(held) != 3:
        raise component.refused(f"fixedDirections has {len(held)} numbers; three are needed, for x, y and z")
    directions = "".join(np.array(["x", "y", "z"])[held])
    all_points = component.read_flag("fixAll")
    points = component.read_numbers("indices").astype(np.int64)
    chosen = np.arange(len(body.position)) if all_points else points
    draft.check_points(component, chosen, len(body.position))
    if directions:
        body.anchors.append(DraftAnchor(component, chosen, HELD, follows_rest=False, directions=directions))


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
EACH_PUSHES = np.zeros(0, dtype=bool)
MOST = 500
"""Largest number of springs of a scene: each is a row of the constraint solver."""
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
        # As in SOFA: a list that has not one number for each spring has its first, or 0, for all of them.
        lists = (component.read_numbers(*names) for names in (("stiffness",), ("damping",), ("lengths", "length")))
        each = [one if len(one) == len(first) else np.full(len(first), [*one, 0.0][0]) for one in lists]
        rows = np.column_stack([first, second, *each])
    pulls_alone = component.read_numbers("elongationOnly").astype(bool)
    if len(pulls_alone) not in (0, 1, len(rows)):
        raise component.refused(f"elongationOnly has {len(pulls_alone)} values for {len(rows)} springs")
    _add(component, draft, ends, rows[:, :2].astype(np.int64), rows[:, 2], rows[:, 4], pulls_alone)
    _note_damping(component, draft, bool((rows[:, 3] > 0.0).any()))


@component(
    "MeshSpringForceField",
    object1=LINK,
    object2=LINK,
    topology=LINK,
    noCompression=False,
    localRange=unused(()),
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
    pairs, moduli = np.zeros((0, 2), dtype=np.int64), np.zeros(0)
    for name, (kind, corners) in CELLS.items():
        if (modulus := component.read_number(f"{name}Stiffness", "stiffness")) > 0.0:
            cells = all_cells(topology, kind)
            own = np.sort(cells[:, list(combinations(range(corners), 2))].reshape(-1, 2), axis=1)
            pairs, moduli = np.vstack([pairs, own]), np.append(moduli, np.full(len(own), modulus))
    # As in SOFA: the first kind of cell that joins two points gives their stiffness.
    _, first = np.unique(pairs, axis=0, return_index=True)
    first.sort()
    _add(component, draft, ends, pairs[first], moduli[first])
    _note_damping(component, draft, any(component.read_number(f"{name}Damping", "damping") > 0.0 for name in CELLS))


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
    lengths: np.ndarray | None = None,
    pulls_alone: np.ndarray = EACH_PUSHES,
) -> None:
    """Add springs between pairs of points; without lengths they are at rest, and their stiffness is by stretch."""
    for state, points in zip(ends, pairs.T, strict=True):
        draft.check_points(component, points, len(start_position(state)))
    there = stiffness > 0.0
    pushes = np.broadcast_to(~pulls_alone if len(pulls_alone) else True, len(pairs))[there]
    pairs, lengths = pairs[there], None if lengths is None else lengths[there]
    stiffness = stiffness[there]
    if len(draft.springs) + len(pairs) > MOST:
        raise component.refused(f"makes more than {MOST} springs; elements of a mesh are the way to have so many")
    places = [_places(state, points) for state, points in zip(ends, pairs.T, strict=True)]
    distances = np.linalg.norm(places[1] - places[0], axis=1)
    if not distances.all():
        one, other = pairs[np.argmin(distances)]
        raise component.refused(f"joins points {one} and {other} at one place; a spring needs a length here")
    moduli, pulls = (stiffness, 0.0 * distances) if lengths is None else (stiffness * distances, distances - lengths)
    pushes = pushes & (not component.read_flag("noCompression"))
    draft.springs += [
        DraftSpring(component, ends, (one, other), *values)
        for (one, other), *values in zip(pairs.tolist(), moduli.tolist(), pulls.tolist(), pushes.tolist(), strict=True)
    ]


def _places(state: "Component", points: np.ndarray) -> np.ndarray:
    """Places of points at the start [mm], also of those that are given in the axes of a frame, shape (count, 3)."""
    mapping, local = mapping_of(state), local_position(state)[points, :3]
    if mapping is not None and canonical(mapping.type_name) == "RigidMapping":
        frames = FramePoses(start_values).of(inputs_of(mapping)[0])
        return composed(frames[rigid_indices(mapping, len(start_position(state)))[points]], local)
    return local


def _note_damping(component: "Component", draft: "SceneDraft", damped: bool) -> None:
    if damped:
        draft.depart(f"{component.getPathName()}: its springs have no damping of their own here")
