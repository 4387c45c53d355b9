"""What a controller sees, worked out from a state."""

import zlib
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from threading import Lock
from types import MappingProxyType
from typing import Any

import numpy as np

from taichisoft.base.rotations import rotation_from_vector
from taichisoft.contact.model import Model
from taichisoft.control.contact_patches import ContactPatches
from taichisoft.control.figures import BASE, BY_NAME, Figure, Pair
from taichisoft.control.kernels.tip_motion import observe_tips
from taichisoft.control.observation import LazyValues, Named, Observation
from taichisoft.control.requests import clipped, observed_frames
from taichisoft.errors import SceneError
from taichisoft.mechanics.actuator_kind import ActuatorFigure
from taichisoft.mechanics.cavities import CAVITIES
from taichisoft.mechanics.model_actuators import ACTUATOR_KINDS, ActuatorGeometry
from taichisoft.mechanics.rigid_body_arrays import MovingFrames
from taichisoft.mechanics.soft_body_arrays import SoftBody
from taichisoft.mechanics.state import State
from taichisoft.scene.scene import Scene
from taichisoft.scene.sensor_settings import SensorSettings, memory_size, samples_kept, sensed_names, sensed_sizes

# The tips of the fingers: where they are, how fast they move, and by how much the fingers bend.

# Of a finger without a `tip` in the scene: free nodes this far from the farthest one, as a share of its distance
# from the anchors, but at least so many that they can show a rotation.
TIP_SHARE = 0.05
FEWEST_NODES = 8


class Fingertips:
    """The tips of all soft bodies that have anchors or a `tip` of their own.

    Attributes:
        names: of the fingers.
        nodes: numbers of the nodes of each tip, a tuple of arrays.
    """

    def __init__(self, soft_bodies: tuple[SoftBody, ...], frames: MovingFrames):
        """Choose the nodes of each tip.

        Raises:
            SceneError: the nodes of a tip lie on a line, or are fewer than three.
        """
        fingers = [body for body in soft_bodies if body.tip_nodes is not None or body.anchored.any()]
        self.names = tuple(body.name for body in fingers)
        chosen = [body.tip_nodes if body.tip_nodes is not None else _farthest_nodes(body) for body in fingers]
        self._start = np.cumsum([0, *(len(nodes) for nodes in chosen)]).astype(np.int32)
        self.nodes = tuple(nodes + body.nodes.start for nodes, body in zip(chosen, fingers, strict=True))
        self._nodes = np.concatenate([*self.nodes, np.zeros(0)]).astype(np.intp)
        self._rest = np.vstack(
            [_centred(body.rest_position[nodes], body.name) for nodes, body in zip(chosen, fingers, strict=True)]
            or [np.zeros((0, 3))]
        )
        self._position, self._velocity = np.empty_like(self._rest), np.empty_like(self._rest)
        self._frames, self._frame = frames, frames.numbers(body.settings.follows for body in fingers)
        self._frame_turn = np.empty((len(fingers), 3, 3))
        self._mean_position, self._mean_velocity = np.empty((len(fingers), 3)), np.empty((len(fingers), 3))
        self._bending_angle = np.empty(len(fingers))

    def observe(self, state: State) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Positions [mm] and velocities [mm/s] of the tips, each (finger_count, 3), and bending angles [rad].

        A position or velocity is the mean of the tip's nodes. The bending angle, from 0 to pi, is by how much the tip
        has turned against the frame that the finger follows since the start; the tip's rotation is the best fit to its
        nodes in the sense of least squares (Kabsch 1976, A solution for the best rotation to relate two sets of
        vectors).
        """
        if self.names:
            np.take(state.position, self._nodes, axis=0, out=self._position, mode="clip")
            np.take(state.velocity, self._nodes, axis=0, out=self._velocity, mode="clip")
            self._frame_turn[:] = self._frames.places(state.frame_pose).turn[self._frame]
            observe_tips(
                self._start,
                self._rest,
                self._position,
                self._velocity,
                self._frame_turn,
                self._mean_position,
                self._mean_velocity,
                self._bending_angle,
            )
        return self._mean_position.copy(), self._mean_velocity.copy(), self._bending_angle.copy()


def _farthest_nodes(body: SoftBody) -> np.ndarray:
    held = body.anchored
    distance = np.linalg.norm(body.rest_position - body.rest_position[held].mean(axis=0), axis=1)
    distance[held] = 0.0
    farthest_first = np.argsort(-distance, kind="stable")
    count = np.count_nonzero(distance >= (1.0 - TIP_SHARE) * distance.max())
    return np.sort(farthest_first[: max(count, FEWEST_NODES)])


def _centred(position: np.ndarray, name: str) -> np.ndarray:
    """The positions less their mean; what lies on a line cannot show a rotation."""
    centred = position - position.mean(axis=0)
    extents = np.linalg.svd(centred, compute_uv=False)
    if len(position) < 3 or extents[1] <= 1e-6 * extents[0]:
        raise SceneError(
            f"soft_bodies.{name}.tip: selects {len(position)} nodes on a line; three or more that span a plane are "
            "needed to see it turn"
        )
    return centred


# The contacts of a state, summed up by pair of bodies.


def summarise_contacts(model: Model, state: State) -> dict[str, Mapping[Pair, Any]]:
    """The fields of an observation with counts, forces and sliding in the step that led to `state`."""
    if not len(state.contact_body_pair):
        return {name: MappingProxyType({}) for name in PARTS["contacts"]}
    forces = state.contact_impulse / model.scene.time.step
    along = np.einsum("cd,cd->c", forces, state.contact_normal)
    across = np.linalg.norm(forces - along[:, None] * state.contact_normal, axis=1)
    slip_speeds = np.linalg.norm(state.contact_slip, axis=1)
    order = np.lexsort(state.contact_body_pair.T[::-1])
    body_pair = state.contact_body_pair[order]
    start = np.flatnonzero(np.diff(body_pair, axis=0, prepend=-1).any(axis=1))
    names = [(model.body_names[first], model.body_names[second]) for first, second in body_pair[start]]
    return {
        "contact_counts": _numbers(names, np.add.reduceat(along[order] > 0.0, start, dtype=np.int64)),
        "contact_points": _by_pair(names, state.contact_point[order], start),
        "contact_forces": _by_pair(names, forces[order], start),
        "normal_forces": _numbers(names, np.add.reduceat(along[order], start)),
        "friction_forces": _numbers(names, np.add.reduceat(across[order], start)),
        "slip_speeds": _numbers(names, np.maximum.reduceat(slip_speeds[order], start)),
    }


def _by_pair(names: list[Pair], rows: np.ndarray, start: np.ndarray) -> dict[Pair, np.ndarray]:
    """The rows of each pair, which stand together from `start` on."""
    ends = [*start[1:].tolist(), len(rows)]  # np.split takes three times as long
    return {name: rows[first:end] for name, first, end in zip(names, start.tolist(), ends, strict=True)}


# Sensors between a simulation and who sees it: sampling, bias, noise, rounding, losses and delay.
#
# Bias, noise and losses are drawn by a counter-based generator (Philox: Salmon, Moraes, Dror, Shaw 2011, Parallel
# random numbers: as easy as 1, 2, 3), whose counter is the number of the sample: what a sensor remembers are its
# samples, and a state that holds these goes on with the same bits.

IN_BASE = {"base_force": "base_force_in_base", "base_torque": "base_torque_in_base"}
"""A wrist sensor turns with the base; what it shows in world axes follows."""
MEASURED = {
    **IN_BASE,
    "cable_pull": "pull",
    "cable_tension": "tension",
    "object_position": "position",
    "valve_opening": "valve",
}
"""Figures by the names of their sensors, where these differ."""


class SensorChain:
    """The sensor of some numbers, which are sampled at the same times."""

    def __init__(self, settings: SensorSettings, time_step: float, size: int, name: str):
        """Prepare a sensor.

        Args:
            settings: what it does.
            time_step: time between two values that it is given, in the unit of `settings.period` and `delay`.
            size: number of numbers.
            name: name, which makes its random numbers differ from those of others.
        """
        self._settings, self._size, self._name = settings, size, zlib.crc32(name.encode())
        self._period = max(1, round(settings.period / time_step))
        self._delay = round(settings.delay / time_step)
        self.shape = (samples_kept(settings, time_step), size)

    def begin(self, values: np.ndarray, step: int, seed: int) -> np.ndarray:
        """Samples of a sensor that has seen values [unit of the quantity], shape (size,), for ever, shape `shape`."""
        return np.tile(self._sample(values, values, step, seed, may_drop=False), (self.shape[0], 1))

    def after(self, samples: np.ndarray, values: np.ndarray, step: int, seed: int) -> np.ndarray:
        """Samples when the values have come to be `values` at a step."""
        if step % self._period:
            return samples
        return np.vstack([samples[1:], self._sample(values, samples[-1], step, seed, may_drop=True)])

    def reading(self, samples: np.ndarray, step: int) -> np.ndarray:
        """What the sensor shows at a step, shape (size,)."""
        age = step // self._period - (step - self._delay) // self._period
        shown: np.ndarray = samples[-1 - age]
        return shown

    def _sample(self, values: np.ndarray, before: np.ndarray, step: int, seed: int, may_drop: bool) -> np.ndarray:
        settings, sample = self._settings, values
        if settings.bias:
            sample = sample + self._random(seed, 0, 1).uniform(-settings.bias, settings.bias, self._size)
        if settings.noise:
            sample = sample + settings.noise * self._random(seed, step, 2).standard_normal(self._size)
        if settings.resolution:
            sample = settings.resolution * np.rint(sample / settings.resolution)
        if settings.dropout and may_drop:
            is_lost = self._random(seed, step, 3).random(self._size) < settings.dropout
            sample = np.where(is_lost, before, sample)
        return sample

    def _random(self, seed: int, step: int, purpose: int) -> np.random.Generator:
        key = np.array([(self._settings.seed << 32) | seed, self._name], np.uint64)
        return np.random.Generator(np.random.Philox(key=key, counter=np.array([0, 0, step, purpose], np.uint64)))


class Sensors:
    """All sensors of a scene; what they remember is `State.sensor_memory`."""

    def __init__(self, scene: Scene):
        """Lay out the memory."""
        self._size = memory_size(scene)
        self._chains: list[tuple[str, Figure, list[Any], np.ndarray, SensorChain]] = []
        for name, settings in scene.sensors.items():
            sizes = sensed_sizes(scene, name)
            chain = SensorChain(settings, scene.time.step, sum(sizes), name)
            figure = BY_NAME[MEASURED.get(name, name)]
            self._chains.append((name, figure, sensed_names(scene, name), np.cumsum(sizes)[:-1], chain))

    def begin(self, memory: np.ndarray, truth: Observation) -> np.ndarray:
        """The memory with samples of a first observation; unchanged where it has those of these sensors already."""
        if not self._chains or (len(memory) == self._size and memory[1]):
            return memory
        memory = memory if len(memory) == self._size else np.zeros(self._size)
        seed = int(memory[0])
        parts = [
            chain.begin(_values(truth, figure, names), truth.step, seed) for _, figure, names, _, chain in self._chains
        ]
        return np.concatenate([[memory[0], 1.0], *(part.ravel() for part in parts)])

    def after(self, memory: np.ndarray, truth: Observation) -> np.ndarray:
        """The memory after a step that led to an exact observation."""
        seed = int(memory[0])
        parts = [
            chain.after(samples, _values(truth, figure, names), truth.step, seed)
            for (_, figure, names, _, chain), samples in zip(self._chains, self._split(memory), strict=True)
        ]
        return np.concatenate([memory[:2], *(part.ravel() for part in parts)])

    def readings(self, memory: np.ndarray, truth: Observation) -> dict[str, Any]:
        """Fields of an observation as the sensors show them."""
        fields: dict[str, Any] = {}
        for (sensor, figure, names, ends, chain), samples in zip(self._chains, self._split(memory), strict=True):
            shown, exact = chain.reading(samples, truth.step), figure.values(truth)
            if figure.per is BASE:
                fields[figure.field] = shown.copy()
                if sensor in IN_BASE:
                    fields[sensor] = rotation_from_vector(truth.base_rotation) @ shown
                continue
            values = {
                name: part.reshape(np.shape(exact[name])) if isinstance(exact.get(name), np.ndarray) else float(part[0])
                for name, part in zip(names, np.split(shown, ends), strict=True)
            }
            fields[figure.field] = MappingProxyType(values)
        return fields

    def _split(self, memory: np.ndarray) -> list[np.ndarray]:
        sizes = [int(np.prod(chain.shape)) for *_, chain in self._chains]
        parts = np.split(memory[2:], np.cumsum(sizes)[:-1])
        return [part.reshape(chain.shape) for part, (*_, chain) in zip(parts, self._chains, strict=True)]


def _values(truth: Observation, figure: Figure, names: Sequence[Any]) -> np.ndarray:
    """The numbers of a figure in the order of the names; 0 of a pair that is far apart."""
    exact = figure.values(truth)
    return np.concatenate([np.ravel(exact.get(name, 0.0)) for name in names])


PARTS = {
    "tips": ("tip_positions", "tip_velocities", "bending_angles"),
    "objects": tuple(f"object_{kind}" for kind in ("positions", "rotations", "velocities", "angular_velocities")),
    "contacts": (
        *("contact_counts", "contact_points", "contact_forces"),
        *("normal_forces", "friction_forces", "slip_speeds"),
    ),
    "patches": ("contact_areas", "contact_area_errors", "peak_pressures", "peak_pressure_errors"),
    "tactile": ("tactile",),
    "external": ("external_forces",),
    "clipped": ("clipped",),
    "rates": tuple(kind.rate.observed for kind in ACTUATOR_KINDS if kind.rate is not None),
}
"""Fields that are worked out together, by the part of an observation; all others are those of actuators and frames."""
PART_OF = {name: part for part, names in PARTS.items() for name in names}


class Observer:
    """Makes observations of a model's states; they depend on the state alone, so that a restored run is seen alike.

    Displays and pages observe from threads of their own while the simulation steps: the work space is the observer's,
    and one thread at a time uses it.
    """

    def __init__(self, model: Model):
        """Find the fingertips.

        Raises:
            SceneError: a tip cannot show a rotation, or a tactile array lies beside the surface of its body.
        """
        self._model = model
        self._geometry = ActuatorGeometry(model.actuators, model.node_count)
        self._fingertips = Fingertips(model.soft_bodies, model.frames)
        self._object_names = tuple(body.name for body in model.rigid_bodies)
        self._contact_patches, self._sensors = ContactPatches(model), Sensors(model.scene)
        self._contact_patches.check_tactile_arrays()
        self.look: Callable[[State, str], Any] | None = None
        self._working = Lock()
        self._last: tuple[State, dict[str, dict[str, Any]]] | None = None

    def observe(self, state: State) -> Observation:
        """What a controller sees before the step that follows `state`, through the scene's sensors."""
        truth = self.truth(state)
        if not self._model.scene.sensors:
            return truth
        shown = self._sensors.readings(self._sensors.begin(state.sensor_memory, truth), truth)
        return _made_up({**vars(truth), **shown, "exact": truth})

    def truth(self, state: State) -> Observation:
        """The exact observation of a state; each part is worked out once, when somebody looks, and copied."""
        cameras = {} if self.look is None else LazyValues(self._model.scene.cameras, partial(self.look, state))
        period, work_out = self._model.control_period, partial(self._work_out, state)
        known = {"time": state.time, "step": state.step, "control_period": period, "exact": None, "state": state}
        return _made_up({**known, "cameras": cameras, "_work_out": work_out})

    def with_samples(self, state: State, start: State | None = None) -> State:
        """The state with what its sensors remember: from the one before the step, or as they begin without one."""
        if not self._model.scene.sensors:
            return state
        truth = self.truth(state)
        if start is None:
            return state.changed(sensor_memory=self._sensors.begin(state.sensor_memory, truth))
        return state.changed(sensor_memory=self._sensors.after(start.sensor_memory, truth))

    def _work_out(self, state: State, name: str) -> dict[str, Any]:
        """A field of an observation, with those of its part; arrays are the caller's own, who may write to them."""
        part = PART_OF.get(name, "frames" if name.startswith(("base_", "frame_")) else "actuators")
        with self._working:
            if self._last is None or self._last[0] is not state:
                self._last = state, {}
            known = self._last[1]
            if part not in known:
                known[part] = _WORK[part](self, state)
            return {name: _own(value) for name, value in known[part].items()}

    def _tips(self, state: State) -> dict[str, Any]:
        tips = self._fingertips
        positions, velocities, angles = tips.observe(state)
        return {
            "tip_positions": _by_name(tips.names, positions),
            "tip_velocities": _by_name(tips.names, velocities),
            "bending_angles": _numbers(tips.names, angles),
        }

    def _frames(self, state: State) -> dict[str, Any]:
        return observed_frames(self._model, state)

    def _objects(self, state: State) -> dict[str, Any]:
        return {
            "object_positions": _by_name(self._object_names, state.rigid_position),
            "object_rotations": _by_name(self._object_names, state.rigid_rotation),
            "object_velocities": _by_name(self._object_names, state.rigid_velocity),
            "object_angular_velocities": _by_name(self._object_names, state.rigid_angular_velocity),
        }

    def _contacts(self, state: State) -> dict[str, Any]:
        return summarise_contacts(self._model, state)

    def _patches(self, state: State) -> dict[str, Any]:
        patches = self._contact_patches.patches(state)
        figures = zip(PARTS["patches"], ("area", "area_error", "peak", "peak_error"), strict=True)
        return {
            name: MappingProxyType({pair: getattr(patch, figure) for pair, patch in patches.items()})
            for name, figure in figures
        }

    def _tactile(self, state: State) -> dict[str, Any]:
        return {"tactile": self._contact_patches.tactile(state) if self._model.scene.tactile_arrays else {}}

    def _external(self, state: State) -> dict[str, Any]:
        external = self._model.external_forces
        return {"external_forces": _by_name(external.names, external.seen(state))}

    def _clipped(self, state: State) -> dict[str, Any]:
        return {"clipped": clipped(self._model, state)}

    def _actuators(self, state: State) -> dict[str, Any]:
        """The fields of an observation that say how actuators are."""
        actuators = self._model.actuators
        coordinates, found = actuators.own_coordinates(state), {}
        for kind in ACTUATOR_KINDS:
            names = actuators.names_of(kind)
            figures: list[tuple[ActuatorFigure, np.ndarray]] = [
                (kind.effort, state.actuator_effort),
                (kind.coordinate, coordinates),
                (kind.value, state.actuator_value),
            ]
            for figure, values in figures:
                if figure.observed:
                    found[figure.observed] = _numbers(names, actuators.of(kind, values))
            for further in kind.figures:
                found[further.observed] = _numbers(names, getattr(state, further.field))
        air, openings = self._model.scene.air, state.network_drive[: len(self._model.scene.air.valves)]
        found["network_pressures"] = _numbers(air.nodes, state.network_pressure)
        found["network_flows"] = _numbers(tuple(air.parts), state.network_flow)
        found["network_openings"] = _numbers(tuple(air.valves), openings)
        found["pressure_targets"] = self._pressure_targets(state)
        return found

    def _pressure_targets(self, state: State) -> Mapping[str, float]:
        actuators = self._model.actuators
        is_driven = actuators.takes_effort & ~state.actuator_imposed
        targets = zip(self._model.cavities.names, actuators.of(CAVITIES, state.actuator_target).tolist(), strict=True)
        driven = actuators.of(CAVITIES, is_driven).tolist()
        return MappingProxyType(Named(one for one, is_one in zip(targets, driven, strict=True) if is_one))

    def _rates(self, state: State) -> dict[str, Any]:
        """Rates of the actuators' values [mm^3/s] or [mm/s], of the kinds that show them."""
        model, actuators = self._model, self._model.actuators
        self._geometry.update(state, model.placed_pull_points(state))
        rigid_velocity = np.concatenate([state.rigid_velocity, state.rigid_angular_velocity], axis=1)
        rates = self._geometry.rates(state.velocity, rigid_velocity)
        rates = actuators.sign * rates[actuators.first_coordinate[:-1]]
        shown = [(kind, kind.rate) for kind in ACTUATOR_KINDS if kind.rate is not None]
        return {rate.observed: _numbers(actuators.names_of(kind), actuators.of(kind, rates)) for kind, rate in shown}


_WORK: dict[str, Callable[[Observer, State], dict[str, Any]]] = {
    "tips": Observer._tips,
    "frames": Observer._frames,
    "objects": Observer._objects,
    "contacts": Observer._contacts,
    "patches": Observer._patches,
    "tactile": Observer._tactile,
    "external": Observer._external,
    "clipped": Observer._clipped,
    "actuators": Observer._actuators,
    "rates": Observer._rates,
}
"""What works out each part."""


def _made_up(known: dict[str, Any]) -> Observation:
    """An observation that works out all fields but those that are known when somebody looks at them."""
    seen = object.__new__(Observation)
    vars(seen).update(known)
    return seen


def _own(value: Any) -> Any:
    """A copy with arrays of its own: compiled functions, such as scipy's of rotations, need writable ones."""
    if isinstance(value, dict):
        return MappingProxyType(Named({key: one.copy() for key, one in value.items()}))
    return value.copy() if isinstance(value, np.ndarray) else value


def _by_name(names: tuple[str, ...], values: np.ndarray) -> Mapping[str, np.ndarray]:
    return dict(zip(names, values, strict=True))


def _numbers(names: Sequence[Any], values: np.ndarray) -> Mapping[Any, Any]:
    return MappingProxyType(Named(zip(names, values.tolist(), strict=True)))
