"""What a user describes: bodies, obstacles, contact and time, as plain validated data without arrays."""

import math
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from taichisoft.scene.actuators import ActuatorLimits
from taichisoft.scene.air import AirNetworkSettings
from taichisoft.scene.rigid_body import BASE, FrameSettings, ObstacleSettings, RigidBodySettings
from taichisoft.scene.sensor_settings import CameraSettings, SensedQuantity, SensorSettings, TactileArray, sensed_names
from taichisoft.scene.soft_body import SoftBodySettings
from taichisoft.scene.table import (
    Colour,
    Direction,
    Name,
    NotNegative,
    Positive,
    Rule,
    Share,
    Table,
    Vector,
    entries,
)

# The table of time in a scene: the step, what moves without inertia, and where in the step forces are taken.

STATIC_LINEARISATIONS = 2000
"""Most linearisations of a static move: a finger needs 13 at 30 kPa and 41 at 100 kPa, since a linearisation leaves out
how pressure turns with the walls; one just below the pressure that it cannot carry needs 600."""


LEAST_THETA_OF_THREADS = 0.55
"""The midpoint rule does not keep the energy of Green's strain: a thrown strip with a sheet gained energy at a theta of
0.5 until it diverged, and none at 0.55."""
LEAST_NEWTON_OF_WRINKLES = 3
"""A slack sheet does not resist within one linearisation what tautens it: a strip that was thrown doubled its energy in
a step of 10 ms; with three linearisations, sheets of 1e5 and 1e7 kPa gained none in steps of 1 and 10 ms."""


class Time(Table):
    """Time stepping."""

    step: Positive = 0.01
    """Time step [s]."""
    duration: Positive = 1.0
    """Duration of a run [s]."""
    dynamics: Literal["inertial", "overdamped", "static"] = "inertial"
    """Newton's law, or motion without inertia against a drag of 1 mN for 1 mm/s and kg, as SOFA's `firstOrder`, or
    none: a static step leads to equilibrium, whatever its length, as `taichisoft.equilibrium` finds it; nothing has a
    velocity then, and Rayleigh damping no effect. Soft bodies need anchors in statics; rigid bodies need inertia or
    statics."""
    theta: Annotated[float, Field(ge=0.5, le=1.0)] = 1.0
    """Where in the step forces are taken: 1 is implicit Euler, which damps what swings; 0.5 is of second order in the
    step with `newton` above 1, and damps nothing. Contacts, and actuators that are solved for, obey their laws at the
    end of the step whatever it is (Moreau and Jean's scheme)."""
    newton: Annotated[int, Field(strict=True, gt=0)] = 1
    """Most linearisations of the soft bodies' equations in a step. One is linearly implicit Euler; more lead to the
    solution of the equations at the end of the step, contacts and actuators included. Static steps take more."""
    newton_tolerance: Positive = 1e-7
    """No further linearisation is made where one would move no node by more than this [mm], whatever the step."""

    @property
    def stage(self) -> float:
        """From the start of a step to where forces are taken [s]: theta h."""
        return self.theta * self.step

    @property
    def most_linearisations(self) -> int:
        """`newton`, and enough to find an equilibrium in static steps."""
        return max(self.newton, STATIC_LINEARISATIONS) if self.dynamics == "static" else self.newton


# How contacts are found and solved, and what pairs of bodies have of their own.


class ContactPair(Table):
    """What differs between one pair of bodies."""

    bodies: tuple[str, str]
    """Names of the two bodies."""
    friction: NotNegative | None = None
    """Coulomb's friction coefficient [-]; the scene's when it is not given."""
    restitution: Share | None = None
    """Coefficient of restitution [-]; the scene's when it is not given."""
    rolling_friction: NotNegative | None = None
    """Length of rolling friction [mm]; the scene's when it is not given."""
    spinning_friction: NotNegative | None = None
    """Length of spinning friction [mm]; the scene's when it is not given."""

    @model_validator(mode="after")
    def _check_something_differs(self) -> Self:
        given = self.friction, self.restitution, self.rolling_friction, self.spinning_friction
        if all(one is None for one in given):
            raise ValueError(
                "a pair needs friction, restitution, rolling_friction or spinning_friction, which are to differ from "
                "the scene's"
            )
        return self


class Contact(Table):
    """How contacts are found and solved."""

    friction: NotNegative = 0.6
    """Coulomb's friction coefficient [-]."""
    restitution: Share = 0.0
    """Share of the speed of approach that an impact gives back [-] (Newton's law)."""
    rolling_friction: NotNegative = 0.0
    """Length b [mm] of rolling friction: two bodies that press each other by N resist rolling with a moment of at most
    b N. A soft body resists by its own deformation; it has none of this."""
    spinning_friction: NotNegative = 0.0
    """Length b [mm] of spinning friction, the same for turning about the normal."""
    pairs: list[ContactPair] = []
    """Exceptions from the four coefficients above."""
    contact_distance: Positive = 1.0
    """Distance that surfaces are kept apart [mm]."""
    alarm_distance: Positive = 5.0
    """Distance up to which contacts are looked for [mm]; further where bodies move farther in a step."""
    spacing: NotNegative = 4.0
    """Distance [mm] within which only the worst contact of two bodies is added to the constraints at a time; this
    changes how fast a step is, not what comes out."""
    depth: Literal["position", "velocity"] = "position"
    """How surfaces that are closer than `contact_distance` at the start of a step come apart: by a shift that adds no
    speed, or, as in SOFA, by the speed depth / step, which stays."""
    tolerance: Positive = 1e-5
    """The contact solver stops when no contact's velocity changes by more than this in a sweep [mm/s]."""
    max_iterations: Annotated[int, Field(strict=True, gt=0)] = 1000
    """Largest number of sweeps of the contact solver, with one for each Newton step. A step that needs more is counted
    as not converged."""

    rules = (
        Rule(
            "alarm_distance > contact_distance",
            "alarm_distance ({alarm_distance:g}) must exceed contact_distance ({contact_distance:g})",
        ),
    )

    @model_validator(mode="after")
    def _check_pairs(self) -> Self:
        seen: set[frozenset[str]] = set()
        for pair in self.pairs:
            first, second = pair.bodies
            if frozenset(pair.bodies) in seen:
                raise ValueError(f"pairs names '{first}' and '{second}' twice; keep one of the two")
            seen.add(frozenset(pair.bodies))
        return self


GoalKind = Literal["held", "placed", "pushed", "lifted"]


class SceneControllerSettings(Table):
    """Which controller drives the scene, and its settings."""

    name: str
    """Name under which a plug-in provides the controller."""
    settings: dict[str, Any] = {}
    """Settings of the controller, as docs/controllers.md lists them for those that ship."""
    period: Positive | None = None
    """Time between two calls of the controller [s], a whole multiple of `time.step`; one step when it is not given."""
    time_limit: Positive | None = None
    """Longest time that a call may take before it ends the run [s]; no limit when it is not given."""


class Limits(ActuatorLimits):
    """What no controller can exceed: requests beyond are clipped, and the controller is informed."""

    base_speed: Positive | None = None
    """Fastest motion of the base [mm/s]."""
    base_turning_speed: Positive | None = None
    """Fastest turn of the base [degrees/s]."""


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
    """What a run must achieve with an object; checked by the metrics output."""

    object: str
    """Name of the rigid body."""
    kind: GoalKind = "held"
    """What must be so: "held", lifted with the base and held; "placed", at `position` and at rest; "pushed", between
    the fingers where it was before the first of the scene's external forces on it; "lifted", by `height` once."""
    position: Vector | None = None
    """Where the centre of mass of an object is to be that is placed [mm]."""
    height: Positive | None = None
    """Peak lift of an object that is to be lifted [mm], against gravity."""
    tolerance: Positive = 1.0
    """Largest slip of the object in the fingers, where it and the base must rise by more; distance between where it is
    placed and `position`; or between where it is held before and after a push [mm]."""
    hold: Positive = 2.0
    """Time at the end of the run in which the object must stand still [s]."""
    creep: Positive = 0.1
    """Largest motion of the object during `hold` [mm]."""
    max_pressure: Positive | None = None
    """Highest pressure of a soft body on the object that the object survives [kPa], such as an egg."""
    own_keys: ClassVar = {'kind == "placed"': ("position",), 'kind == "lifted"': ("height",)}
    needs: ClassVar = own_keys


class Appearance(Table):
    """How pictures, videos and pages show the scene, unless options say otherwise."""

    background: Colour | None = None
    """Colour behind everything, "#rrggbb"; a light one when it is not given."""
    frame: bool = True
    """Whether the directions of x, y and z stand in a corner of pictures and videos, and beside the bodies of pages."""
    light: Direction | None = None
    """Direction towards the light, of any length; from above, in front and the right when it is not given."""
    shadows: bool = True
    """Whether bodies cast shadows on the floor."""
    eye: Vector | None = None
    """Where the camera stands [mm]; aslant of everything when it is not given."""
    target: Vector | None = None
    """What a camera at `eye` looks at [mm]; the middle of the scene when it is not given."""
    needs: ClassVar = {"target": ("eye",)}
    rules = (Rule("eye != target", "eye and target are one point, {eye}: the camera would look nowhere"),)


PRESSURES = {
    "limits": ("lowest_pressure", "highest_pressure"),
    "soft_bodies.*.cavities.*": ("lowest_pressure", "highest_pressure", "shut_pressure"),
    "soft_bodies.*.cavities.*.line": ("supply", "exhaust"),
    "air.sources.*": ("pressure", "lowest_pressure", "highest_pressure"),
    "air.tanks.*": ("pressure",),
}
REFERENCES = {
    "frame": (
        *("frames.*.follows", "rigid_bodies.*.follows", "rigid_bodies.*.springs.follows", "soft_bodies.*.follows"),
        *("soft_bodies.*.anchors.*.follows", "cameras.*.follows"),
    ),
    "body": ("contact.pairs.*.bodies.*", "soft_bodies.*.cables.*.points.*.body"),
    "rigid body": ("external_forces.*.body", "goal.object"),
}
"""Keys that name a frame or body."""
IMPLICIT = "time.theta = {time.theta:g} must be 1, implicit Euler, with {path}; leave one of them out"
DAMPED = (
    f"time.theta = {{time.theta:g}} must be at least {LEAST_THETA_OF_THREADS:g} with {{path}}, which gain energy below"
)
AT_REST = "{path}: nothing moves at the start with time.dynamics = 'static'; remove it"


class Scene(Table):
    """Everything that a run needs to know."""

    title: str = ""
    """Text that displays show instead of the file's name."""
    gravity: Vector = (0.0, 0.0, -9810.0)
    """Acceleration of gravity [mm/s^2]."""
    atmosphere: Positive = 101.325
    """Absolute pressure outside the cavities [kPa], over which all other pressures are given (gauge pressure)."""
    air: AirNetworkSettings = AirNetworkSettings()
    time: Time = Time()
    contact: Contact = Contact()
    base_pivot: Vector | None = None
    """The point about which the base turns [mm]; the mean of the nodes anchored to it when it is not given."""
    frames: dict[Name, FrameSettings] = {}
    """What moves by itself beside the base, by name."""
    controller: SceneControllerSettings | None = None
    limits: Limits = Limits()
    external_forces: list[ExternalForce] = []
    goal: Goal | None = None
    sensors: dict[SensedQuantity, SensorSettings] = {}
    cameras: dict[Name, CameraSettings] = {}
    appearance: Appearance = Appearance()
    soft_bodies: dict[Name, SoftBodySettings] = {}
    rigid_bodies: dict[Name, RigidBodySettings] = {}
    obstacles: dict[Name, ObstacleSettings] = {}
    rules = (
        *(
            Rule(
                # A source may draw a whole vacuum; no pressure is one.
                "value >= -atmosphere" if key == "lowest_pressure" else "value > -atmosphere",
                "{path} = {value:g} kPa must be above the vacuum's {-atmosphere:g} kPa",
                f"{table}.{key}",
            )
            for table, keys in PRESSURES.items()
            for key in keys
        ),
        Rule(
            'time.dynamics != "overdamped"',
            "time.dynamics = 'overdamped' is for soft bodies alone; remove the rigid body '{value}', or take "
            "'inertial' or 'static'",
            "objects.*",
        ),
        Rule(
            'time.dynamics != "static" or value',
            "time.dynamics = 'static' needs anchors of every soft body; {path} is empty",
            "soft_bodies.*.anchors",
        ),
        *(
            Rule('time.dynamics != "static" or max(value) == 0 and min(value) == 0', AT_REST, of)
            for of in ("soft_bodies.*.velocity", "rigid_bodies.*.velocity", "rigid_bodies.*.angular_velocity")
        ),
        Rule(
            'time.theta == 1 or value == "inertial"', IMPLICIT.replace("{path}", "{path} = '{value}'"), "time.dynamics"
        ),
        Rule("time.theta == 1", IMPLICIT, "soft_bodies.*.reduced"),
        Rule("time.theta == 1 or value == 0", IMPLICIT, "soft_bodies.*.cables.*.friction"),
        *(
            Rule(f"time.theta >= {LEAST_THETA_OF_THREADS} or not value", DAMPED, f"soft_bodies.*.{thin}")
            for thin in ("membranes", "fibres", "springs")
        ),
        Rule(
            f"time.most_linearisations >= {LEAST_NEWTON_OF_WRINKLES} or not value",
            f"time.newton = {{time.newton}} must be at least {LEAST_NEWTON_OF_WRINKLES} with {{path}}, better 10",
            "soft_bodies.*.membranes.*.tension_only",
        ),
    )

    @property
    def steps_per_control(self) -> int:
        """Time steps from one call of the controller to the next."""
        period = self.controller.period if self.controller is not None else None
        return 1 if period is None else round(period / self.time.step)

    @property
    def up(self) -> np.ndarray:
        """The unit vector against gravity, shape (3,); the z axis without gravity."""
        strength = np.linalg.norm(self.gravity)
        return -np.array(self.gravity) / strength if strength > 0.0 else np.array([0.0, 0.0, 1.0])

    @property
    def young_moduli(self) -> dict[str, float]:
        """Young's moduli [kPa] by material: each soft body's own ("finger"), then its regions' ("finger.regions.0")."""
        moduli: dict[str, float] = {}
        for name, body in self.soft_bodies.items():
            names = [name, *(f"{name}.regions.{index}" for index in range(len(body.regions)))]
            moduli |= dict(zip(names, body.young_moduli, strict=True))
        return moduli

    def actuators(self, plural: str) -> dict[str, Any]:
        """Tables of the soft bodies' actuators of a kind, such as "cavities", by their names "body.actuator"."""
        bodies = self.soft_bodies.items()
        return {f"{name}.{one}": table for name, body in bodies for one, table in getattr(body, plural).items()}

    @property
    def all_frames(self) -> dict[str, FrameSettings]:
        """The base and all other frames, each behind the frame that carries it."""
        limits = self.limits
        # Every step needs them, and these values have been validated.
        base = FrameSettings.model_construct(
            pivot=self.base_pivot, speed=limits.base_speed, turning_speed=limits.base_turning_speed
        )
        found = {BASE: base}
        while len(found) <= len(self.frames):  # no frame carries itself, or this would not end
            found |= {name: one for name, one in self.frames.items() if one.follows is None or one.follows in found}
        return found

    @property
    def objects(self) -> list[str]:
        """Names of the rigid bodies that no frame carries."""
        return [name for name, body in self.rigid_bodies.items() if body.follows is None]

    @property
    def tactile_arrays(self) -> dict[str, TactileArray]:
        """Tables of all tactile arrays, by their names "body.array"."""
        bodies = self.soft_bodies.items()
        return {f"{name}.{one}": table for name, body in bodies for one, table in body.tactile.items()}

    @property
    def main_object(self) -> str | None:
        """Name of the rigid body that a run is about: the goal's, else the first that no frame carries; or None."""
        return self.goal.object if self.goal is not None else next(iter(self.objects), None)

    @model_validator(mode="after")
    def _check_times(self) -> Self:
        """Refuse times of controller and sensors that are no whole multiples of the step."""
        step = self.time.step
        for keys in ("controller.period", "sensors.*.period", "sensors.*.delay"):
            for path, value in entries(self, keys):
                count = value / step
                if (value and count < 0.5) or abs(count - round(count)) > 1e-6 * max(count, 1.0):
                    near = [multiple * step for multiple in (math.floor(count), math.ceil(count)) if multiple]
                    raise ValueError(
                        f"{path} = {value:g} s must be a whole multiple of time.step = {step:g} s, such as "
                        f"{' or '.join(f'{time:g}' for time in near)} s"
                    )
        return self

    @model_validator(mode="after")
    def _check_references(self) -> Self:
        bodies = [*self.soft_bodies, *self.rigid_bodies, *self.obstacles]
        if len(bodies) == len(self.obstacles):
            raise ValueError("a scene needs at least one soft body or rigid body")
        twice = sorted({name for name in bodies if bodies.count(name) > 1})
        if twice:
            raise ValueError(f"two bodies are called '{twice[0]}'; every body needs a name of its own")
        if BASE in self.frames:
            raise ValueError("frames.base: every scene has this frame; give base_pivot, limits.base_speed, and so on")
        known = {"frame": [BASE, *self.frames], "body": bodies, "rigid body": list(self.rigid_bodies)}
        for kind, places in REFERENCES.items():
            for path, name in (entry for keys in places for entry in entries(self, keys)):
                if name not in known[kind]:
                    there_are = ", ".join(known[kind]) or "none"
                    raise ValueError(f"{path} is '{name}', which is not a {kind}; there are: {there_are}")
                if kind == "rigid body" and self.rigid_bodies[name].follows is not None:
                    raise ValueError(
                        f"{path} is '{name}', which follows a frame whatever acts on it; name another body"
                    )
        return self

    @model_validator(mode="after")
    def _check_air(self) -> Self:
        self.air.check({name: cavity.air for name, cavity in self.actuators("cavities").items()})
        return self

    @model_validator(mode="after")
    def _check_circles(self) -> Self:
        for name in self.frames:
            above: list[str | None] = [name]
            while above[-1] in self.frames and above.count(above[-1]) == 1:
                above.append(self.frames[str(above[-1])].follows)
            if above[-1] == name and len(above) > 1:
                raise ValueError(
                    f"frames.{name} carries itself: it follows {' which follows '.join(map(str, above[1:]))}"
                )
        return self

    @model_validator(mode="after")
    def _check_effects(self) -> Self:
        """Refuse sensors and contact pairs that could never have an effect."""
        for quantity in self.sensors:
            if not sensed_names(self, quantity):
                raise ValueError(f"sensors.{quantity} measures nothing: the scene has none of that quantity; remove it")
        for name in (first for first, second in (pair.bodies for pair in self.contact.pairs) if first == second):
            if name not in self.soft_bodies or not self.soft_bodies[name].may_touch_itself:
                raise ValueError(
                    f"contact.pairs names '{name}' with itself; a body touches itself only where it is soft and has "
                    "self_contact or several collision surfaces, name two bodies"
                )
        return self
