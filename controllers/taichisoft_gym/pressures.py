"""Pressures of an environment's actions, within the scene's limits, beyond which an action would have no effect."""

import math
from collections.abc import Iterator
from typing import Any

from taichisoft import Scene
from taichisoft.errors import SceneError

USUAL_RATE = 300.0
"""Default fastest change of a pressure [kPa/s]."""


def pressure_range(scene: Scene, asked: Any, usual: tuple[float, float]) -> tuple[float, float]:
    """Pressures of the actions -1 and 1 [kPa].

    Args:
        scene: scene, with limits for all and for each cavity.
        asked: lowest and highest pressure [kPa]; None: `usual` within the limits.
        usual: default lowest and highest pressure [kPa].

    Raises:
        SceneError: `asked` is not two rising numbers, or exceeds a limit.
    """
    low, high = usual if asked is None else _two_numbers(asked)
    for key, end, limit in _limits(scene):
        if asked is None:
            low, high = (max(low, limit), high) if end == "lowest" else (low, min(high, limit))
        elif low < limit if end == "lowest" else high > limit:
            raise SceneError(
                f"pressure = ({low:g}, {high:g}): goes beyond {key} = {limit:g} kPa of the scene; a part of every "
                "action's range would do nothing"
            )
    if not low < high:
        raise SceneError(f"pressure = ({low:g}, {high:g}): the first must be below the second [kPa]")
    return low, high


def pressure_rate(scene: Scene, asked: float | None) -> float:
    """Fastest change of a pressure [kPa/s]: `asked`, or the default within the scene's limit if None.

    Raises:
        SceneError: `asked` exceeds the scene's limit.
    """
    limit = math.inf if scene.limits.pressure_rate is None else scene.limits.pressure_rate
    if asked is None:
        return min(USUAL_RATE, limit)
    if asked > limit:
        raise SceneError(f"pressure_rate = {asked:g}: goes beyond limits.pressure_rate = {limit:g} kPa/s of the scene")
    return asked


def _two_numbers(asked: Any) -> tuple[float, float]:
    try:
        low, high = (float(value) for value in asked)
    except (TypeError, ValueError):
        low = high = math.nan
    if not (math.isfinite(low) and math.isfinite(high)):
        raise SceneError(f"pressure = {asked!r}: must be a lowest and a highest pressure [kPa]")
    return low, high


def _limits(scene: Scene) -> Iterator[tuple[str, str, float]]:
    """Key, end ("lowest" or "highest") and value [kPa] of all limits of pressures."""
    tables: dict[str, Any] = {"limits": scene.limits}
    for name, body in scene.soft_bodies.items():
        tables |= {f"soft_bodies.{name}.cavities.{cavity}": table for cavity, table in body.cavities.items()}
    for key, table in tables.items():
        for end in ("lowest", "highest"):
            limit = getattr(table, f"{end}_pressure")
            if limit is not None:
                yield f"{key}.{end}_pressure", end, limit
