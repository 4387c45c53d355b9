"""What a user describes: bodies, obstacles, contact and time, as plain validated data without arrays."""

import math
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from taichisoft.scene.actuators import ActuatorLimits
from taichisoft.scene.rigid_body import BASE, SHORTEST_NORMAL, FrameSettings, ObstacleSettings, RigidBodySettings
from taichisoft.scene.sensor_settings import CameraSettings, SensedQuantity, SensorSettings, TactileArray, check_sensors
from taichisoft.scene.soft_body import SoftBodySettings
from taichisoft.scene.table import Colour, Name, NotNegative, Number, Positive, Table, Vector

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

Restitution = Annotated[Number, Field(ge=0.0, le=1.0)]


class ContactPair(Table):
    """What differs between one pair of bodies."""

    bodies: tuple[str, str]
    """Names of the two bodies."""
    friction: NotNegative | None = None
    """Coulomb's friction coefficient [-]; the scene's when it is not given."""
    restitution: Restitution | None = None
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
    restitution: Restitution = 0.0
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

    @model_validator(mode="after")
    def _check_kind(self) -> Self:
        for kind, key in (("placed", "position"), ("lifted", "height")):
            if self.kind == kind and getattr(self, key) is None:
                raise ValueError(f'kind = "{kind}" needs {key}')
            if self.kind != kind and getattr(self, key) is not None:
                raise ValueError(f'{key} has no effect unless kind = "{kind}"; remove it')
        return self


class Appearance(Table):
    """How pictures, videos and pages show the scene, as far as nobody asks for something else."""

    background: Colour | None = None
    """Colour behind everything, "#rrggbb"; a light one when it is not given."""
    frame: bool = True
    """Whether the directions of x, y and z stand in a corner of pictures and videos, and beside the bodies of pages."""
    light: Vector | None = None
    """Direction towards the light, of any length; from above, in front and the right when it is not given."""
    shadows: bool = True
    """Whether bodies cast shadows on the floor."""
    eye: Vector | None = None
    """Where the camera stands [mm]; aslant of everything when it is not given."""
    target: Vector | None = None
    """What a camera at `eye` looks at [mm]; the middle of the scene when it is not given."""

    @model_validator(mode="after")
    def _check_light(self) -> Self:
        if self.light is not None and math.hypot(*self.light) < SHORTEST_NORMAL:
            raise ValueError(f"light = {list(self.light)}: has no direction; its length must not vanish")
        return self

    @model_validator(mode="after")
    def _check_camera(self) -> Self:
        if self.target is not None and self.eye is None:
            raise ValueError("target needs an eye, the place of the camera")
        if self.target is not None and self.eye == self.target:
            raise ValueError(f"eye and target are one point, {list(self.target)}: the camera would look nowhere")
        return self


class Scene(Table):
    """Everything that a run needs to know."""

    title: str = ""
    """Text that displays show instead of the file's name."""
    gravity: Vector = (0.0, 0.0, -9810.0)
    """Acceleration of gravity [mm/s^2]."""
    atmosphere: Positive = 101.325
    """Absolute pressure outside the cavities [kPa], over which all other pressures are given (gauge pressure)."""
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
        # Every step asks for them, and these values have been validated.
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
    def _check_sensors(self) -> Self:
        check_sensors(self)
        return self

    @model_validator(mode="after")
    def _check_vacuum(self) -> Self:
        vacuum, cavities = -self.atmosphere, self.actuators("cavities")
        tables: dict[str, Any] = {"limits": self.limits}
        for name, cavity in cavities.items():
            place = f"soft_bodies.{name.replace('.', '.cavities.')}"
            tables |= {place: cavity, f"{place}.line": cavity.line}
        for place, table in tables.items():
            for key in ("lowest_pressure", "highest_pressure", "shut_pressure", "supply", "exhaust"):
                pressure = getattr(table, key, None)
                if pressure is not None and (pressure < vacuum or (pressure == vacuum and key != "lowest_pressure")):
                    raise ValueError(f"{place}.{key} = {pressure:g} kPa must be above the vacuum's {vacuum:g} kPa")
        return self

    @model_validator(mode="after")
    def _check_dynamics(self) -> Self:
        dynamics = self.time.dynamics
        free = [name for name, one in self.rigid_bodies.items() if one.follows is None]
        if dynamics == "overdamped" and free:
            raise ValueError(
                f"time.dynamics = 'overdamped' is for soft bodies alone; remove the rigid body '{free[0]}', or take "
                "'inertial' or 'static'"
            )
        for name, body in self.soft_bodies.items():
            if dynamics == "static" and not body.anchors:
                raise ValueError(f"time.dynamics = 'static' needs anchors of every soft body; '{name}' has none")
        kinds = ("soft_bodies", "rigid_bodies") if dynamics == "static" else ()
        for place, body in ((f"{kind}.{name}", body) for kind in kinds for name, body in getattr(self, kind).items()):
            for key in ("velocity", "angular_velocity"):
                if any(getattr(body, key, ())):
                    raise ValueError(
                        f"{place}.{key}: nothing moves at the start with time.dynamics = 'static'; remove it"
                    )
        return self

    @model_validator(mode="after")
    def _check_theta(self) -> Self:
        """Refuse what is solved with implicit Euler alone."""
        others = [] if self.time.dynamics == "inertial" else [f"time.dynamics = '{self.time.dynamics}'"]
        for name, body in self.soft_bodies.items():
            others += [] if body.reduced is None else [f"soft_bodies.{name}.reduced"]
            others += [f"soft_bodies.{name}.cables.{key}.friction" for key, one in body.cables.items() if one.friction]
        if self.time.theta < 1.0 and others:
            raise ValueError(
                f"time.theta = {self.time.theta:g} must be 1, implicit Euler, with {others[0]}; leave one of them out"
            )
        stiff = next((name for name, body in self.soft_bodies.items() if body.membranes or body.fibres), None)
        if stiff is not None and self.time.theta < LEAST_THETA_OF_THREADS:
            raise ValueError(
                f"time.theta = {self.time.theta:g} must be at least {LEAST_THETA_OF_THREADS:g} with the membranes and "
                f"fibres of soft_bodies.{stiff}, which gain energy below"
            )
        return self

    @model_validator(mode="after")
    def _check_wrinkles(self) -> Self:
        for name, body in self.soft_bodies.items():
            for key, one in body.membranes.items():
                if one.tension_only and self.time.most_linearisations < LEAST_NEWTON_OF_WRINKLES:
                    raise ValueError(
                        f"time.newton = {self.time.newton} must be at least {LEAST_NEWTON_OF_WRINKLES} with "
                        f"soft_bodies.{name}.membranes.{key}.tension_only, better 10"
                    )
        return self

    @model_validator(mode="after")
    def _check_frames(self) -> Self:
        if BASE in self.frames:
            raise ValueError("frames.base: every scene has this frame; give base_pivot, limits.base_speed, and so on")
        springs = {f"{name}.springs": one.springs for name, one in self.rigid_bodies.items() if one.springs is not None}
        tables: dict[str, dict[str, Any]] = {
            "frames": dict(self.frames),
            "rigid_bodies": {**self.rigid_bodies, **springs},
            "soft_bodies": dict(self.soft_bodies),
        }
        for kind, members in tables.items():
            for name, table in members.items():
                if table.follows not in (None, BASE, *self.frames):
                    known = ", ".join([BASE, *self.frames])
                    raise ValueError(
                        f"{kind}.{name}.follows is '{table.follows}', which is not a frame; there are: {known}"
                    )
        for name in self.frames:
            above: list[str | None] = [name]
            while above[-1] in self.frames:
                above.append(self.frames[str(above[-1])].follows)
                if above[-1] == name:
                    raise ValueError(
                        f"frames.{name} carries itself: it follows {' which follows '.join(map(str, above[1:]))}"
                    )
        return self

    @model_validator(mode="after")
    def _check_names(self) -> Self:
        names = [*self.soft_bodies, *self.rigid_bodies, *self.obstacles]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"two bodies are called '{twice[0]}'; every body needs a name of its own")
        mentioned = {name: "contact.pairs" for pair in self.contact.pairs for name in pair.bodies}
        for body, table in self.soft_bodies.items():
            for cable, settings in table.cables.items():
                mentioned |= dict.fromkeys(settings.other_bodies, f"soft_bodies.{body}.cables.{cable}.points")
        for name, key in mentioned.items():
            if name not in names:
                raise ValueError(f"{key} names '{name}', which is not a body; there are: {', '.join(names)}")
        for pair in self.contact.pairs:
            name, other = pair.bodies
            if name == other and not (name in self.soft_bodies and self.soft_bodies[name].may_touch_itself):
                raise ValueError(
                    f"contact.pairs names '{name}' with itself; a body touches itself only where it is soft and has "
                    "self_contact or several collision surfaces, name two bodies"
                )
        rigid = {f"external_forces.{index}.body": push.body for index, push in enumerate(self.external_forces)}
        if self.goal is not None:
            rigid["goal.object"] = self.goal.object
        for key, name in rigid.items():
            if name not in self.rigid_bodies:
                known = ", ".join(self.rigid_bodies) or "none"
                raise ValueError(f"{key} is '{name}', which is not a rigid body; there are: {known}")
            if self.rigid_bodies[name].follows is not None:
                raise ValueError(f"{key} is '{name}', which follows a frame whatever acts on it; name another body")
        if not self.soft_bodies and not self.rigid_bodies:
            raise ValueError("a scene needs at least one soft body or rigid body")
        return self
