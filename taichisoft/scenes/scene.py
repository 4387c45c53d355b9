"""What a user describes: bodies, obstacles, contact and time, as plain validated data without arrays.

Units: millimetre, kilogram, second; so forces are in mN and pressures and moduli in kPa.
"""

import math
from collections import Counter
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, field_validator, model_serializer, model_validator

from taichisoft.scenes.colours import Colour

# Strict: no text and no truth value is taken for a number.
Number = Annotated[float, Field(strict=True)]
Positive = Annotated[float, Field(strict=True, gt=0)]
NotNegative = Annotated[float, Field(strict=True, ge=0)]
PoissonRatio = Annotated[float, Field(strict=True, gt=-1, lt=0.5)]
Vector = tuple[Number, Number, Number]
NodeNumber = Annotated[int, Field(strict=True, ge=0)]
Groups = list[Annotated[int, Field(strict=True)]]
KeySets = tuple[tuple[str, ...], ...]
# Without the signs that join names: "finger.cavity" is a cavity, "finger|cube" a pair, "base/cube.h5" a path.
Name = Annotated[str, Field(pattern=r"^[^.|/]+$")]


class Table(BaseModel):
    """A table of a scene: unknown keys, NaN and infinity are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, use_attribute_docstrings=True)

    alternatives: ClassVar[KeySets] = ()
    """Sets of keys; exactly one key of each set must be given."""
    no_effect_beside: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    """Keys that another one makes useless; they are no mistake at their defaults: a scene written out has them all."""

    @model_validator(mode="after")
    def _check_keys(self) -> Self:
        for keys in self.alternatives:
            given = [key for key in keys if getattr(self, key) is not None]
            if len(given) != 1:
                raise ValueError(f"exactly one of {', '.join(keys)} is needed; given: {', '.join(given) or 'none'}")
        for chosen, keys in self.no_effect_beside.items():
            useless = [key for key in keys if getattr(self, key) != type(self).model_fields[key].default]
            if useless and getattr(self, chosen) is not None:
                raise ValueError(f"beside {chosen} there is no effect of {', '.join(useless)}; remove it")
        return self


def check_order(table: Table, *quantities: str) -> None:
    """Raise ValueError where the lowest value of a quantity exceeds the highest."""
    for quantity in quantities:
        low, high = getattr(table, f"lowest_{quantity}"), getattr(table, f"highest_{quantity}")
        if low is not None and high is not None and low > high:
            raise ValueError(f"lowest_{quantity} ({low:g}) must not exceed highest_{quantity} ({high:g})")


class Selection(Table):
    """Nodes or elements of a soft body, by a box in the mesh's own coordinates or by a group of the mesh."""

    box: tuple[Vector, Vector] | None = None
    """Lower and upper corner [mm]; an element belongs when the mean of its nodes lies inside."""
    group: str | None = None
    """Name of an element group or surface group of the mesh."""
    alternatives: ClassVar[KeySets] = (("box", "group"),)

    @model_validator(mode="after")
    def _check_box(self) -> Self:
        if self.box is not None and any(low > high for low, high in zip(*self.box, strict=True)):
            corners = " and ".join(str(list(corner)) for corner in self.box)
            raise ValueError(f"the first corner of a box must be below the second in x, y and z; they are {corners}")
        return self


class NodeSelection(Selection):
    """Nodes of a soft body, by box, by group or by their numbers."""

    nodes: Annotated[list[NodeNumber], Field(min_length=1)] | None = None
    """Numbers of the nodes, from 0 in the order of the mesh."""
    alternatives: ClassVar[KeySets] = (("box", "group", "nodes"),)

    @model_validator(mode="after")
    def _check_nodes(self) -> Self:
        for node, count in Counter(self.nodes or []).items():
            if count > 1:
                raise ValueError(f"nodes names node {node} {count} times; name every node once")
        return self


class Region(Selection):
    """Elements of another material; a later region wins over an earlier one."""

    young_modulus: Positive
    """Young's modulus [kPa]."""
    poisson_ratio: PoissonRatio | None = None
    """Poisson's ratio [-]; the body's own when it is not given."""


class Anchor(NodeSelection):
    """Nodes held by stiff springs to their rest positions, which move with the base."""

    stiffness: Positive = 1e12
    """Stiffness of the spring of each node [mN/mm]."""


class Tip(NodeSelection):
    """Nodes whose motion is observed as that of the tip; without this table those farthest from the anchors."""


class Cavity(Table):
    """An air chamber: a closed surface, by a group of the mesh or by a surface file of its own."""

    group: str | None = None
    """Name of a closed surface group of the mesh; either this or surface."""
    surface: str | None = None
    """Closed surface file; either this or group."""
    lowest_pressure: Number | None = None
    """Smallest pressure [kPa]: a pump that draws no further."""
    highest_pressure: Number | None = None
    """Largest pressure [kPa]: a valve that opens."""
    lowest_volume_growth: Number | None = None
    """How far the volume shrinks at most [mm^3], negative, whatever the pressure."""
    highest_volume_growth: Number | None = None
    """How far the volume grows at most [mm^3]: there is no more air."""
    alternatives = (("group", "surface"),)

    @model_validator(mode="after")
    def _check_limits(self) -> Self:
        check_order(self, "pressure", "volume_growth")
        return self


class CablePoint(Table):
    """A point of a cable on another body than the one that has the cable."""

    body: str
    """Name of the soft body, rigid body or obstacle."""
    point: Vector
    """The point in this body's own coordinates, those of its mesh or of its scaled surface [mm]."""


class Cable(Table):
    """A cable (tendon) through points of bodies: pulled in at its first point, attached at the last, free to slide
    through those between."""

    points: str | list[Vector | CablePoint]
    """Points in the mesh's own coordinates [mm], or a file with a list of them (.json) or lines of x, y, z (.csv)."""
    pull_point: Vector | None = None
    """The place from which the cable is pulled, in the same coordinates [mm]; the first point when it is not given."""
    pull_point_moves: bool = True
    """Whether the pull point moves with the base; else it stays where it is in space."""
    friction: NotNegative = 0.0
    """Friction coefficient between the cable and its points [-]."""
    axial_stiffness: Positive | None = None
    """Young's modulus times cross-section: tension per relative stretch [mN]. When it is not given a cable does not
    stretch; one with friction has 1e7 mN, a thin line of strong fibres, since what does not stretch cannot stick."""
    rod: bool = False
    """Whether it pushes as well as it pulls; the tension of a cable is never negative."""
    lowest_tension: Number | None = None
    """Smallest tension [mN]; that of a cable is 0 when it is not given."""
    highest_tension: Number | None = None
    """Largest tension [mN], at which a motor gives way."""
    lowest_pull: Number | None = None
    """How far the cable is pulled in at least [mm]; negative when it may be paid out."""
    highest_pull: Number | None = None
    """How far the cable can be pulled in [mm], a stop."""

    @model_validator(mode="after")
    def _check_limits(self) -> Self:
        check_order(self, "tension", "pull")
        if not self.rod and (self.lowest_tension or 0.0) < 0.0:
            raise ValueError(f"lowest_tension ({self.lowest_tension:g}) must not be negative unless rod = true")
        if not self.rod and (self.highest_tension or 0.0) < 0.0:
            raise ValueError(f"highest_tension ({self.highest_tension:g}) must not be negative unless rod = true")
        if not isinstance(self.points, str) and len(self.points) + (self.pull_point is not None) < 2:
            raise ValueError(f"points has {len(self.points)} points; a cable needs two, its pull point counted")
        return self


class BodyMesh(Table):
    """The source of a soft body's mesh; `mesh = "FILE"` is short for a table with nothing but `file`."""

    file: str
    """A mesh (.msh, .vtk, .vtu), or a geometry (.toml) that is meshed on first use; or the name of a shipped one."""
    size: Positive | None = None
    """Largest element of a geometry's mesh [mm]; the geometry's own when neither it nor preset or nodes is given."""
    preset: str | None = None
    """Name of one of the geometry's sizes, such as "coarse", "medium" or "fine"."""
    nodes: Annotated[int, Field(strict=True, gt=0)] | None = None
    """Number of nodes that the geometry's mesh should have, roughly."""
    set: dict[str, Any] = {}
    """Values to take instead of the geometry's own: { chambers.height = 12.0 }."""

    @model_validator(mode="before")
    @classmethod
    def _read_text(cls, value: Any) -> Any:
        if not isinstance(value, str | dict | cls):
            raise ValueError(f"{value!r} must be the name of a file, or a table with the key file")
        return {"file": value} if isinstance(value, str) else value

    @model_validator(mode="after")
    def _check_one_size(self) -> Self:
        sizes = [key for key in ("size", "preset", "nodes") if getattr(self, key) is not None]
        if len(sizes) > 1:
            raise ValueError(f"one of size, preset, nodes can be given; given: {', '.join(sizes)}")
        return self

    @model_serializer
    def _write_short(self) -> Any:
        """The file alone where nothing else is asked for."""
        return {"file": self.file, **self.request} if self.request else self.file

    @property
    def request(self) -> dict[str, Any]:
        """Keys that are given beside the file."""
        given = {key: getattr(self, key) for key in ("size", "preset", "nodes", "set")}
        return {key: value for key, value in given.items() if value not in (None, {})}


class CollisionSurface(Table):
    """A surface that touches other bodies; `collision_surface = "FILE"` is short for a single one without groups.

    Without any it is the mesh's outer boundary.
    """

    file: str
    """A closed surface file that follows the mesh."""
    open: bool = False
    """Whether the surface may have open edges; it touches what is on the side that it faces."""
    groups: Groups = []
    """Surfaces that have a group in common do not touch each other; all others do, also two of the same body."""


class SoftBody(Table):
    """A silicone body of corotational finite elements."""

    mesh: BodyMesh
    """Mesh of the body: a file's name, or the table [soft_bodies.NAME.mesh]."""
    rotation: Vector = (0.0, 0.0, 0.0)
    """Placement: turns about the x, y and z axes, in this order [degrees]."""
    translation: Vector = (0.0, 0.0, 0.0)
    """Placement: shift after the rotation [mm]."""
    velocity: Vector = (0.0, 0.0, 0.0)
    """Velocity of all nodes at the start [mm/s]."""
    mass: Positive | None = None
    """Mass [kg], spread evenly over the nodes; either this or density."""
    density: Positive | None = None
    """Density [kg/mm^3]; the mass of each element is spread over its nodes."""
    young_modulus: Positive
    """Young's modulus [kPa]."""
    poisson_ratio: PoissonRatio
    """Poisson's ratio [-]."""
    rayleigh_mass: NotNegative = 0.0
    """Rayleigh damping with the mass [1/s]."""
    rayleigh_stiffness: NotNegative = 0.0
    """Rayleigh damping with the stiffness [s]."""
    corotation: Literal["edges", "polar"] = "edges"
    """Rotation of an element: from its first two edges, as SOFA's method "large", or by polar decomposition."""
    embedding: Literal["deepest", "grid"] = "deepest"
    """Which element carries a point of a surface file that lies outside the mesh: the one with the nearest centroid of
    all, as SOFA's MeshTopology, or of some near it on a grid, as its TetrahedronSetTopologyContainer."""
    points_outside: Literal["refused", "extrapolated"] = "refused"
    """What becomes of points of surface files and cables that lie far outside the mesh: an error, or they follow the
    element that carries them with extrapolated weights, as in SOFA."""
    collision_surface: list[CollisionSurface] = []
    """Surfaces that touch other bodies: the name of a closed surface file that follows the mesh, or a list of tables;
    the mesh's outer boundary when it is not given."""
    collides: bool = True
    """Whether the body touches others; one that does not goes through them."""
    colour: Colour | None = None
    """Colour in pictures and on pages, "#rrggbb"; that of silicone when it is not given."""
    tip: Tip | None = None
    """The nodes whose motion is observed as that of the tip; those farthest from the anchors when it is not given."""
    regions: list[Region] = []
    anchors: list[Anchor] = []
    cavities: dict[Name, Cavity] = {}
    cables: dict[Name, Cable] = {}
    alternatives = (("mass", "density"),)

    @model_validator(mode="after")
    def _check_actuator_names(self) -> Self:
        both = sorted(self.cavities.keys() & self.cables.keys())
        if both:
            raise ValueError(f"a cavity and a cable are both called '{both[0]}'; give one another name")
        return self

    @field_validator("collision_surface", mode="before")
    @classmethod
    def _read_file(cls, value: Any) -> Any:
        if not isinstance(value, str | list):
            raise ValueError(f"{value!r} must be the name of a file, or a list of tables with the key file")
        return [{"file": value}] if isinstance(value, str) else value


class RigidBody(Table):
    """A rigid object; mass, centre of mass and inertia come from its closed surface unless they are given."""

    surface: str | None = None
    """Closed surface file; either this or box."""
    box: tuple[Positive, Positive, Positive] | None = None
    """Edge lengths [mm] of a box about the origin."""
    scale: Positive = 1.0
    """Factor on the surface's coordinates [-]; not of a box."""
    mass: Positive | None = None
    """Mass [kg]; either this or density."""
    density: Positive | None = None
    """Density [kg/mm^3]."""
    inertia: tuple[Vector, Vector, Vector] | None = None
    """Inertia about the centre of mass, in the surface's axes [kg mm^2]."""
    centre_of_mass: Vector | None = None
    """Centre of mass in the surface's scaled coordinates [mm]."""
    position: Vector = (0.0, 0.0, 0.0)
    """Place of the surface's origin at the start [mm]."""
    rotation: Vector = (0.0, 0.0, 0.0)
    """Turns about the x, y and z axes, in this order, at the start [degrees]."""
    velocity: Vector = (0.0, 0.0, 0.0)
    """Velocity of the centre of mass at the start [mm/s]."""
    angular_velocity: Vector = (0.0, 0.0, 0.0)
    """Angular velocity at the start [rad/s]."""
    collides: bool = True
    """Whether the body touches others; one that does not goes through them."""
    groups: Groups = []
    """Surfaces that have a group in common do not touch each other."""
    colour: Colour | None = None
    """Colour in pictures and on pages, "#rrggbb"; that of rigid bodies when it is not given."""
    alternatives = (("surface", "box"), ("mass", "density"))
    no_effect_beside: ClassVar = {"box": ("scale",)}


class Plane(Table):
    """An infinite plane, solid on the side that its normal points away from."""

    point: Vector
    """Any point of the plane [mm]."""
    normal: Vector
    """Direction from the solid side to the free one, of any length."""

    @model_validator(mode="after")
    def _check_normal(self) -> Self:
        if not any(self.normal):
            raise ValueError("the normal of a plane must not be zero")
        return self


class Obstacle(Table):
    """Something that never moves: a plane, or a surface that may be scaled, turned and shifted."""

    plane: Plane | None = None
    surface: str | None = None
    """Surface file; either this or plane."""
    scale: Positive = 1.0
    """Factor on the surface's coordinates [-]."""
    rotation: Vector = (0.0, 0.0, 0.0)
    """Turns about the x, y and z axes, in this order [degrees]."""
    translation: Vector = (0.0, 0.0, 0.0)
    """Shift after the rotation [mm]."""
    groups: Groups = []
    """Surfaces that have a group in common do not touch each other; a plane touches all."""
    colour: Colour | None = None
    """Colour in pictures and on pages, "#rrggbb"; that of obstacles, or of the floor, when it is not given."""
    alternatives = (("plane", "surface"),)
    no_effect_beside: ClassVar = {"plane": ("scale", "rotation", "translation", "groups")}


class PairFriction(Table):
    """The friction coefficient of one pair of bodies."""

    bodies: tuple[str, str]
    """Names of the two bodies."""
    friction: NotNegative
    """Coulomb's friction coefficient [-]."""


class Contact(Table):
    """How contacts are found and solved."""

    friction: NotNegative = 0.6
    """Coulomb's friction coefficient [-]."""
    pairs: list[PairFriction] = []
    """Exceptions from `friction`."""
    contact_distance: Positive = 1.0
    """Distance that surfaces are kept apart [mm]."""
    alarm_distance: Positive = 5.0
    """Distance below which a pair becomes a constraint [mm]."""
    spacing: NotNegative = 4.0
    """Distance [mm] below which only the closest of two contacts of a soft body with another body is kept."""
    tolerance: Positive = 1e-5
    """The Gauss-Seidel stops when no contact's velocity changes by more than this in a sweep [mm/s]."""
    max_iterations: Annotated[int, Field(strict=True, gt=0)] = 10000
    """Most sweeps of the Gauss-Seidel in a step; a step that needs more is counted as not converged."""

    @model_validator(mode="after")
    def _check_pairs(self) -> Self:
        seen: set[frozenset[str]] = set()
        for pair in self.pairs:
            first, second = pair.bodies
            if frozenset(pair.bodies) in seen:
                raise ValueError(f"pairs names '{first}' and '{second}' twice; keep one of the two")
            seen.add(frozenset(pair.bodies))
        return self

    @model_validator(mode="after")
    def _check_distances(self) -> Self:
        if self.alarm_distance <= self.contact_distance:
            raise ValueError(
                f"alarm_distance ({self.alarm_distance:g}) must exceed contact_distance ({self.contact_distance:g})"
            )
        return self


class Time(Table):
    """Time stepping."""

    step: Positive = 0.01
    """Time step [s]."""
    duration: Positive = 1.0
    """Duration of a run [s]."""
    dynamics: Literal["second order", "first order"] = "second order"
    """Newton's law, or motion without inertia against a drag of 1 mN for 1 mm/s and kg, as SOFA's `firstOrder`; soft
    bodies alone can move so, and Rayleigh damping and their velocities at the start have no effect then."""


class Controller(Table):
    """Which controller drives the scene, and its settings."""

    name: str
    """Name under which a plug-in provides the controller."""
    settings: dict[str, Any] = {}
    """Settings of the controller, as docs/controllers.md lists them for those that ship."""
    period: Positive | None = None
    """Time between two calls of the controller [s], a whole multiple of `time.step`; one step when it is not given."""
    time_limit: Positive | None = None
    """Longest time that a call may take before it ends the run [s]; no limit when it is not given."""


class Limits(Table):
    """What no controller can exceed: requests beyond are clipped, and the controller is told so."""

    lowest_pressure: Number | None = None
    """Lowest pressure [kPa]."""
    highest_pressure: Number | None = None
    """Highest pressure [kPa]."""
    pressure_rate: Positive | None = None
    """Fastest change of a pressure, up or down [kPa/s]."""
    tension_rate: Positive | None = None
    """Fastest change of a cable's tension, up or down [mN/s]."""
    pull_speed: Positive | None = None
    """Fastest motion of a cable that is pulled in or paid out [mm/s]."""
    base_speed: Positive | None = None
    """Fastest motion of the base [mm/s]."""
    base_turning_speed: Positive | None = None
    """Fastest turn of the base [degrees/s]."""

    @model_validator(mode="after")
    def _check_pressures(self) -> Self:
        check_order(self, "pressure")
        return self


class ExternalForce(Table):
    """A force from outside on the centre of mass of a rigid body."""

    body: str
    """Name of the rigid body."""
    force: Vector
    """Force [mN]."""
    start: NotNegative
    """Time from which the force acts [s]."""
    duration: Positive
    """Time for which the force acts [s]."""


class Goal(Table):
    """What a run must achieve: an object lifted with the base and held; checked by the metrics output."""

    object: str
    """Name of the rigid body."""
    tolerance: Positive = 1.0
    """Largest difference between the lift of the object and of the base [mm]; both must rise by more."""
    hold: Positive = 2.0
    """Time at the end of the run in which the object must stand still [s]."""
    creep: Positive = 0.1
    """Largest motion of the object during `hold` [mm]."""


class Appearance(Table):
    """How pictures, videos and pages show the scene, as far as nobody asks for something else."""

    background: Colour | None = None
    """Colour behind everything, "#rrggbb"; a light one when it is not given."""
    frame: bool = True
    """Whether the directions of x, y and z stand in a corner of pictures and videos."""


class Scene(Table):
    """Everything that a run needs to know."""

    title: str = ""
    """Text that displays show instead of the file's name."""
    gravity: Vector = (0.0, 0.0, -9810.0)
    """Acceleration of gravity [mm/s^2]."""
    time: Time = Time()
    contact: Contact = Contact()
    base_pivot: Vector | None = None
    """The point about which the base turns [mm]; the mean of the anchored nodes when it is not given."""
    controller: Controller | None = None
    limits: Limits = Limits()
    external_forces: list[ExternalForce] = []
    goal: Goal | None = None
    appearance: Appearance = Appearance()
    soft_bodies: dict[Name, SoftBody] = {}
    rigid_bodies: dict[Name, RigidBody] = {}
    obstacles: dict[Name, Obstacle] = {}

    @property
    def steps_per_control(self) -> int:
        """Time steps from one call of the controller to the next."""
        period = self.controller.period if self.controller is not None else None
        return 1 if period is None else round(period / self.time.step)

    @property
    def up(self) -> np.ndarray:
        """The unit vector against gravity, shape (3,); the z axis where there is no gravity."""
        strength = np.linalg.norm(self.gravity)
        return -np.array(self.gravity) / strength if strength > 0.0 else np.array([0.0, 0.0, 1.0])

    @property
    def young_moduli(self) -> dict[str, float]:
        """Young's moduli [kPa] by material: each soft body's own ("finger"), then its regions' ("finger.regions.0")."""
        moduli = {}
        for name, body in self.soft_bodies.items():
            moduli[name] = body.young_modulus
            moduli |= {f"{name}.regions.{index}": region.young_modulus for index, region in enumerate(body.regions)}
        return moduli

    @property
    def main_object(self) -> str | None:
        """Name of the rigid body that a run is about: that of the goal, else the first; None without rigid bodies."""
        return self.goal.object if self.goal is not None else next(iter(self.rigid_bodies), None)

    @model_validator(mode="after")
    def _check_control_period(self) -> Self:
        period, step = self.controller.period if self.controller is not None else None, self.time.step
        if period is not None:
            count = period / step
            if count < 0.5 or abs(count - round(count)) > 1e-6 * count:
                below, above = math.floor(count) * step, math.ceil(count) * step
                near = f"{below:g} or {above:g}" if below else f"{above:g}"
                raise ValueError(
                    f"controller.period = {period:g} s must be a whole multiple of time.step = {step:g} s, such as "
                    f"{near} s"
                )
        return self

    @model_validator(mode="after")
    def _check_dynamics(self) -> Self:
        if self.time.dynamics == "first order" and self.rigid_bodies:
            raise ValueError(
                f"time.dynamics = 'first order' is for soft bodies alone; remove the rigid body "
                f"'{next(iter(self.rigid_bodies))}', or leave it 'second order'"
            )
        return self

    @model_validator(mode="after")
    def _check_names(self) -> Self:
        names = [*self.soft_bodies, *self.rigid_bodies, *self.obstacles]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"two bodies are called '{twice[0]}'; every body needs a name of its own")
        mentioned = {name: "contact.pairs" for pair in self.contact.pairs for name in pair.bodies}
        for name, key in mentioned.items():
            if name not in names:
                raise ValueError(f"{key} names '{name}', which is no body; there are: {', '.join(names)}")
        for pair in self.contact.pairs:
            name, other = pair.bodies
            if name == other and (name not in self.soft_bodies or len(self.soft_bodies[name].collision_surface) < 2):
                raise ValueError(
                    f"contact.pairs names '{name}' with itself; a body touches itself only where it is soft and has "
                    "several collision surfaces, name two bodies"
                )
        rigid = {f"external_forces.{index}.body": push.body for index, push in enumerate(self.external_forces)}
        if self.goal is not None:
            rigid["goal.object"] = self.goal.object
        for key, name in rigid.items():
            if name not in self.rigid_bodies:
                known = ", ".join(self.rigid_bodies) or "none"
                raise ValueError(f"{key} is '{name}', which is no rigid body; there are: {known}")
        if not self.soft_bodies and not self.rigid_bodies:
            raise ValueError("a scene needs at least one soft body or rigid body")
        return self
