"""Searches by gradients: which keys of a study have one, and the descent along it."""

from collections.abc import Callable, Mapping
from typing import Any

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
    scenes = [scene_of({**values, key: values[key] + sign * width}) for sign in (1.0, -1.0)]
    more, less = (flat(scene.model_dump(mode="json", exclude_none=True)) for scene in scenes)
    found = {}
    for leaf in {**more, **less}:
        if more.get(leaf) != less.get(leaf):
            name = _name(leaf, scenes[0])
            if not name or leaf not in more or leaf not in less:
                raise StudyError(f"{key}: has no gradient here, since it changes {leaf}; there are: {KNOWN}")
            found[name] = (more[leaf] - less[leaf]) / (2.0 * width)
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


def descend(
    value_and_slope: Callable[[np.ndarray], tuple[float, np.ndarray] | None],
    start: np.ndarray,
    most: int,
    tolerance: float,
) -> np.ndarray:
    """The best point of the unit cube that L-BFGS-B reaches from a start.

    Args:
        value_and_slope: gives a value, to be made small, and its derivatives; None where a run failed.
        start: where it begins.
        most: calls of it.
        tolerance: smallest part by which a step must lower the value.
    """
    from scipy.optimize import minimize

    known: list[tuple[float, np.ndarray]] = []
    first = value_and_slope(start)
    if first is None:
        raise StudyError("the run with the values of the start failed, so that there is no gradient to follow")
    unit = max(float(np.linalg.norm(first[1])), 1e-300) / FIRST_STEP

    def scaled(point: np.ndarray) -> tuple[float, np.ndarray]:
        answer = value_and_slope(point) if known else first
        if answer is None:  # a shorter step is tried then
            worst = max(value for value, _ in known)
            return (worst + 10.0 * abs(worst)) / unit, np.zeros_like(point)
        known.append((answer[0], point.copy()))
        return answer[0] / unit, answer[1] / unit

    options = {"ftol": tolerance * abs(first[0]) / unit, "gtol": 1e-9, "maxfun": most}
    minimize(scaled, start, jac=True, method="L-BFGS-B", bounds=[(0.0, 1.0)] * len(start), options=options)
    return min(known, key=lambda pair: pair[0])[1]
