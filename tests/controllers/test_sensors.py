"""Sensors of an environment, and what disturbs their readings."""

from typing import Any

import gymnasium
import numpy as np
import pytest

from taichisoft.errors import SceneError
from taichisoft.pytest_fixtures import TINY_GRIPPER
from taichisoft_gym import disturbances, sensors

CLOSE = np.array([0.5, 0.5, 0.0])


def make() -> gymnasium.Env:
    return gymnasium.make("taichisoft_gym:taichisoft/Grasp-v0", scene=str(TINY_GRIPPER), pressure=(0.0, 20.0))


def readings(env: gymnasium.Env, seed: int | None = 1, steps: int = 6) -> np.ndarray:
    """All readings of an episode in which the pads close, shape (steps + 1, channel_count)."""
    first, _ = env.reset(seed=seed)
    return np.array([first, *(env.step(CLOSE)[0] for _ in range(steps))], np.float64)


def test_sensors_tell_what_the_simulation_observes() -> None:
    env = sensors.Flows(sensors.Bending(sensors.ContactForces(make(), highest=50.0)), highest=100.0)
    names = [channel.name for channel in env.get_wrapper_attr("channels")[11:]]
    assert names[::2] == ["contact force left", "bending left", "flow left.cavity"]
    last = readings(env)[-1]
    assert env.observation_space.contains(last.astype(np.float32))
    seen = env.get_wrapper_attr("simulation").observe()
    assert last[-6] == pytest.approx(min(seen.normal_forces["left", "cube"], 50.0))
    assert last[-6] > 0.0
    assert last[-4] == pytest.approx(seen.bending_angles["left"], abs=1e-6)
    assert last[-2] == pytest.approx(np.clip(seen.flows["left.cavity"], -100.0, 100.0), rel=1e-5)


def test_a_camera_adds_a_picture() -> None:
    env = sensors.Camera(make(), "front", (64, 48))
    told, _ = env.reset(seed=1)
    assert told in env.observation_space
    assert told["readings"].tobytes() == make().reset(seed=1)[0].tobytes()
    assert len(np.unique(told["picture"])) > 10
    env.close()


WRAPPERS: dict[str, tuple[type[disturbances.Disturbance], dict[str, Any]]] = {
    "noise": (disturbances.Noise, {"deviation": 0.2}),
    "bias": (disturbances.Bias, {"largest": 0.5}),
    "quantised": (disturbances.Quantised, {"resolution": 0.7}),
    "sampled": (disturbances.Sampled, {"every": 3}),
    "delayed": (disturbances.Delayed, {"steps": 2}),
    "dropout": (disturbances.Dropout, {"probability": 0.5}),
}


@pytest.fixture(scope="module")
def exact() -> np.ndarray:
    return readings(make())


@pytest.mark.parametrize("name", WRAPPERS)
def test_a_disturbance_changes_the_channels_it_is_for_and_repeats_by_its_seed(name: str, exact: np.ndarray) -> None:
    wrapper, told = WRAPPERS[name]
    env = wrapper(make(), **told, channels=["object"])
    first = readings(env)
    assert np.array_equal(first[:, :5], exact[:, :5])
    assert not np.array_equal(first[:, 5:], exact[:, 5:])
    assert np.array_equal(readings(env), first)
    assert env.spec is not None
    assert env.spec.to_json()


def test_noise_has_its_deviation_and_no_mean(exact: np.ndarray) -> None:
    env = disturbances.Noise(make(), 0.2, channels=["object "])
    noise = np.concatenate([(readings(env, seed) - exact)[:, 5:8] for seed in range(20)]).ravel()
    # 420 numbers: their mean is known to 0.2 / sqrt(420), their deviation to 0.2 / sqrt(840); bounds are 4 of these.
    assert abs(noise.mean()) < 0.04
    assert abs(noise.std() - 0.2) < 0.028


def test_a_bias_stays_for_an_episode_and_differs_in_the_next() -> None:
    env = disturbances.Bias(make(), 0.5, channels=["base"])
    first = readings(env)[:, 2:5]
    assert (first == first[0]).all()  # the base stands still
    assert (np.abs(first[0]) <= 0.5).all()
    assert not np.array_equal(readings(env, None)[0, 2:5], first[0])


def test_quantised_readings_are_multiples(exact: np.ndarray) -> None:
    steps = readings(disturbances.Quantised(make(), 0.25, channels=["pressure"]))[:, :2] / 0.25
    assert np.array_equal(steps, np.rint(steps))
    assert np.abs(steps * 0.25 - exact[:, :2]).max() <= 0.125 + 1e-6


def test_sampled_readings_are_held_and_delayed_ones_come_later(exact: np.ndarray) -> None:
    assert np.array_equal(readings(disturbances.Sampled(make(), 3)), exact[[0, 0, 0, 3, 3, 3, 6]])
    assert np.array_equal(readings(disturbances.Delayed(make(), 2)), exact[[0, 0, 0, 1, 2, 3, 4]])
    assert np.array_equal(readings(disturbances.Delayed(make(), 0)), exact)


def test_wrappers_of_one_kind_draw_different_numbers(exact: np.ndarray) -> None:
    once = readings(disturbances.Noise(make(), 0.2)) - exact
    twice = readings(disturbances.Noise(disturbances.Noise(make(), 0.2), 0.2)) - exact
    assert not np.allclose(twice[:, 5:8], 2.0 * once[:, 5:8], atol=1e-3)


def test_a_channel_that_is_not_there_is_refused() -> None:
    with pytest.raises(SceneError, match=r"no name begins with 'preasure'; there are: pressure left\.cavity, "):
        disturbances.Noise(make(), 0.1, channels=["preasure"])


def test_numbers_of_control_periods_that_make_no_sense_are_refused() -> None:
    with pytest.raises(SceneError, match="every = 0: must be a whole number of control periods, 1 or more"):
        disturbances.Sampled(make(), 0)
    with pytest.raises(SceneError, match="steps = -1: must be a whole number"):
        disturbances.Delayed(make(), -1)
