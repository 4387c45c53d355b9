"""Draft of a scene: data of its components by body, gathered before a native scene is made."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from taichisoft.errors import SceneError
from taichisoft_sofa.components.reading import (
    STATE,
    described,
    independent_state,
    inputs_of,
    is_assembled,
    mapping_of,
    nearest,
    node_of,
    present_value,
    upwards,
)
from taichisoft_sofa.components.states import (
    frame_carrying,
    is_rigid,
    local_position,
    start_position,
    start_values,
    width_of,
)
from taichisoft_sofa.tree.value_kinds import canonical

if TYPE_CHECKING:
    from taichisoft_sofa.components.states import AnchorTarget, FrameMotion
    from taichisoft_sofa.tree.component import Component
    from taichisoft_sofa.tree.node import Node


@dataclass(frozen=True)
class DraftMaterial:
    """A force field of tetrahedra; force fields on the same tetrahedra add up.

    Attributes:
        component: the force field.
        tetrahedra: point indices, shape (count, 4).
        young_modulus: Young's moduli [kPa], shape (count,).
        poisson_ratio: Poisson's ratios [-], shape (count,).
        corotation: the native key.
        law: the native law of elasticity.
        coefficients: of a law that takes more than Young's modulus.
        element: the native kind of element.
    """

    component: "Component"
    tetrahedra: np.ndarray
    young_modulus: np.ndarray
    poisson_ratio: np.ndarray
    corotation: str
    law: str = "hooke"
    coefficients: Mapping[str, float] = field(default_factory=dict)
    element: str = "linear"


@dataclass(frozen=True)
class Mass:
    """The mass of a body.

    Attributes:
        component: the mass component.
        total: mass of the body [kg]; None if given by point or by volume.
        each: mass of each point [kg].
        density: mass by volume [kg/mm^3].
        inertia: inertia of a rigid body over mass [mm^2], shape (3, 3), or None.
    """

    component: "Component"
    total: float | None = None
    each: float | None = None
    density: float | None = None
    inertia: np.ndarray | None = None


@dataclass(frozen=True)
class DraftAnchor:
    """Points held in place.

    Attributes:
        component: the springs or the constraint.
        points: indices of the points, shape (count,).
        stiffness: stiffness per point [mN/mm].
        follows_rest: whether the points follow `rest_position`, else their target or initial positions.
        directions: axes along which they are held.
        target: what the points follow, or None.
        angular: stiffness that holds the axes of a rigid body [mN mm].
    """

    component: "Component"
    points: np.ndarray
    stiffness: float
    follows_rest: bool
    directions: str = "xyz"
    target: "AnchorTarget | FrameMotion | None" = None
    angular: float = 0.0

    @property
    def axes(self) -> np.ndarray:
        """Numbers of the axes along which they are held, shape (axis_count,)."""
        return np.flatnonzero([axis in self.directions for axis in "xyz"])


@dataclass(frozen=True)
class DraftForces:
    """Constant forces on points, or on places that follow the tetrahedra.

    Attributes:
        component: the force field.
        points: indices of points, shape (count,).
        forces: force on each [mN], shape (count, 3).
        places: where points are that follow the body [mm], shape (count, 3); None for points of its own.
    """

    component: "Component"
    points: np.ndarray
    forces: np.ndarray
    places: np.ndarray | None = None


@dataclass
class DraftSurface:
    """Collision models of one node.

    Attributes:
        component: the first of them.
        points: positions at the start, of rigid bodies in their own frame [mm], shape (count, 3).
        triangles: point indices, shape (count, 3).
        groups: collision groups.
        self_collision: whether the surface may touch itself.
        is_carried: whether it is that of a rigid part.
        spheres: centres and radii of the spheres that the triangles stand for [mm], shape (count, 4).
    """

    component: "Component"
    points: np.ndarray
    triangles: np.ndarray
    groups: frozenset[int]
    self_collision: bool
    is_carried: bool = False
    spheres: np.ndarray = field(default_factory=lambda: np.zeros((0, 4)))

    def on(self, points: np.ndarray) -> "DraftSurface":
        """What is of it on some of its points, a mask of shape (count,); triangles with others are left out."""
        spheres = self.spheres[points.reshape(len(self.spheres), -1).all(axis=1)] if len(self.spheres) else self.spheres
        number = np.cumsum(points) - 1
        triangles = number[self.triangles[points[self.triangles].all(axis=1)]]
        return replace(self, points=self.points[points], triangles=triangles, spheres=spheres)


@dataclass(frozen=True)
class DraftCavity:
    """An air chamber: its constraint and its walls, points of shape (count, 3) [mm], triangles of shape (count, 3)."""

    component: "Component"
    points: np.ndarray
    triangles: np.ndarray


@dataclass(frozen=True)
class DraftCable:
    """A cable: its constraint, and the points and areas through which it runs from the pull point on, as native scenes
    list them."""

    component: "Component"
    places: list[Any]


@dataclass(frozen=True)
class DraftSprings:
    """Springs of one force field.

    Attributes:
        component: the force field.
        ends: mechanical objects of the first and the second points.
        is_inside: whether all join points of one soft body.
        pairs: indices of the points, shape (count, 2).
        distances: between the points at the start [mm], shape (count,).
        stiffness: [mN/mm], shape (count,).
        damping: [mN s/mm], shape (count,).
        lengths: at rest [mm], shape (count,).
        pushes: whether each resists compression, too, shape (count,).
    """

    component: "Component"
    ends: "tuple[Component, Component]"
    is_inside: bool
    pairs: np.ndarray
    distances: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray
    lengths: np.ndarray
    pushes: np.ndarray


SPRING = 100.0
"""SOFA's default stiffness of rest shape springs [mN/mm]."""


@dataclass
class DraftJoint:
    """The angles of a mechanical object of Vec1, which turn frames.

    Attributes:
        state: the mechanical object.
        springs: the springs that hold the angles to `rest_position`.
        moved: constraints that impose angles, by the index of these.
        mass: inertia of each angle [kg mm^2].
        is_used: whether a mapping turns frames by the angles.
        solver: time integration; None if the angles stand still.
    """

    state: "Component"
    springs: "Component | None" = None
    moved: dict[int, "Component"] = field(default_factory=dict)
    mass: float = 0.0
    is_used: bool = False
    solver: "Component | None" = None

    def stiffness(self) -> np.ndarray:
        """Present stiffness of the springs of each angle [mN mm], infinite of imposed ones, shape (count,)."""
        stiffness = np.zeros(len(start_values(self.state)))
        if self.springs is not None:
            given = self.springs.read_numbers("stiffness")
            given = given if len(given) else np.array([SPRING])
            points = self.springs.read_numbers("points", "indices").astype(np.int64)
            chosen = points if len(points) else np.arange(len(stiffness))
            if len(chosen) and (chosen.min() < 0 or chosen.max() >= len(stiffness)):
                raise self.springs.refused(f"names an angle outside 0..{len(stiffness) - 1}")
            stiffness[chosen] = given if len(given) == len(chosen) else given[0]
        stiffness[list(self.moved)] = np.inf
        if (stiffness <= 0.0).any():
            raise (self.springs or self.state).refused("stiffness = 0: an angle that nothing holds is not known here")
        return stiffness

    def rest(self) -> np.ndarray:
        """Present angles at rest [rad], shape (count,)."""
        data, start = self.state.findData("rest_position"), start_values(self.state).ravel()
        # Not the computed value, which does not follow a link to a data that the scene changes.
        rest = start if data is None or not data.is_set() else np.ravel(data.given())
        if len(rest) != len(start):
            raise self.state.refused(f"rest_position has {len(rest)} angles; {len(start)} are needed")
        imposed = {index: start[index] + present_value(component) for index, component in self.moved.items()}
        return np.array([imposed.get(index, angle) for index, angle in enumerate(rest)])


@dataclass
class DraftFrame:
    """A frame that follows others, with what it carries.

    Attributes:
        state: mechanical object of the frame.
        index: index of the frame in it.
        surfaces: collision surfaces by the path of their node, in the axes of the frame.
        colours: colours of its visual models.
        shapes: points in the axes of the frame [mm] and triangles of its visual models.
    """

    state: "Component"
    index: int
    surfaces: dict[str, DraftSurface] = field(default_factory=dict)
    colours: list[str] = field(default_factory=list)
    shapes: list[tuple[np.ndarray, np.ndarray]] = field(default_factory=list)


@dataclass
class DraftBody:
    """All data of one independent mechanical object.

    Attributes:
        state: the mechanical object.
        position: initial points [mm] or poses, shape (count, 3) or (count, 7).
        index: of the frame of a rigid body among those of the mechanical object.
        surfaces: collision surfaces by the path of their node.
        colours: colours of its visual models, "#rrggbb".
        shapes: points [mm] and triangles of the visual models of a rigid body, in its axes.
    """

    state: "Component"
    position: np.ndarray
    index: int = 0
    mass: Mass | None = None
    materials: list[DraftMaterial] = field(default_factory=list)
    anchors: list[DraftAnchor] = field(default_factory=list)
    forces: list[DraftForces] = field(default_factory=list)
    surfaces: dict[str, DraftSurface] = field(default_factory=dict)
    cavities: list[DraftCavity] = field(default_factory=list)
    cables: list[DraftCable] = field(default_factory=list)
    colours: list[str] = field(default_factory=list)
    shapes: list[tuple[np.ndarray, np.ndarray]] = field(default_factory=list)

    @property
    def node(self) -> "Node":
        """The node of the mechanical object."""
        return node_of(self.state)

    @property
    def rigid(self) -> bool:
        """Whether the points are frames of rigid bodies."""
        return is_rigid(self.state)


@dataclass(frozen=True)
class DraftPlane:
    """A plane that pushes a body: its component, the body, its unit normal, and its distance from the origin [mm]."""

    component: "Component"
    body: DraftBody
    normal: np.ndarray
    offset: float


@dataclass
class SceneDraft:
    """Data gathered from the components of a scene, in the order of the tree.

    Attributes:
        exact: whether to follow SOFA exactly where the default departs from it.
        effort_of_value: pressure [kPa] or tension [mN] by the value that SOFA calls so: an impulse, or in overdamped
            the same.
        bodies: one body per independent mechanical object, by the identity of the component.
        frames: frames that follow others, by the identity of their mechanical object and their index.
        joints: angles by the identity of their mechanical object.
        springs: springs between points.
        planes: planes that push bodies.
        solvers: time integration by node.
        linear_solvers: linear solvers by node.
        corrections: constraint corrections by node.
        pipeline: components of the contact pipeline, by role.
        sprung: frames that follow `rest_position`.
        own_groups: number of collision groups that the translation adds to those of the scene.
        visuals: visual models.
        inverse: components of the inverse solver.
        free_motion: whether the animation loop solves constraints.
        appearance: entries of the native table `appearance`.
        departures: differences from SOFA, one line each.
        refused: components or values that cannot be translated, one line each.
    """

    exact: bool = False
    effort_of_value: float = 1.0
    bodies: dict[int, DraftBody] = field(default_factory=dict)
    frames: dict[tuple[int, int], DraftFrame] = field(default_factory=dict)
    joints: dict[int, DraftJoint] = field(default_factory=dict)
    planes: list[DraftPlane] = field(default_factory=list)
    springs: list[DraftSprings] = field(default_factory=list)
    solvers: dict[int, "Component"] = field(default_factory=dict)
    linear_solvers: dict[int, "Component"] = field(default_factory=dict)
    corrections: dict[int, "Component"] = field(default_factory=dict)
    pipeline: dict[str, "Component"] = field(default_factory=dict)
    sprung: dict["Component", None] = field(default_factory=dict)
    own_groups: int = 0
    visuals: list["Component"] = field(default_factory=list)
    inverse: list["Component"] = field(default_factory=list)
    free_motion: bool = False
    appearance: dict[str, Any] = field(default_factory=dict)
    departures: dict[str, None] = field(default_factory=dict)
    refused: list[str] = field(default_factory=list)

    @contextmanager
    def refusing(self) -> Iterator[None]:
        """Record an error inside as a refusal."""
        try:
            yield
        except SceneError as error:
            self.refused.append(str(error))

    def refuse(self, component: "Component", why: str) -> None:
        """Record that a component cannot be translated, and why."""
        self.refused.append(f"{described(component)}: {why}")

    def depart(self, line: str) -> None:
        """Record a difference from SOFA, once."""
        self.departures[line] = None

    def body_of(self, component: "Component") -> DraftBody:
        """The body on which a component acts; without one, a SceneError refuses the component."""
        state = independent_state(node_of(component))
        if state is None:
            raise component.refused("acts on nothing: there is no MechanicalObject in its node or above")
        path = state.getPathName()
        if width_of(state) == 1:
            raise component.refused(f"acts on {path}, whose template is Vec1; bodies here have points or frames")
        if is_assembled(state) and is_rigid(state):
            raise component.refused(f"acts on {path}, which joints drive; only soft bodies follow it here")
        if id(state) not in self.bodies:
            self.bodies[id(state)] = DraftBody(state, start_position(state))
        return self.bodies[id(state)]

    def own_body_of(self, component: "Component", same: str = "IdentityMapping") -> DraftBody:
        """As `body_of`, of a component that acts on points by their numbers: on points that follow it is refused, but
        for those that follow by a mapping to the `same` points."""
        mapping = self.mapping_above(component)
        if mapping is not None and canonical(mapping.type_name) != same:
            raise component.refused(
                f"acts on points that follow others by {mapping.type_name}; only surfaces, cavities, cables and, by "
                "BarycentricMapping, constant forces do so here",
            )
        return self.body_of(component)

    def mapping_above(self, component: "Component") -> "Component | None":
        """The mapping that moves the points on which a component acts by their numbers, or None; of several one after
        another the first that is no IdentityMapping."""
        state, mapping = nearest(node_of(component), {STATE}), None
        while state is not None and not is_assembled(state) and (above := mapping_of(state)) is not None:
            mapping = above
            if canonical(mapping.type_name) != "IdentityMapping":
                return mapping
            state = next(iter(inputs_of(mapping)), None)
        return mapping

    def weigh(self, body: DraftBody, mass: Mass) -> None:
        """Give a body its mass; a second one is refused."""
        if body.mass is not None:
            raise mass.component.refused(f"is a second mass of its body, beside {described(body.mass.component)}")
        body.mass = mass

    def carrier_of(self, component: "Component") -> DraftBody | DraftFrame | None:
        """The body, or the frame that follows others, on which a surface or visual model is; None on other points."""
        state = independent_state(node_of(component))
        if state is None or not (is_assembled(state) and is_rigid(state)):
            return self.body_of(component)
        found = frame_carrying(component)
        return None if found is None else self.frames.setdefault((id(found[0]), found[1]), DraftFrame(*found))

    def joint_of(self, component: "Component") -> DraftJoint | None:
        """The angles on which a component acts, or None if it acts on something else."""
        state = nearest(node_of(component), {STATE})
        if state is None or width_of(state) != 1 or mapping_of(state) is not None:
            return None
        return self.joints.setdefault(id(state), DraftJoint(state))

    def points_of(self, component: "Component") -> np.ndarray:
        """Points of the mechanical object in a component's node, mapped or independent, and origins of frames in their
        own axes [mm], shape (count, 3)."""
        state = nearest(node_of(component), {STATE})
        if state is None or is_rigid(state):
            return np.zeros((0 if state is None else len(start_position(state)), 3))
        return local_position(state)

    def points_in(self, component: "Component", body: DraftBody, *names: str) -> np.ndarray:
        """The points of a body that the first of these data names that the scene gives, shape (count,)."""
        points = component.read_numbers(*names).astype(np.int64)
        self.check_points(component, points, len(body.position))
        return points

    def check_points(self, component: "Component", named: np.ndarray, count: int) -> None:
        """Refuse a component that names a point outside the `count` points that are there; indices of any shape."""
        outside = named[(named < 0) | (named >= count)]
        if len(outside):
            there = f"its points are 0 to {count - 1}" if count else "there are none"
            raise component.refused(f"names point {int(outside[0])}; {there}")

    def solver_above(self, node: "Node") -> "Component | None":
        """The time integration of what is in a node: as in SOFA the uppermost of those above, or None."""
        solvers = [self.solvers[id(above)] for above in upwards(node) if id(above) in self.solvers]
        return solvers[-1] if solvers else None

    def above(self, node: "Node", by_node: "dict[int, Component]") -> "Component | None":
        """The component in `by_node` of a node, or of the nearest node above it, or None."""
        return next((by_node[id(above)] for above in upwards(node) if id(above) in by_node), None)
