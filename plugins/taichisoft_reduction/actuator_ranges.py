"""How far the actuators of a body are driven in the training."""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from taichisoft.actuators import ACTUATOR_KINDS, UNLIMITED, Drive
from taichisoft_reduction.body_shapes import BodyShape
from taichisoft_reduction.errors import ReductionError
from taichisoft_reduction.run_request import RunResult

if TYPE_CHECKING:
    from taichisoft import Model

BEYOND = 1.25
"""The training goes so far beyond what the scene's own run asks for."""

Ranges = Mapping[str, tuple[str, float, float]]
"""Key of `taichisoft.Control`, smallest and largest value of each actuator of the first body of a shape, by name."""


def actuator_ranges(
    model: "Model", shape: BodyShape, own_run: RunResult | None, asked: Mapping[str, tuple[float, float]], full: bool
) -> Ranges:
    """The ranges of the first body's actuators, over all copies.

    Args:
        model: model of the scene.
        shape: the body and its copies.
        own_run: what the scene's own controller asks for; None without one.
        asked: ranges that the user gives, by "body.actuator".
        full: whether to go to the scene's limits, and not only somewhat beyond the own run.

    Raises:
        ReductionError: neither the own run, nor a limit, nor the user says how far to go.
    """
    found = {}
    for kind in ACTUATOR_KINDS:
        for name in model.actuators.names_of(kind):
            if name.partition(".")[0] == shape.name:
                copies = [f"{body}.{name.partition('.')[2]}" for body in shape.bodies]
                found[name] = _range(model, copies, own_run, asked, full, (kind.effort, kind.coordinate))
    return found


def _range(
    model: "Model",
    copies: Sequence[str],
    own_run: RunResult | None,
    asked: Mapping[str, tuple[float, float]],
    full: bool,
    drives: tuple[Drive, Drive],
) -> tuple[str, float, float]:
    used = [own_run.drives[name] for name in copies if own_run is not None and name in own_run.drives]
    by_coordinate = any(key == drives[1].asked for key, _, _ in used)
    drive = drives[by_coordinate]
    for name in copies:
        if name in asked:
            return drive.asked, *asked[name]
    low, high = min((one for _, one, _ in used), default=0.0), max((one for _, _, one in used), default=0.0)
    limit_low, limit_high = _limits(model, copies[0], drive, by_coordinate)
    if (full or low == high) and math.isfinite(limit_high):
        return drive.asked, min(0.0, limit_low) if math.isfinite(limit_low) else 0.0, limit_high
    if low == high:
        raise ReductionError(
            f"--range {copies[0]}=LOW:HIGH: needed, since neither the scene's own run drives '{copies[0]}' nor a limit "
            f"ends its {drive.words} [{drive.unit}]"
        )
    return drive.asked, max(BEYOND * low, limit_low), min(BEYOND * high, limit_high)


def _limits(model: "Model", name: str, drive: Drive, by_coordinate: bool) -> tuple[float, float]:
    """Smallest and largest value that the actuator and the scene's limits allow; infinite where none is set."""
    number = model.actuators.names.index(name)
    ranges = model.actuators.coordinate_range if by_coordinate else model.actuators.effort_range
    low, high = (float(one) for one in ranges[number])
    limits = model.scene.limits
    scene_low, scene_high = (
        getattr(limits, f"lowest_{drive.name}", None),
        getattr(limits, f"highest_{drive.name}", None),
    )
    low = max(low, -np.inf if scene_low is None else scene_low)
    high = min(high, np.inf if scene_high is None else scene_high)
    return low if low > -UNLIMITED else -math.inf, high if high < UNLIMITED else math.inf
