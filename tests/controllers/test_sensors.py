"""Wrappers of environments: further readings, pictures, and what disturbs readings."""

from typing import Any

import gymnasium
import numpy as np
import pytest

from taichisoft.errors import SceneError
from taichisoft.pytest_fixtures import TINY_GRIPPER
from taichisoft_gym import Camera, Disturbed, Observed

CLOSE = np.array([0.5, 0.5, 0.0])


def make() -> gymnasium.Env:
    return gymnasium.make("taichisoft_gym:taichisoft/Grasp-v0", scene=str(TINY_GRIPPER), pressure=(0.0, 20.0))


def readings(env: gymnasium.Env, seed: int | None = 1, steps: int = 6) -> np.ndarray:
    """All readings of an episode in which the pads close, shape (steps + 1, channel_count)."""
    first, _ = env.reset(seed=seed)
    return np.array([first, *(env.step(CLOSE)[0] for _ in range(steps))], np.float64)


def test_observed_adds_what_the_simulation_observes() -> None:
    env = Observed(Observed(Observed(make(), "contact force", highest=50.0), "bending"), "flow", highest=100.0)
    names = [channel.name for channel in env.get_wrapper_attr("channels")[11:]]
    assert names[::2] == ["contact force left", "bending left", "flow left.cavity"]
    last = readings(env)[-1]
    assert env.observation_space.contains(last.astype(np.float32))
    seen = env.get_wrapper_attr("simulation").observe()
    assert last[-6] == pytest.approx(min(seen.normal_forces["left", "cube"], 50.0))
    assert last[-6] > 0.0
    assert last[-4] == pytest.approx(seen.bending_angles["left"], abs=1e-6)
    assert last[-2] == pytest.approx(np.clip(seen.flows["left.cavity"], -100.0, 100.0), rel=1e-5)


def test_camera_adds_a_picture() -> None:
    env = Camera(make(), "front", (64, 48))
    told, _ = env.reset(seed=1)
    assert told in env.observation_space
    assert told["readings"].tobytes() == make().reset(seed=1)[0].tobytes()
    assert len(np.unique(told["picture"])) > 10
    with pytest.raises(SceneError, match="Disturbed needs plain readings"):
        Disturbed(env, noise=1.0)
    env.close()


@pytest.fixture(scope="module")
def exact() -> np.ndarray:
    return readings(make())


@pytest.mark.parametrize(
    "settings",
    [{"noise": 0.2}, {"bias": 0.5}, {"resolution": 0.7}, {"period": 3}, {"delay": 2}, {"dropout": 0.5}],
)
def test_disturbed_changes_its_channels_and_repeats_by_seed(settings: dict[str, Any], exact: np.ndarray) -> None:
    env = Disturbed(make(), ["object"], **settings)
    first = readings(env)
    assert np.array_equal(first[:, :5], exact[:, :5])
    assert not np.array_equal(first[:, 5:], exact[:, 5:])
    assert np.array_equal(readings(env), first)
    assert env.spec is not None
    assert env.spec.to_json()


def test_noise_has_its_deviation_and_no_mean(exact: np.ndarray) -> None:
    env = Disturbed(make(), ["object "], noise=0.2)
    noise = np.concatenate([(readings(env, seed) - exact)[:, 5:8] for seed in range(20)]).ravel()
    # 420 numbers: their mean is known to 0.2 / sqrt(420), their deviation to 0.2 / sqrt(840); bounds are 4 of these.
    assert abs(noise.mean()) < 0.04
    assert abs(noise.std() - 0.2) < 0.028


def test_bias_stays_for_an_episode_and_differs_in_the_next() -> None:
    env = Disturbed(make(), ["base"], bias=0.5)
    first = readings(env)[:, 2:5]
    assert (first == first[0]).all()  # the base stands still
    assert (np.abs(first[0]) <= 0.5).all()
    assert not np.array_equal(readings(env, None)[0, 2:5], first[0])


def test_readings_are_multiples_of_the_resolution(exact: np.ndarray) -> None:
    steps = readings(Disturbed(make(), ["pressure"], resolution=0.25))[:, :2] / 0.25
    assert np.array_equal(steps, np.rint(steps))
    assert np.abs(steps * 0.25 - exact[:, :2]).max() <= 0.125 + 1e-6


@pytest.mark.parametrize(
    ("settings", "rows"),
    [({"period": 3}, [0, 0, 0, 3, 3, 3, 6]), ({"delay": 2}, [0, 0, 0, 1, 2, 3, 4]), ({}, range(7))],
)
def test_sampled_readings_are_held_and_delayed_ones_late(settings: dict, rows: list[int], exact: np.ndarray) -> None:
    assert np.array_equal(readings(Disturbed(make(), **settings)), exact[list(rows)])


def test_two_wrappers_draw_different_numbers(exact: np.ndarray) -> None:
    once = readings(Disturbed(make(), noise=0.2)) - exact
    twice = readings(Disturbed(Disturbed(make(), noise=0.2), noise=0.2)) - exact
    assert not np.allclose(twice[:, 5:8], 2.0 * once[:, 5:8], atol=1e-3)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"channels": ["preasure"]}, r"no name begins with 'preasure'; there are: pressure left\.cavity, "),
        ({"period": 0}, "period = 0: must be a whole number of control periods, 1 or more"),
        ({"delay": -1}, "delay = -1: must be a whole number"),
        ({"noise": -1.0}, "noise = -1.0: input should be greater than or equal to 0"),
        ({"dropout": 1.5}, "dropout = 1.5: input should be less than or equal to 1"),
    ],
)
def test_disturbed_refuses(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        Disturbed(make(), **settings)


@pytest.mark.parametrize(
    ("quantity", "highest", "message"),
    [
        ("bendin", None, "there is no 'bendin'; did you mean 'bending'"),
        ("object", 3.0, "highest = 3.0: 'object' has its own range; there are: flow"),
    ],
)
def test_observed_refuses(quantity: str, highest: float | None, message: str) -> None:
    with pytest.raises(SceneError, match=message):
        Observed(make(), quantity, highest)
