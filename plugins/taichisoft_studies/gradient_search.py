"""Searches by gradients: which keys of a study have one, and the descent along it."""

import math
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any, Protocol

import numpy as np

from taichisoft import Scene
from taichisoft_studies.errors import StudyError
from taichisoft_studies.results_table import flat

SHARE = 1e-3
"""Part of a value by which it is changed to see what of the scene follows it [-]."""
FIRST_STEP = 0.1
"""Length of the first step, in the unit cube."""
KNOWN = (
    "young_modulus, density, mass, rayleigh_stiffness and rayleigh_mass of a soft body, young_modulus of its regions, "
    "mass of a rigid body, contact.friction, friction of contact.pairs"
)


def factors(scene_of: Callable[[Mapping[str, Any]], Scene], values: Mapping[str, Any], key: str) -> dict[str, float]:
    """How names of `taichisoft.gradient` follow a key: derivatives of the numbers of the scene behind them.

    Args:
        scene_of: the scene with values of keys.
        values: of all keys.
        key: one of them.

    Raises:
        StudyError: it changes something of the scene that has no derivative.
    """
    width = SHARE * abs(values[key]) or SHARE
    less_by = width if values[key] else 0.0  # much has no value below zero
    scenes = [scene_of({**values, key: values[key] + change}) for change in (width, -less_by)]
    more, less = (flat(scene.model_dump(mode="json", exclude_none=True)) for scene in scenes)
    found = {}
    for leaf in {**more, **less}:
        if more.get(leaf) != less.get(leaf):
            name = _name(leaf, scenes[0])
            if not name or leaf not in more or leaf not in less:
                raise StudyError(f"{key}: has no gradient here, since it changes {leaf}; there are: {KNOWN}")
            found[name] = (more[leaf] - less[leaf]) / (width + less_by)
    return found


def _name(leaf: str, scene: Scene) -> str:
    """The name of `taichisoft.gradient` of a number of a scene; empty of one without."""
    match leaf.split("."):
        case ["soft_bodies", *of, "young_modulus"]:
            return f"young_modulus.{'.'.join(of)}" if ".".join(of) in scene.young_moduli else ""
        case ["soft_bodies", body, "density" | "mass" | "rayleigh_stiffness" | "rayleigh_mass" as what]:
            return f"{what}.{body}"
        case ["rigid_bodies", body, "mass"]:
            return f"mass.{body}" if scene.rigid_bodies[body].inertia is None else ""
        case ["contact", "friction"]:
            return "friction"
        case ["contact", "pairs", number, "friction"]:
            return f"friction.{'|'.join(scene.contact.pairs[int(number)].bodies)}"
    return ""


class Bounded(Protocol):
    """Bounds of a value; `log` of a magnitude."""

    low: float
    high: float
    log: bool


def share_of(bounds: Bounded, value: float) -> float:
    """Where a value lies between its bounds, from 0 to 1."""
    if bounds.log:
        return math.log(value / bounds.low) / math.log(bounds.high / bounds.low)
    return (value - bounds.low) / (bounds.high - bounds.low)


def value_at(bounds: Bounded, share: float) -> float:
    """The value there."""
    if bounds.log:
        return float(bounds.low * (bounds.high / bounds.low) ** share)
    return float(bounds.low + share * (bounds.high - bounds.low))


def rate_of(bounds: Bounded, value: float) -> float:
    """Derivative of the value by the share."""
    return value * math.log(bounds.high / bounds.low) if bounds.log else bounds.high - bounds.low


class Enough(Exception):
    """Raised by what is made small where no more runs may be made."""


def descend(
    value_and_slope: Callable[[np.ndarray], tuple[float, np.ndarray] | None],
    start: np.ndarray,
    most: int,
    tolerance: float,
) -> np.ndarray:
    """The best point of the unit cube that L-BFGS-B reaches from a start.

    Args:
        value_and_slope: gives a value, to be made small, and its derivatives; None where a run failed; may raise
            `Enough`.
        start: where it begins.
        most: calls of it.
        tolerance: smallest part by which a step must lower the value.
    """
    from scipy.optimize import minimize

    known: list[tuple[float, np.ndarray]] = []
    unit = 0.0

    def scaled(point: np.ndarray) -> tuple[float, np.ndarray]:
        nonlocal unit
        if len(known) >= most:
            raise Enough
        answer = value_and_slope(point)
        if answer is None and known:  # a shorter step is tried then
            worst = max(value for value, _ in known)
            return (worst + 10.0 * abs(worst)) / unit, np.zeros_like(point)
        if answer is None:
            raise Enough
        known.append((answer[0], point.copy()))
        unit = unit or max(float(np.linalg.norm(answer[1])), 1e-300) / FIRST_STEP
        return answer[0] / unit, answer[1] / unit

    def slow(between: Any) -> None:
        before, after = lows[-1], min(value for value, _ in known)
        lows.append(after)
        if before - after <= tolerance * abs(known[0][0]):
            raise Enough

    lows = [math.inf]
    bounds, options = [(0.0, 1.0)] * len(start), {"ftol": 0.0, "gtol": 1e-9}
    with suppress(Enough):
        minimize(scaled, start, jac=True, method="L-BFGS-B", bounds=bounds, options=options, callback=slow)
    return min(known, key=lambda pair: pair[0])[1] if known else start
