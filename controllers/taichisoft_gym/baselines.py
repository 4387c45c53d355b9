"""Scripted policies for the environments, whose scores learned ones should beat; printed by this module."""

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np

import taichisoft_gym
from taichisoft_gym.tasks import LARGEST, Carry, Grasp, Reach

GRASPING, OPEN = 60.0, 0.0
"""Pressures that hold the cube of the scene "gripper", and that let go [kPa]."""
Policy = Callable[[Any], Iterator[np.ndarray]]


def reach(env: Reach) -> Iterator[np.ndarray]:
    """The pressure at which the tip, when it was measured at rest, was nearest to the target."""
    places = env.tip_places()
    nearest = np.linalg.norm(places - env.target, axis=1).argmin()
    while True:
        yield np.array([2.0 * LARGEST * nearest / (len(places) - 1) - 1.0])


def grasp(env: Grasp) -> Iterator[np.ndarray]:
    """Close for 0.4 s, rise by 35 mm at 50 mm/s, hold."""
    yield from _moves(env, [(8, GRASPING, (0.0,)), (14, GRASPING, (50.0,)), (10**9, GRASPING, (0.0,))])


def carry(env: Carry) -> Iterator[np.ndarray]:
    """Close for 0.4 s, rise by 15 mm, cross within a second, sink by 25 mm, let go."""
    right, front = env.desired_goal
    yield from _moves(
        env,
        [
            (8, GRASPING, (0.0, 0.0, 0.0)),
            (6, GRASPING, (0.0, 0.0, 50.0)),
            (20, GRASPING, (right, front, 0.0)),
            (10, GRASPING, (0.0, 0.0, -50.0)),
            (10**9, OPEN, (0.0, 0.0, 0.0)),
        ],
    )


POLICIES: dict[str, Policy] = {"Reach": reach, "Grasp": grasp, "Carry": carry}


def _moves(env: Any, phases: list[tuple[int, float, tuple[float, ...]]]) -> Iterator[np.ndarray]:
    """Actions of phases: control periods, pressure of all cavities [kPa], velocity of the base [mm/s]."""
    for periods, pressure, velocity in phases:
        count = len(env.action_channels) - len(velocity)
        values = np.array([pressure] * count + [*velocity])
        low, high = (np.array([getattr(one, end) for one in env.action_channels]) for end in ("low", "high"))
        for _ in range(periods):
            yield np.clip(2.0 * (values - low) / (high - low) - 1.0, -1.0, 1.0)


@dataclass(frozen=True)
class Score:
    """How a policy fared.

    Attributes:
        returns: sum of the rewards of each episode.
        successes: number of episodes that ended in success.
    """

    returns: list[float]
    successes: int


def score(name: str, episodes: int, policy: Policy | None = None, **arguments: Any) -> Score:
    """Play episodes with the seeds from 0 on; `policy` is the scripted one unless given, `arguments` of the task."""
    env = gymnasium.make(f"taichisoft/{name}-v0", **arguments)
    returns, successes = [], 0
    for seed in range(episodes):
        _, told = env.reset(seed=seed)
        actions, total, is_over = (policy or POLICIES[name])(env.unwrapped), 0.0, False
        while not is_over:
            _, reward, terminated, truncated, told = env.step(next(actions).astype(np.float32))
            total, is_over = total + float(reward), terminated or truncated
        returns.append(total)
        successes += bool(told["is_success"])
    env.close()
    return Score(returns, successes)


def main() -> None:
    """Print the scores."""
    parser = argparse.ArgumentParser(prog="python -m taichisoft_gym.baselines", description=__doc__)
    parser.add_argument("--task", choices=list(taichisoft_gym.EPISODES), action="append", help="one task; else all")
    parser.add_argument("--episodes", type=int, default=10, help="number of episodes, with the seeds 0, 1, ...")
    options = parser.parse_args()
    if options.episodes < 1:
        parser.error(f"--episodes {options.episodes}: must be 1 or more")
    for name in options.task or list(taichisoft_gym.EPISODES):
        result = score(name, options.episodes)
        mean, deviation = np.mean(result.returns), np.std(result.returns)
        print(
            f"{name}-v0: {result.successes} of {options.episodes} succeed; return {mean:.1f}, deviation {deviation:.1f}"
        )


if __name__ == "__main__":
    main()
