"""Sensors of a scene: what disturbs the figures that controllers see, and arrays of patches that feel forces."""

from itertools import combinations_with_replacement
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from taichisoft.scene.table import Count, NotNegative, Rule, Share, Table, Vector

SensedQuantity = Literal[
    "pressure",
    "volume",
    "flow",
    "air_mass",
    "air_flow",
    "valve_opening",
    "network_pressure",
    "network_flow",
    "cable_tension",
    "cable_length",
    "cable_pull",
    "tip_position",
    "tip_velocity",
    "bending_angle",
    "base_translation",
    "base_rotation",
    "base_force",
    "base_torque",
    "object_position",
    "object_velocity",
    "normal_force",
    "friction_force",
    "slip_speed",
    "contact_area",
    "peak_pressure",
    "tactile",
]
"""Quantities that have a sensor: fields of `Observation`, in the singular."""

LONGEST_DELAY = 10.0
"""Longest delay of a sensor [s]: every sample on its way is kept in the state."""


class SensorSettings(Table):
    """How a quantity is measured: the unit is that of the observation, for angles radians.

    Each value is sampled every `period`, with bias and noise, rounded to `resolution`, lost with the probability
    `dropout`, and seen `delay` later.
    """

    noise: NotNegative = 0.0
    """Standard deviation of independent normal noise of each sample."""
    bias: NotNegative = 0.0
    """Largest offset; one is drawn for each value and seed, evenly from both sides."""
    resolution: NotNegative = 0.0
    """Samples are rounded to whole multiples of it; 0: not at all."""
    period: NotNegative = 0.0
    """Time between two samples [s], a whole multiple of `time.step`; the last one is held. 0: every step."""
    delay: Annotated[float, Field(strict=True, ge=0.0, le=LONGEST_DELAY)] = 0.0
    """Age of what is seen [s], a whole multiple of `time.step`."""
    dropout: Share = 0.0
    """Probability with which a sample is lost; the one before is seen instead [-]."""
    seed: Annotated[int, Field(strict=True, ge=0, lt=2**32)] = 0
    """Seed of bias, noise and dropouts."""


class TactileArray(Table):
    """Patches of a soft body's surface that each feel the normal force on them: the cells of a box."""

    box: tuple[Vector, Vector]
    """Lower and upper corner in the mesh's own coordinates at rest [mm]."""
    patches: tuple[Count, Count, Count]
    """Number of patches along x, y and z."""

    rules = (Rule("patch_count <= 10000", "{patch_count} patches; at most 10000 are possible"),)

    @property
    def patch_count(self) -> int:
        """Number of all patches."""
        return int(np.prod(self.patches))

    @model_validator(mode="after")
    def _check_box(self) -> Self:
        if any(low >= high for low, high in zip(*self.box, strict=True)):
            raise ValueError(
                f"box = {[list(corner) for corner in self.box]}: the first corner must be below the second"
            )
        return self


class CameraSettings(Table):
    """A camera that controllers see through."""

    eye: Vector
    """Where it stands [mm]."""
    target: Vector
    """What it looks at [mm]; against gravity is up in its picture."""
    size: tuple[Annotated[int, Field(ge=8, le=4096)], Annotated[int, Field(ge=8, le=4096)]] = (160, 120)
    """Width and height of the picture [pixels]."""
    follows: str | None = None
    """Frame that carries it, "base" or one of `frames`: eye, target and picture move with it; else it stands still."""
    rules = (Rule("eye != target", "eye and target are one point, {eye}: the camera would look nowhere"),)


def sensed_names(scene: Any, quantity: SensedQuantity) -> list[tuple[str, ...] | str]:
    """Names of a quantity's values in an observation of a scene; of the base there is one without a name."""
    if quantity.startswith("base_"):
        return [""]
    if quantity.startswith("tip_") or quantity == "bending_angle":
        return [name for name, body in scene.soft_bodies.items() if body.tip is not None or body.anchors]
    if quantity.startswith("object_"):
        return list(scene.rigid_bodies)
    if quantity.startswith("cable_"):
        return list(scene.actuators("cables"))
    if quantity in ("pressure", "volume", "flow", "air_mass", "air_flow", "valve_opening"):
        return list(scene.actuators("cavities"))
    if quantity == "network_pressure":
        return list(scene.air.nodes)
    if quantity == "network_flow":
        return list(scene.air.parts)
    if quantity == "tactile":
        return list(scene.tactile_arrays)
    moving, still = [*scene.soft_bodies, *scene.rigid_bodies], list(scene.obstacles)
    pairs: list[tuple[str, ...] | str] = list(combinations_with_replacement(moving, 2))
    return [*pairs, *((first, other) for first in moving for other in still)]


def sensed_sizes(scene: Any, quantity: SensedQuantity) -> list[int]:
    """Number of numbers of each of the values that `sensed_names` names."""
    if quantity == "tactile":
        return [array.patch_count for array in scene.tactile_arrays.values()]
    is_vector = quantity.startswith(("base_", "tip_", "object_"))
    return [3 if is_vector else 1] * len(sensed_names(scene, quantity))


def samples_kept(sensor: SensorSettings, time_step: float) -> int:
    """Samples that a sensor remembers: the newest, and those on their way."""
    period = max(1, round(sensor.period / time_step))
    return 1 + -(-round(sensor.delay / time_step) // period)


def memory_size(scene: Any) -> int:
    """Length of `State.sensor_memory`: seed, whether there are samples, and these; 0 without sensors."""
    if not scene.sensors:
        return 0
    step = scene.time.step
    kept = (sum(sensed_sizes(scene, name)) * samples_kept(sensor, step) for name, sensor in scene.sensors.items())
    return 2 + sum(kept)
