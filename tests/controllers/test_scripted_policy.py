"""Carry-v0 can be solved: the scripted baseline closes, rises, crosses, sinks and lets go."""

import gymnasium
import numpy as np
import pytest

from taichisoft_gym.baselines import carry

PHASES = (8, 6, 20, 10, 14)
"""Control periods of closing, rising, crossing, sinking and letting go."""


def test_a_scripted_policy_carries_the_cube_by_40_mm_and_lets_go() -> None:
    env = gymnasium.make("taichisoft_gym:taichisoft/Carry-v0")
    env.reset(seed=1, options={"target": (40.0, 0.0)})
    actions, ends = carry(env.unwrapped), []
    for periods in PHASES:
        for _ in range(periods):
            _, reward, terminated, _, told = env.step(next(actions).astype(np.float32))
            assert not terminated
        ends.append((reward, told))
        progress = np.clip(1.0 - told["distance"] / 40.0, -1.0, 1.0)
        arrived = told["distance"] < 5.0
        grip = 1.0 - told["touching"] if arrived else told["touching"]
        assert reward == pytest.approx(0.2 * grip + 0.8 * progress + told["is_success"])  # as documented
    closed, lifted, crossed, sunk, let_go = (told for _, told in ends)
    assert closed["touching"] == 1.0
    assert lifted["lift"] > 8.0
    assert crossed["lift"] > 8.0 and crossed["distance"] < 6.0
    assert sunk["lift"] < 1.0 and not sunk["is_success"]  # still held
    assert let_go["touching"] == 0.0 and let_go["is_success"]
    assert let_go["distance"] < 2.0
    rewards = [reward for reward, _ in ends]
    # A base that stops at once leaves the cube swinging: its place is as good before it sinks as after, to 1 mm of 40.
    assert rewards[:2] == sorted(rewards[:2]) and rewards[1] < min(rewards[2:4]) and max(rewards[2:4]) < rewards[4]
    assert rewards[2] == pytest.approx(rewards[3], abs=0.8 / 40.0)
