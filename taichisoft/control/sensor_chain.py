"""Sensors between a simulation and who sees it: sampling, bias, noise, rounding, losses and delay.

Bias, noise and losses are drawn by a counter-based generator (Philox: Salmon, Moraes, Dror, Shaw 2011, Parallel random
numbers: as easy as 1, 2, 3), whose counter is the number of the sample: what a sensor remembers are its samples, and a
state that holds these goes on with the same bits.
"""

import zlib
from collections.abc import Sequence
from types import MappingProxyType
from typing import Any

import numpy as np

from taichisoft.bodies.rotations import rotation_from_vector
from taichisoft.control.observation import Observation
from taichisoft.scenes.scene import Scene
from taichisoft.scenes.sensor_settings import SensorSettings, memory_size, samples_kept, sensed_names, sensed_sizes

PLURALS = {"air_mass": "air_masses", "tactile": "tactile", "contact_area": "contact_areas"}
IN_BASE = {"base_force": "base_force_in_base", "base_torque": "base_torque_in_base"}
"""Fields that follow from the measured one: a wrist sensor turns with the base."""


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
        self._chains: list[tuple[str, list[Any], np.ndarray, SensorChain]] = []
        for name, settings in scene.sensors.items():
            sizes = sensed_sizes(scene, name)
            chain = SensorChain(settings, scene.time.step, sum(sizes), name)
            field = name if name.startswith("base_") else PLURALS.get(name, f"{name}s")
            self._chains.append((field, sensed_names(scene, name), np.cumsum(sizes)[:-1], chain))

    def begin(self, memory: np.ndarray, truth: Observation) -> np.ndarray:
        """The memory with samples of a first observation; unchanged where it has those of these sensors already."""
        if not self._chains or (len(memory) == self._size and memory[1]):
            return memory
        memory = memory if len(memory) == self._size else np.zeros(self._size)
        seed = int(memory[0])
        parts = [
            chain.begin(_values(truth, field, names, chain.shape[1]), truth.step, seed)
            for field, names, _, chain in self._chains
        ]
        return np.concatenate([[memory[0], 1.0], *(part.ravel() for part in parts)])

    def after(self, memory: np.ndarray, truth: Observation) -> np.ndarray:
        """The memory after a step that led to an exact observation."""
        seed = int(memory[0])
        parts = [
            chain.after(samples, _values(truth, field, names, chain.shape[1]), truth.step, seed)
            for (field, names, _, chain), samples in zip(self._chains, self._split(memory), strict=True)
        ]
        return np.concatenate([memory[:2], *(part.ravel() for part in parts)])

    def readings(self, memory: np.ndarray, truth: Observation) -> dict[str, Any]:
        """Fields of an observation as the sensors show them."""
        fields: dict[str, Any] = {}
        for (field, names, ends, chain), samples in zip(self._chains, self._split(memory), strict=True):
            shown = chain.reading(samples, truth.step)
            if field.startswith("base_"):
                fields[IN_BASE.get(field, field)] = shown.copy()
                if field in IN_BASE:
                    fields[field] = rotation_from_vector(truth.base_rotation) @ shown
                continue
            exact = getattr(truth, field)
            values = {
                name: part.reshape(np.shape(exact[name])) if isinstance(exact.get(name), np.ndarray) else float(part[0])
                for name, part in zip(names, np.split(shown, ends), strict=True)
            }
            fields[field] = MappingProxyType(values)
        return fields

    def _split(self, memory: np.ndarray) -> list[np.ndarray]:
        sizes = [int(np.prod(chain.shape)) for *_, chain in self._chains]
        parts = np.split(memory[2:], np.cumsum(sizes)[:-1])
        return [part.reshape(chain.shape) for part, (*_, chain) in zip(parts, self._chains, strict=True)]


def _values(truth: Observation, field: str, names: Sequence[Any], size: int) -> np.ndarray:
    """The numbers of a field in the order of the names; 0 of a pair that is far apart."""
    if field.startswith("base_"):
        return np.asarray(getattr(truth, IN_BASE.get(field, field)), np.float64)
    exact = getattr(truth, field)
    values = np.concatenate([np.ravel(exact.get(name, 0.0)) for name in names])
    assert len(values) == size
    return values
