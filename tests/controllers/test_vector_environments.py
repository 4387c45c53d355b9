"""Environments on threads of one process: gymnasium's own results, also after episodes that end and errors."""

import gc

import gymnasium
import pytest
from gymnasium.vector import SyncVectorEnv

from taichisoft.mechanics import State
from taichisoft.pytest_fixtures import TINY_GRIPPER
from taichisoft_gym import SoftRobotVectorEnv

GRASP = "taichisoft_gym:taichisoft/Grasp-v0"
SMALL = {"scene": str(TINY_GRIPPER), "pressure": (0.0, 15.0)}


class Fails(gymnasium.Wrapper):
    """Fails in its next step if `fails`."""

    fails = False

    def step(self, action):
        if self.fails:
            raise RuntimeError("this one")
        return super().step(action)


def make() -> gymnasium.Env:
    return Fails(gymnasium.make(GRASP, max_episode_steps=2, **SMALL))


def test_threads_give_the_bits_of_one_after_another() -> None:
    threads, serial = SoftRobotVectorEnv([make] * 3, threads=2), SyncVectorEnv([make] * 3)
    assert threads.reset(seed=1)[0].tobytes() == serial.reset(seed=1)[0].tobytes()
    serial.action_space.seed(1)
    for _ in range(4):  # the third step resets
        actions = serial.action_space.sample()
        ours, theirs = threads.step(actions), serial.step(actions)
        assert [each.tobytes() for each in ours[:4]] == [each.tobytes() for each in theirs[:4]]
    assert ours[0][0].tobytes() != ours[0][1].tobytes()
    threads.close()


def test_a_step_that_fails_leaves_environments_that_reset() -> None:
    threads = SoftRobotVectorEnv([make] * 3, threads=2)
    first, _ = threads.reset(seed=1)
    threads.envs[1].env.fails = True
    with pytest.raises(RuntimeError, match="this one"):
        threads.step(threads.action_space.sample())
    threads.envs[1].env.fails = False
    assert threads.reset(seed=1)[0].tobytes() == first.tobytes()
    threads.close()


def test_resets_keep_no_states() -> None:
    randomisation = {"friction": (0.4, 0.9), "mass": (0.5, 2.0), "modulus": (0.8, 1.2), "place": 1.0}
    environment, alive = gymnasium.make(GRASP, randomisation=randomisation, **SMALL), []
    for count in (5, 20):
        for _ in range(count):
            environment.reset()
            environment.step(environment.action_space.sample())
        gc.collect()
        alive.append(sum(isinstance(one, State) for one in gc.get_objects()))
    assert alive[0] == alive[1]


def test_make_vec_makes_threads() -> None:
    with pytest.raises(ValueError, match="threads = 0: must be 1 or more"):
        SoftRobotVectorEnv([make], threads=0)
    environments = gymnasium.make_vec(GRASP, num_envs=2, **SMALL)
    assert isinstance(environments.unwrapped, SoftRobotVectorEnv)
    environments.close()
