"""Vector environments for `gymnasium.make_vec`, each environment in its own process with one thread."""

from functools import partial
from typing import Any

import gymnasium
from gymnasium.vector import AsyncVectorEnv


def grasp(num_envs: int = 1, **arguments: Any) -> AsyncVectorEnv:
    """Make several Grasp-v0."""
    return _make_vector("Grasp", num_envs, arguments)


def reach(num_envs: int = 1, **arguments: Any) -> AsyncVectorEnv:
    """Make several Reach-v0."""
    return _make_vector("Reach", num_envs, arguments)


def carry(num_envs: int = 1, **arguments: Any) -> AsyncVectorEnv:
    """Make several Carry-v0."""
    return _make_vector("Carry", num_envs, arguments)


def _make_vector(name: str, count: int, arguments: dict[str, Any]) -> AsyncVectorEnv:
    # Spawned processes: a process forked from one that has simulated cannot simulate.
    make = partial(gymnasium.make, f"taichisoft_gym:taichisoft/{name}-v0", **arguments)
    return AsyncVectorEnv([make] * count, context="spawn")
