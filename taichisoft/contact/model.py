"""The model: constant data of a run, made once from a scene."""

import copy
import dataclasses
import math
from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from taichisoft.base.plausible import SIZE, likely_unit
from taichisoft.base.rotations import matrices_from_quaternions
from taichisoft.contact.overlap import refuse_overlap
from taichisoft.contact.surfaces import ContactSurfaces, MovingSurfaces
from taichisoft.errors import SceneError, StateError, nearest
from taichisoft.mechanics.cables import CABLES, Cables
from taichisoft.mechanics.cavities import CAVITIES, Cavities
from taichisoft.mechanics.elasticity import Elasticity
from taichisoft.mechanics.external_forces import ExternalForces
from taichisoft.mechanics.model_actuators import Actuators
from taichisoft.mechanics.rigid_body_arrays import FramePlaces, MovingFrames, RigidBody, make_obstacle, make_rigid_body
from taichisoft.mechanics.soft_body_arrays import SoftBody, make_soft_body
from taichisoft.mechanics.state import State
from taichisoft.mesh.volume_mesh import VolumeMesh
from taichisoft.scene.scene import Scene
from taichisoft.scene.sensor_settings import memory_size
from taichisoft.scene.table import short_text


class Model:
    """Constant data of a run in read-only arrays: bodies, elements, surfaces.

    Bodies are numbered: soft bodies, then rigid bodies, then obstacles, each in the scene's order.

    Attributes:
        scene: scene of which the model was made.
        soft_bodies: soft bodies in the scene's order.
        rigid_bodies: rigid bodies in the scene's order.
        obstacles: obstacles in the scene's order.
        body_names: names by body number.
        rest_position: rest positions of the soft nodes [mm], shape (node_count, 3).
        elasticity: elements of all soft bodies and the pattern of their matrix; None without soft bodies.
        material_names: names of the soft bodies' materials, as in `scene.young_moduli`.
        young_modulus: Young's moduli of the materials at the start of a run [kPa], shape (material_count,).
        element_material: number of the material of each element, shape (element_count,).
        anchored_nodes: indices of the anchored nodes in rising order, shape (anchor_count,).
        anchor_frame: number of the frame that each of them moves with, shape (anchor_count,).
        actuators: actuators of all kinds; `actuators.of` gives the part of a kind in arrays of a state.
        surfaces: contact surfaces of all bodies.
        friction: friction coefficients by the numbers of two bodies, shape (body_count, body_count).
        restitution: coefficients of restitution likewise.
        rolling_friction, spinning_friction: lengths of rolling and spinning friction likewise [mm], 0 for soft bodies.
        frames: what moves as it is asked to, the base first.
        external_forces: what forces from outside act on, and where those of a state do.
        soft_frame: number of the frame that each soft body follows, shape (soft_count,).
        rigid_frame: number of the frame that carries each rigid body, -1 where none does, shape (rigid_count,).
        rigid_mass: masses of the rigid bodies [kg], shape (rigid_count,).
        rigid_inertia: inertias of the rigid bodies in their own frames [kg mm^2], shape (rigid_count, 3, 3).
        gravity: acceleration of gravity at the start of a run [mm/s^2], shape (3,).
    """

    def __init__(self, scene: Scene, meshes: Mapping[str, VolumeMesh]):
        """Make the arrays; surfaces named in the scene are read from their files.

        Args:
            scene: scene to simulate.
            meshes: meshes of the soft bodies by name, which become read-only; `taichisoft.make_model` loads them.

        Raises:
            MeshError: a surface cannot be read, or cannot be simulated.
            SceneError: the scene does not fit its meshes, or bodies overlap at the start.
        """
        self.scene = scene
        self.material_names = tuple(scene.young_moduli)
        self.young_modulus = np.array(list(scene.young_moduli.values()))
        soft: list[SoftBody] = []
        node_count = 0
        for name, body in scene.soft_bodies.items():
            first_material = self.material_names.index(name)
            soft.append(make_soft_body(name, body, meshes[name], node_count, first_material))
            node_count = soft[-1].nodes.stop
        self.soft_bodies = tuple(soft)
        self.rigid_bodies = tuple(make_rigid_body(name, body) for name, body in scene.rigid_bodies.items())
        self.obstacles = tuple(make_obstacle(name, obstacle) for name, obstacle in scene.obstacles.items())
        self.body_names = (*scene.soft_bodies, *scene.rigid_bodies, *scene.obstacles)
        self.rest_position = np.vstack([np.zeros((0, 3)), *(body.rest_position for body in soft)])
        self.elasticity = Elasticity(soft, scene.time) if soft else None
        self.element_material = np.concatenate([np.zeros(0, dtype=np.int32), *(body.material for body in soft)])
        held = [body.nodes.start + np.flatnonzero(body.anchored) for body in soft]
        self.anchored_nodes = np.concatenate([*held, np.zeros(0)]).astype(np.int32)
        self.actuators = Actuators(scene, soft, self.rigid_bodies, self.obstacles)
        self.surfaces = ContactSurfaces(soft, self.rigid_bodies, self.obstacles)
        self._refuse_bodies_within_contact_distance()
        self.friction = self._pair_table("friction")
        self.restitution = self._pair_table("restitution")
        self.rolling_friction = self._moment_table("rolling_friction")
        self.spinning_friction = self._moment_table("spinning_friction")
        self.frames = self._make_frames()
        self.anchor_frame = self.frames.numbers(name for body in soft for name in body.anchor_frame[body.anchored])
        self.soft_frame = self.frames.numbers(body.settings.follows for body in soft)
        self.rigid_frame = self.frames.numbers(body.follows for body in self.rigid_bodies)
        self.external_forces = ExternalForces(scene, self.soft_bodies, self.rigid_bodies, self.frames)
        self.rigid_mass = np.array([body.mass for body in self.rigid_bodies])
        self.rigid_inertia = np.array([body.inertia for body in self.rigid_bodies]).reshape(-1, 3, 3)
        self.gravity = np.array(scene.gravity)
        rotation = np.array([body.start_rotation for body in self.rigid_bodies]).reshape(-1, 4)
        position = np.array([body.start_position for body in self.rigid_bodies]).reshape(-1, 3)
        moving = MovingSurfaces(self.surfaces)
        moving.update(self.rest_position, position, matrices_from_quaternions(rotation))
        refuse_overlap(self.surfaces, moving, self.body_names)
        _make_read_only(self)

    def initial_state(self) -> State:
        """The state that the scene describes."""
        bodies = self.rigid_bodies
        velocities = [np.tile(b.settings.velocity, (len(b.rest_position), 1)) for b in self.soft_bodies]
        actuators, count = self.actuators, len(self.actuators.names)
        at_rest = np.zeros((len(self.frames.names), 2, 3))
        pushed = len(self.external_forces.names)
        return State(
            time=0.0,
            step=0,
            position=self.rest_position.copy(),
            velocity=np.vstack([np.zeros((0, 3)), *velocities]),
            rigid_position=np.array([b.start_position for b in bodies]).reshape(-1, 3),
            rigid_rotation=np.array([b.start_rotation for b in bodies]).reshape(-1, 4),
            rigid_velocity=np.array([b.start_velocity for b in bodies]).reshape(-1, 3),
            rigid_angular_velocity=np.array([b.start_angular_velocity for b in bodies]).reshape(-1, 3),
            frame_pose=at_rest,
            frame_request=at_rest.copy(),
            frame_velocity=at_rest.copy(),
            frame_wrench=at_rest.copy(),
            external_force=np.zeros((pushed, 3, 3)),
            external_force_steps=np.zeros(pushed, dtype=np.int32),
            external_force_own_axes=np.zeros(pushed, dtype=bool),
            anchor_position=self.rest_position[self.anchored_nodes],
            gravity=self.gravity.copy(),
            young_modulus=self.young_modulus.copy(),
            actuator_imposed=np.zeros(count, dtype=bool),
            actuator_request=np.zeros(count),
            actuator_target=np.zeros(count),
            actuator_effort=actuators.rest_effort.copy(),
            actuator_value=actuators.rest_value.copy(),
            actuator_loss=np.zeros(actuators.count - count),
            **actuators.start(),
            sensor_memory=np.zeros(memory_size(self.scene)),
            contact_body_pair=np.zeros((0, 2), dtype=np.int32),
            contact_point=np.zeros((0, 3)),
            contact_normal=np.zeros((0, 3)),
            contact_impulse=np.zeros((0, 3)),
            contact_slip=np.zeros((0, 3)),
        )

    def varied(self, friction: float | None = None, masses: Mapping[str, float] | None = None) -> "Model":
        """Make a variant with other friction or masses, which shares everything else with this model.

        A variant takes well under a millisecond, a simulation of it some milliseconds; one simulation can also switch
        between variants, see `Simulation.change_model`.

        Args:
            friction: Coulomb's coefficient [-] of all pairs of bodies but those in the scene's `contact.pairs`.
            masses: masses [kg] by rigid body; a body's inertia changes in proportion.

        Raises:
            SceneError: no rigid body has this name, or a value is not valid.
        """
        masses = masses or {}
        names = [body.name for body in self.rigid_bodies]
        for name, mass in masses.items():
            if name not in names:
                raise SceneError(f"masses: no rigid body is called '{name}'; {nearest(name, names, 'there are')}")
            if (carrier := self.rigid_bodies[names.index(name)].follows) is not None:
                raise SceneError(f"masses: '{name}' follows the frame '{carrier}' and has no mass")
            if not 0.0 < mass < math.inf:
                raise SceneError(f"masses['{name}'] = {mass!r}: must be above 0")
        if friction is not None and not 0.0 <= friction < math.inf:
            raise SceneError(f"friction = {friction!r}: must be 0 or more")
        other = copy.copy(self)
        other.rigid_bodies = tuple(_with_mass(body, masses.get(body.name, body.mass)) for body in self.rigid_bodies)
        other.rigid_mass = np.array([body.mass for body in other.rigid_bodies])
        other.rigid_inertia = np.array([body.inertia for body in other.rigid_bodies]).reshape(-1, 3, 3)
        other.scene = _varied_scene(self.scene, friction, {body.name: body for body in other.rigid_bodies}, masses)
        other.friction = other._pair_table("friction")
        for array in (other.rigid_mass, other.rigid_inertia, other.friction):
            array.setflags(write=False)
        return other

    def static(self) -> "Model":
        """Make a variant whose steps are equilibria, whatever rates the scene limits; see `taichisoft.equilibrium`.

        Raises:
            SceneError: a soft body has no anchors.
        """
        names = [name for name in type(self.scene.limits).model_fields if name.endswith(("_rate", "_speed"))]
        limits = self.scene.limits.model_copy(update=dict.fromkeys(names))
        time = self.scene.time.model_copy(update={"dynamics": "static", "theta": 1.0})
        other = copy.copy(self)
        free = dict.fromkeys(("speed", "turning_speed", "path"))  # on a path it stays where it is now
        frames = {name: one.model_copy(update=free) for name, one in self.scene.frames.items()}
        other.scene = self.scene.model_copy(update={"time": time, "limits": limits, "frames": frames})
        for body in _loose(self.soft_bodies):
            raise SceneError(f"an equilibrium needs anchors of every soft body; '{body.name}' has none")
        if self.soft_bodies:
            other.elasticity = Elasticity(list(self.soft_bodies), time)
            _make_read_only(other.elasticity)
        return other

    def placed_pull_points(self, state: State) -> np.ndarray:
        """Positions of the cables' pull points, moved with their frames [mm], shape (cable_count, 3)."""
        if self._pull_points_stay:
            return state.pull_point
        frame = self.cables.pull_point_frame
        places = self.places(state)
        moved = np.einsum("cij,cj->ci", places.turn[frame], state.pull_point) + places.shift[frame]
        return np.where(frame[:, None] >= 0, moved, state.pull_point)

    @cached_property
    def _pull_points_stay(self) -> bool:
        return bool((self.cables.pull_point_frame < 0).all())

    def places(self, state: State) -> FramePlaces:
        """Where the frames are in a state."""
        return self.frames.places(state.frame_pose)

    @property
    def base_pivot(self) -> np.ndarray:
        """Point about which the base turns [mm], shape (3,)."""
        pivot: np.ndarray = self.frames.pivot[0]
        return pivot

    def check(self, state: State) -> None:
        """Refuse a state of another model, with other array shapes or another time step.

        Raises:
            StateError: the state belongs to another model, is not a state, or has a value that is not finite.
        """
        if not isinstance(state, State):
            raise StateError(f"{short_text(state)}: must be a taichisoft.State")
        problem = state.problem()
        if problem:
            raise StateError(f"the state cannot be simulated: {problem}")
        time_step = self.scene.time.step
        if abs(state.time - state.step * time_step) > 1e-6 * time_step:
            raise StateError(
                f"the state belongs to another model: {state.step} steps took {state.time:g} s, the model's time step "
                f"is {time_step:g} s"
            )
        for name, expected in self._state_shapes.items():
            shape = np.shape(getattr(state, name))
            if shape != expected:
                raise StateError(
                    f"the state belongs to another model: its {name} has shape {shape}, the model's {expected}"
                )

    @cached_property
    def _state_shapes(self) -> dict[str, tuple[int, ...]]:
        """Shapes of the arrays of a state, except contacts, whose number varies, and sensors, which can begin anew."""
        names = [
            field.name for field in dataclasses.fields(State) if not field.name.startswith(("contact_", "sensor_"))
        ]
        initial = self.initial_state()
        return {name: np.shape(getattr(initial, name)) for name in names}

    @property
    def cavities(self) -> Cavities:
        """The cavities of all soft bodies; `cavities.names` are their names."""
        found = self.actuators.sets[CAVITIES.name]
        assert isinstance(found, Cavities)
        return found

    @property
    def cables(self) -> Cables:
        """The cables of all soft bodies; `cables.names` are their names."""
        found = self.actuators.sets[CABLES.name]
        assert isinstance(found, Cables)
        return found

    @property
    def node_count(self) -> int:
        """Number of soft nodes."""
        return len(self.rest_position)

    @property
    def control_period(self) -> float:
        """Time between two calls of the controller [s]."""
        return self.scene.steps_per_control * self.scene.time.step

    def body_of_node(self, node: int) -> str:
        """Name of the soft body that has a node."""
        return next(body.name for body in self.soft_bodies if body.nodes.start <= node < body.nodes.stop)

    def _refuse_bodies_within_contact_distance(self) -> None:
        """Raise SceneError if a body is smaller than the contact distance."""
        distance = self.scene.contact.contact_distance
        size = np.where(self.surfaces.may_touch.any(axis=1), self.surfaces.body_size, np.inf)
        if distance > size.min():
            meant = likely_unit(size.min(), SIZE) if size.min() < SIZE.lowest else ""
            raise SceneError(
                f"contact.contact_distance = {distance:g} mm is larger than '{self.body_names[size.argmin()]}', which "
                f"measures {size.min():.3g} mm at its thinnest; it must be smaller, such as {0.1 * size.min():.2g} mm"
                f"{meant and '; ' + meant}"
            )

    def _pair_table(self, key: str) -> np.ndarray:
        """Values of `key` for each pair of bodies, shape (body_count, body_count)."""
        table = np.full((len(self.body_names), len(self.body_names)), getattr(self.scene.contact, key))
        for pair in self.scene.contact.pairs:
            first, second = (self.body_names.index(name) for name in pair.bodies)
            if getattr(pair, key) is not None:
                table[first, second] = table[second, first] = getattr(pair, key)
        return table

    def _moment_table(self, key: str) -> np.ndarray:
        """As `_pair_table`, for rigid bodies and obstacles only: a point of a soft body cannot carry a moment.

        Raises:
            SceneError: a pair with a soft body has a length.
        """
        soft = self.body_names[: len(self.soft_bodies)]
        for index, pair in enumerate(self.scene.contact.pairs):
            named = [name for name in pair.bodies if name in soft]
            if getattr(pair, key) and named:
                raise SceneError(
                    f"contact.pairs[{index}].{key} = {getattr(pair, key):g}: '{named[0]}' is a soft body and resists "
                    "by its own deformation; name two rigid bodies, or a rigid body and an obstacle"
                )
        table = self._pair_table(key)
        table[: len(soft)] = table[:, : len(soft)] = 0.0
        table[~self.surfaces.may_touch] = 0.0  # no rows of moments for bodies that cannot touch
        return table

    def _make_frames(self) -> MovingFrames:
        tables = self.scene.all_frames
        names, pivots = tuple(tables), []
        for name, table in tables.items():
            anchors = [body.rest_position[body.anchor_frame == name] for body in self.soft_bodies]
            held = np.vstack([np.zeros((0, 3)), *anchors])
            mean = held.mean(axis=0) if len(held) else np.zeros(3)
            pivots.append(mean if table.pivot is None else np.array(table.pivot))
        above = [-1 if table.follows is None else names.index(table.follows) for table in tables.values()]
        return MovingFrames(names, np.array(above, dtype=np.int32), np.array(pivots, dtype=np.float64))


def _loose(bodies: tuple[SoftBody, ...]) -> list[SoftBody]:
    return [body for body in bodies if not body.anchored.any()]


def _with_mass(body: RigidBody, mass: float) -> RigidBody:
    if mass == body.mass:
        return body
    inertia = body.inertia * (mass / body.mass)
    inertia.setflags(write=False)
    return replace(body, mass=mass, inertia=inertia)


def _varied_scene(
    scene: Scene, friction: float | None, bodies: Mapping[str, RigidBody], masses: Mapping[str, float]
) -> Scene:
    """The scene that describes a varied model."""
    changes: dict[str, Any] = {}
    if friction is not None:
        changes["contact"] = scene.contact.model_copy(update={"friction": friction})
    if masses:
        tables = dict(scene.rigid_bodies)
        for name, mass in masses.items():
            body_changes: dict[str, Any] = {"mass": mass, "density": None}
            if tables[name].inertia is not None:
                body_changes["inertia"] = tuple(map(tuple, bodies[name].inertia.tolist()))
            tables[name] = tables[name].model_copy(update=body_changes)
        changes["rigid_bodies"] = tables
    return scene.model_copy(update=changes)


def _make_read_only(part: Any) -> None:
    """Make every array in a part of a model read-only, because simulations and derived data share it."""
    if isinstance(part, np.ndarray):
        part.setflags(write=False)
    elif isinstance(part, tuple | list | Mapping):
        for inner in part.values() if isinstance(part, Mapping) else part:
            _make_read_only(inner)
    elif hasattr(part, "__dict__"):
        _make_read_only(vars(part))
