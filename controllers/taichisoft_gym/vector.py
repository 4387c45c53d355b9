"""Environments side by side, each in a process of its own with one thread: what `gymnasium.make_vec` makes."""

from functools import partial
from typing import Any

import gymnasium
from gymnasium.vector import AsyncVectorEnv


def grasp(num_envs: int = 1, **arguments: Any) -> AsyncVectorEnv:
    """Several of Grasp-v0."""
    return _side_by_side("Grasp", num_envs, arguments)


def reach(num_envs: int = 1, **arguments: Any) -> AsyncVectorEnv:
    """Several of Reach-v0."""
    return _side_by_side("Reach", num_envs, arguments)


def carry(num_envs: int = 1, **arguments: Any) -> AsyncVectorEnv:
    """Several of Carry-v0."""
    return _side_by_side("Carry", num_envs, arguments)


def _side_by_side(name: str, count: int, arguments: dict[str, Any]) -> AsyncVectorEnv:
    # Processes that are started anew: forked ones of a process that has simulated could not.
    make = partial(gymnasium.make, f"taichisoft_gym:taichisoft/{name}-v0", **arguments)
    return AsyncVectorEnv([make] * count, context="spawn")
