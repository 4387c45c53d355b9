"""The learning environments: gymnasium's own checks, episodes that repeat, rewards that follow the task."""

import json
import os
import re
import urllib.request
import warnings
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import taichisoft
import taichisoft_gym.episode_start
from taichisoft import Force, Observation, load_scene
from taichisoft.errors import SceneError, StateError
from taichisoft.mechanics import Modes
from taichisoft.pytest_fixtures import TINY_GRIPPER
from taichisoft_gym import EPISODES, Channel, ChannelGroup, SoftRobotEnvironment, Travel
from taichisoft_gym.baselines import score

SMALL = {"scene": str(TINY_GRIPPER), "pressure": (0.0, 15.0)}
"""The tiny gripper: two pads, which touch the cube at 7 kPa and can lift it with 9."""
FINGER: dict[str, Any] = {}
ARGUMENTS = {"Grasp": SMALL, "Carry": SMALL, "Reach": FINGER}
EVERYTHING = {"friction": (0.4, 0.8), "mass": (0.5, 2.0), "modulus": (0.9, 1.1), "place": 0.5}


def make(name: str, **told: Any) -> gymnasium.Env:
    return gymnasium.make(f"taichisoft_gym:taichisoft/{name}-v0", **{**ARGUMENTS[name], **told})


@pytest.mark.parametrize(("name", "told"), [*((name, {}) for name in EPISODES), ("Reach", {"goals": True})])
def test_gymnasiums_checker_finds_nothing(name: str, told: dict) -> None:
    env = make(name, **told)
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)  # what gymnasium's logger uses
        warnings.filterwarnings("ignore", ".*(walls of one element|is stretched)")  # the scene, which is coarse
        check_env(env.unwrapped, skip_render_check=True)
    env.close()


@pytest.mark.parametrize("name", EPISODES)
def test_stable_baselines_checker_finds_nothing(name: str) -> None:
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", ".*(walls of one element|is stretched)")
        checker.check_env(make(name), skip_render_check=True)
        if name != "Grasp":
            checker.check_env(make(name, goals=True).unwrapped, skip_render_check=True)


def episode(env: gymnasium.Env, seed: int) -> list[bytes]:
    """Observations and rewards of two short episodes under random actions, the second without a seed of its own."""
    env.action_space.seed(seed)
    seen = []
    for start in (seed, None):
        first, _ = env.reset(seed=start)
        seen.append(first.tobytes())
        for _ in range(8):
            readings, reward, *_ = env.step(env.action_space.sample())
            seen += [readings.tobytes(), np.float64(reward).tobytes()]
    return seen


def test_seed_repeats_every_bit() -> None:
    told = {"randomisation": EVERYTHING, "noise": 0.01}
    first = episode(make("Grasp", **told), 3)
    assert episode(make("Grasp", **told), 3) == first
    assert episode(make("Grasp", **told), 4) != first


def test_reduced_bodies_with_all_modes_move_as_full_ones(tmp_path: Path) -> None:
    """A basis of all motions leaves nothing out; what is left is the tolerance of the contact solver, 1e-5 mm/s."""
    full = make("Grasp")
    full.reset(seed=1)
    for body in full.get_wrapper_attr("simulation").model.soft_bodies:
        scale = np.diag(1.0 / np.sqrt(np.repeat(body.node_mass, 3)))
        modes = scale.reshape(len(body.node_mass), 3, -1)
        Modes(body.mesh.nodes, modes, fingerprint=body.fingerprint).write(tmp_path / f"{body.name}.npz")
    reduced = make("Grasp", reduced=str(tmp_path))
    reduced.reset(seed=1)
    simulation = reduced.get_wrapper_attr("simulation")
    assert all(body.modes is not None for body in simulation.model.soft_bodies)
    for action in (1.0, 0.5, 0.8, 0.8):
        there, here = (env.step(np.array([action] * 2 + [0.2], np.float32))[0] for env in (full, reduced))
        np.testing.assert_allclose(here, there, atol=1e-4)
    assert len(simulation.state.contact_impulse) > 2  # the pads press


def test_what_is_drawn_is_what_is_simulated() -> None:
    env = make("Grasp", randomisation=EVERYTHING)
    env.reset()
    simulation = env.get_wrapper_attr("simulation")  # stays: to make one takes longer than a control period
    for seed in range(5):
        _, told = env.reset(seed=seed)
        drawn = told["randomised"]
        assert 0.4 <= drawn["friction"] <= 0.8
        assert (simulation.model.friction == drawn["friction"]).all()
        assert simulation.model.rigid_mass == pytest.approx([0.001 * drawn["mass"]])
        assert simulation.state.young_modulus == pytest.approx(100.0 * drawn["modulus"])
        place = simulation.state.rigid_position[0]
        assert place[0] == pytest.approx(drawn["place right"], abs=0.05)
        assert abs(drawn["place front"]) <= 0.5


def test_no_drawn_place_lies_within_a_finger() -> None:
    """Some of these places do, and the pads would throw the cube away."""
    env = make("Grasp", randomisation={"place": 12.0})
    drawn_again = 0
    for seed in range(12):
        _, told = env.reset(seed=seed)
        first = taichisoft_gym.episode_start.Randomisation(place=12.0).draw(np.random.default_rng(seed))
        drawn_again += first != told["randomised"]
        simulation = env.get_wrapper_attr("simulation")
        assert simulation.state.rigid_position[0][0] == pytest.approx(told["randomised"]["place right"], abs=0.05)
        overlap = simulation.step().max_penetration - simulation.model.scene.contact.contact_distance
        assert overlap < 0.0
    assert drawn_again > 1
    _, repeated = env.reset(seed=11)
    assert repeated["randomised"] == told["randomised"]


def test_object_without_a_free_place_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("taichisoft_gym.episode_start.MOST_PLACES", 1)
    env = make("Grasp", randomisation={"place": 12.0})
    with pytest.raises(SceneError, match=r"place'\]: none of 1 places was free; bodies '.*' and 'cube' overlap"):
        for seed in range(12):
            env.reset(seed=seed)


def grasp(env: gymnasium.Env) -> tuple[list[float], dict[str, Any], bool]:
    """Close, then rise by 10 mm: rewards, the last info, and whether the episode was terminated."""
    rewards = []
    for step in range(40):
        pressure = min(step / 8.0, 1.0)
        readings, reward, terminated, _, told = env.step(np.array([pressure, pressure, 0.4 if 15 < step < 22 else 0.0]))
        assert readings in env.observation_space
        rewards.append(reward)
    return rewards, told, terminated


def test_reward_of_grasp_grows_until_success() -> None:
    env = make("Grasp", lift=10.0)
    env.reset(seed=0)
    rewards, told, terminated = grasp(env)
    assert told["is_success"]
    assert not terminated
    assert told["lift"] > 10.0
    assert told["stretch_over_law"] == max(env.get_wrapper_attr("simulation").report.stretch_over_law.values()) > 0.5
    assert rewards[0] < rewards[12] < rewards[-1]
    assert rewards[-1] == pytest.approx(1.0)


def test_lost_object_terminates_the_episode() -> None:
    env = make("Grasp")
    env.reset()
    state = env.get_wrapper_attr("simulation").state
    gone = state.changed(rigid_position=state.rigid_position + np.array([0.0, 200.0, 0.0]))
    env.reset(options={"state": gone})
    thrown = gone.changed(rigid_velocity=np.array([[0.0, 9000.0, 0.0]]))
    env.reset(options={"state": thrown})
    for _ in range(3):
        _, _, terminated, truncated, told = env.step(np.array([-1.0, -1.0, 0.0]))
    assert (terminated, truncated, told["is_success"]) == (True, False, False)


def test_last_step_truncates_the_episode() -> None:
    env = make("Grasp", max_episode_steps=2)
    env.reset()
    ends = [env.step(np.zeros(3))[2:4] for _ in range(2)]
    assert ends == [(False, False), (False, True)]


def test_divergence_truncates_the_episode() -> None:
    env = make("Grasp")
    env.reset()
    state = env.get_wrapper_attr("simulation").state
    env.reset(options={"state": state.changed(velocity=np.full_like(state.velocity, 1e12))})
    _, _, terminated, truncated, told = env.step(np.zeros(3))
    assert (terminated, truncated) == (False, True)
    assert "step" in told["diverged"]


def test_episode_begins_at_a_given_state() -> None:
    env = make("Grasp", randomisation=EVERYTHING)
    env.reset(seed=0)
    grasp(env)
    state = env.get_wrapper_attr("simulation").state
    _, told = make("Grasp").unwrapped.reset(options={"state": state})
    assert told["randomised"] == {}
    readings, _ = env.reset(options={"state": state})
    again, _ = env.reset(options={"state": state})
    assert readings.tobytes() == again.tobytes()
    assert env.get_wrapper_attr("simulation").state == state
    assert env.get_wrapper_attr("simulation").model.friction == pytest.approx(0.6)  # the scene's, nothing drawn before
    assert readings[0] == pytest.approx(15.0)


@pytest.mark.parametrize("share", [0.1, 0.9])
def test_measured_pressure_reaches_its_target(share: float) -> None:
    env = make("Reach")
    env.reset(seed=0)
    from taichisoft_gym.tasks import LARGEST

    places = env.unwrapped.tip_places()
    target = places[round(share * (len(places) - 1))]
    env.reset(options={"target": target})
    action = 2.0 * LARGEST * round(share * (len(places) - 1)) / (len(places) - 1) - 1.0
    for _ in range(12):
        _, reward, terminated, _, told = env.step(np.array([action]))
    assert told["is_success"]
    assert not terminated
    assert told["distance"] < 1.0
    assert reward == pytest.approx(-0.1 * told["distance"])
    env.reset(options={"target": target})
    _, reward, _, _, told = env.step(np.array([1.0]))  # the first action is no change
    assert reward == pytest.approx(-0.1 * told["distance"])


def test_carry_rewards_progress_and_letting_go() -> None:
    env = make("Carry", tolerance=2.0)
    env.reset()
    env.reset(seed=0, options={"target": (10.0, 0.0)})
    _, far, _, _, told = env.step(np.array([-1.0, -1.0, 0.0, 0.0, 0.0]))
    assert told["distance"] == pytest.approx(10.0, abs=0.1)
    state = env.get_wrapper_attr("simulation").state
    env.reset(options={"target": (0.5, 0.0), "state": state})
    *_, told = env.step(np.array([-1.0, -1.0, 0.0, 0.0, 0.0]))
    assert told["is_success"]
    assert env.step(np.array([-1.0, -1.0, 0.0, 0.0, 0.0]))[1] > far + 1.0


def test_dragged_object_fails_carry() -> None:
    env = make("Carry", longest_drag=3.0, tolerance=100.0)
    env.reset(seed=0, options={"target": (30.0, 0.0)})
    closed = [1.0, 1.0]
    for _ in range(8):
        *_, terminated, _, told = env.step(np.array([*closed, 0.0, 0.0, 0.0]))
    assert not terminated and told["dragged"] < 1.0
    for _ in range(10):
        *_, terminated, _, told = env.step(np.array([*closed, 1.0, 0.0, 0.0]))
        assert terminated == (told["dragged"] > 3.0)
        if terminated:
            break
    assert terminated and not told["is_success"] and told["lift"] < 1.0
    _, told = env.reset(seed=0, options={"target": (30.0, 0.0)})
    assert told["dragged"] == 0.0


def test_argument_object_replaces_the_object() -> None:
    env = make("Grasp", object={"sphere": {"radius": 5.0}, "mass": 0.002}, friction=0.5)
    env.reset()
    model = env.get_wrapper_attr("simulation").model
    assert model.scene.rigid_bodies["cube"].box is None
    assert model.rigid_mass == pytest.approx([0.002])
    assert (model.friction == 0.5).all()


@pytest.mark.parametrize(
    ("task", "told", "problem"),
    [
        ("Carry", {"longest_drag": 0.0}, "longest_drag = 0.0: must be above 0"),
        ("Carry", {"tolerance": "fine"}, "tolerance = 'fine': must be a finite number"),
        ("Carry", {"distance": (50.0, 20.0)}, "must be a shortest and a longest distance"),
        ("Grasp", {"lift": -30.0}, "lift = -30.0: must be above 0"),
        ("Grasp", {"hold": float("nan")}, "hold = nan: must be a finite number"),
        ("Reach", {"tolerance": 0.0}, "tolerance = 0.0: must be above 0"),
        ("Grasp", {"pressure": (10.0, 10.0)}, "the first must be below the second"),
        ("Grasp", {"pressure": (0.0, 100.0)}, "(0, 100): goes beyond limits.highest_pressure = 30 kPa of the scene"),
        ("Grasp", {"pressure": (-1.0, 20.0)}, "goes beyond limits.lowest_pressure = 0 kPa"),
        ("Grasp", {"pressure": (0.0, float("nan"))}, "must be a lowest and a highest pressure"),
        ("Grasp", {"pressure": "high"}, "pressure = 'high': must be a lowest and a highest pressure"),
        ("Grasp", {"pressure": 10.0}, "must be a lowest and a highest pressure"),
        ("Grasp", {"pressure_rate": 301.0}, "goes beyond limits.pressure_rate = 300 kPa/s"),
        ("Grasp", {"control_period": 0.015}, "must be a whole multiple of the time step, 0.01 s"),
        ("Grasp", {"randomisation": {"fiction": (0.1, 0.2)}}, "there is no 'fiction'; did you mean 'friction'"),
        ("Grasp", {"randomisation": {"mass": (2.0, 1.0)}}, "randomisation['mass']"),
        ("Grasp", {"randomisation": {"friction": 0.5}}, "randomisation['friction'] = 0.5: must be"),
        (
            "Grasp",
            {"randomisation": {"push": (5.0, 1.0)}},
            "randomisation['push'] = (5.0, 1.0): must be",
        ),
        ("Grasp", {"randomisation": {"push": (-5.0, 1.0)}}, "randomisation['push'] = (-5.0, 1.0): must be"),
        (
            "Grasp",
            {"randomisation": {"push_chance": 2.0}},
            "randomisation['push_chance'] = 2.0: must be",
        ),
        ("Reach", {"randomisation": {"push": (0.0, 9.0)}}, "randomisation['push']: the scene has no rigid body"),
        ("Grasp", {"object": {"weight": 1.0}}, "rigid_bodies.cube.weight"),
        ("Grasp", {"objects": {"cube": 3}}, "object = 3: must be a dictionary of keys of a rigid body"),
        ("Grasp", {"objects": {}}, "objects: must be changed keys"),
        ("Grasp", {"goals": True}, "Grasp has no goal"),
        ("Grasp", {"reduced": "nowhere"}, "reduced nowhere: no such folder"),
    ],
)
def test_arguments_that_make_no_sense_are_refused(task: str, told: dict[str, Any], problem: str) -> None:
    with pytest.raises(SceneError, match=re.escape(problem)):
        make(task, **told)


@pytest.mark.parametrize(
    ("task", "option", "values", "problem"),
    [
        ("Reach", "target", ((1.0, 2.0), (1.0, 2.0, np.nan), "there", [[1.0], 2.0, 3.0]), "must be a point"),
        ("Carry", "target", ((0.0, 0.0), (1.0, np.nan), "there"), "must be a way to the right and to the front"),
        ("Grasp", "difficulty", (2,), "options['difficulty'] = 2: must be a number from 0 to 1"),
        ("Grasp", "stat", (None,), "there is no 'stat'; there are: state"),
    ],
)
def test_options_of_reset_are_refused(task: str, option: str, values: tuple, problem: str) -> None:
    env = make(task)
    for wrong in values:
        with pytest.raises(SceneError, match=re.escape(problem)):
            env.reset(options={option: wrong})


def test_actions_and_states_that_make_no_sense_are_refused() -> None:
    env = make("Grasp").unwrapped
    env.reset()
    for action in (
        [0.0, np.nan, 0.0],
        [0.0] * 2,
        [0.0] * 4,
        0.5,
        "up",
        ["a", "b", "c"],
        [[0.0], 0.0, 0.0],
        None,
        [1j] * 3,
    ):
        with pytest.raises(SceneError, match="must be 3 finite numbers"):
            env.step(action)
    state = env.get_wrapper_attr("simulation").state
    other = taichisoft.Simulation(taichisoft.load_scene("gripper")).state
    for wrong, problem in (
        (other, "belongs to another model: its position has shape"),
        ("state.npz", "'state.npz': must be a taichisoft.State"),
        (state.changed(position=np.full_like(state.position, np.nan)), "its position has a number that is not finite"),
        (state.changed(time=float("nan")), "its time has a number that is not finite"),
        (state.changed(velocity=np.full(state.velocity.shape, "fast")), "its velocity is not an array of numbers"),
        (state.changed(step="seven"), "its step is not a number"),
    ):
        with pytest.raises(StateError, match=problem):
            env.reset(options={"state": wrong})
    env.reset()
    env.step(np.zeros(3))  # nothing of all that is left


def test_step_and_picture_need_a_reset() -> None:
    env = make("Reach").unwrapped
    for ask in (lambda: env.step(np.zeros(1)), lambda: env.picture("iso", (8, 8))):
        with pytest.raises(gymnasium.error.ResetNeeded, match=r"call reset\(\) first"):
            ask()
    env.close()


def test_actions_are_clipped_for_motion_and_reward() -> None:
    """Reach-v0 takes a change of the action off the reward: from 1 to 5 there is none, since 5 is 1."""
    rewards, ends = {}, {}
    for second in (1.0, 5.0):
        env = make("Reach")
        env.reset(seed=0, options={"target": (-110.0, 20.0, 0.0)})
        first = np.array([1.0])
        env.step(first)
        first[:] = -1.0  # the caller's own array, which says nothing of what was done
        readings, rewards[second], *_ = env.step(np.array([second]))
        ends[second] = readings.tobytes()
    assert rewards[5.0] == rewards[1.0]
    assert ends[5.0] == ends[1.0]


def test_ranges_of_actions_end_at_limits() -> None:
    """No part of a range is dead: without an argument pressures and speeds go as far as scene and cavities allow."""
    scene = taichisoft.load_scene(str(TINY_GRIPPER), ["limits.base_speed=40", "limits.pressure_rate=50"])
    env = make("Grasp", scene=scene, pressure=None).unwrapped
    ranges = {channel.name: (channel.low, channel.high) for channel in env.action_channels}
    assert ranges["base velocity up"] == (-40.0, 40.0)
    pressures = [between for name, between in ranges.items() if name.startswith("pressure")]
    assert pressures == [(0.0, 30.0)] * 2
    assert env.scene.limits.pressure_rate == 50.0
    assert make("Reach").unwrapped.action_channels[0].high == 60.0


def test_limit_of_a_cavity_bounds_the_pressure() -> None:
    text = taichisoft.load_scene("finger-inflated", ["soft_bodies.finger.cavities.cavity.highest_pressure=18"])
    assert make("Reach", scene=text).unwrapped.action_channels[0].high == 18.0
    key = "soft_bodies.finger.cavities.cavity.highest_pressure = 18 kPa"
    with pytest.raises(SceneError, match=rf"pressure = \(0, 60\): goes beyond {key}"):
        make("Reach", scene=text, pressure=(0.0, 60.0))


@pytest.mark.parametrize(("mode", "count"), [(None, 1), ("sync", 2)])  # a process of its own takes long to start
def test_vector_environments_give_the_same_bits(mode: str | None, count: int) -> None:
    alone = make("Grasp")
    expected, _ = alone.reset(seed=5)
    envs = gymnasium.make_vec("taichisoft_gym:taichisoft/Grasp-v0", num_envs=count, vectorization_mode=mode, **SMALL)
    readings, _ = envs.reset(seed=5)
    assert readings[0].tobytes() == expected.tobytes()
    actions = np.array([[0.0, 0.0, 0.0], [0.5, 0.5, 0.0]][:count], np.float32)
    stepped, *_ = envs.step(actions)
    assert stepped[0].tobytes() == alone.step(actions[0])[0].tobytes()
    assert len({one.tobytes() for one in stepped}) == count
    envs.close()


@pytest.mark.filterwarnings("ignore:.*:UserWarning")  # gymnasium shows what its processes say
@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork")
def test_forked_environments_give_the_same_bits() -> None:
    expected, _ = make("Grasp").reset(seed=0)
    envs = gymnasium.make_vec(
        "taichisoft_gym:taichisoft/Grasp-v0",
        num_envs=1,
        vectorization_mode="async",
        vector_kwargs={"context": "fork"},
        **SMALL,
    )
    readings, _ = envs.reset(seed=0)
    assert readings[0].tobytes() == expected.tobytes()
    envs.close()


def test_pictures_and_a_page_show_an_episode() -> None:
    env = make("Grasp", render_mode="rgb_array", size=(64, 48), randomisation={"friction": (0.4, 0.8)})
    env.reset(seed=0)
    first = env.render()
    assert first.shape == (48, 64, 3)
    grasp(env)
    assert not np.array_equal(env.render(), first)
    env.reset(seed=1)
    assert np.array_equal(env.render(), first)  # friction is not seen
    env.close()


def test_a_page_in_the_browser_shows_an_episode(capfd: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("viser")
    env = make("Grasp", render_mode="human")
    env.reset(seed=0)
    env.step(np.zeros(3))
    address = next(line for line in capfd.readouterr().out.splitlines() if line.startswith("web page: "))
    browser = urllib.request.build_opener(urllib.request.HTTPCookieProcessor())  # the page keeps its key in a cookie
    with browser.open(address.removeprefix("web page: ")) as page:
        assert page.status == 200
    assert env.render() is None
    env.close()
    env.close()


def test_spec_is_written_as_text() -> None:
    env = make("Grasp", randomisation={"friction": (0.4, 0.8)})
    text = env.spec.to_json()
    assert json.loads(text)["kwargs"]["randomisation"] == {"friction": [0.4, 0.8]}
    assert taichisoft_gym.EPISODES["Grasp"] == env.spec.max_episode_steps


def test_goals_are_observed_and_rewarded() -> None:
    """Hindsight: the reward of a step is that of its goals, and that of a goal which is where the tip is, is 0."""
    env = make("Reach", goals=True)
    first, _ = env.reset(seed=0, options={"target": (-110.0, 20.0, 0.0)})
    assert "way to the target up" not in [channel.name for channel in env.unwrapped.channels]
    seen, reward, *_, told = env.step(np.array([1.0]))
    achieved, desired = seen["achieved_goal"], seen["desired_goal"]
    assert np.array_equal(desired, first["desired_goal"]) and not np.array_equal(achieved, first["achieved_goal"])
    assert reward == env.unwrapped.compute_reward(achieved, desired, told) == -1.0
    many = env.unwrapped.compute_reward(np.array([achieved, achieved]), np.array([desired, achieved]), [{}, {}])
    assert many.tolist() == [-1.0, 0.0]


def test_every_reset_draws_one_of_the_objects() -> None:
    objects = {"cube": {}, "ball": {"sphere": {"radius": 5.0}, "mass": 0.002}}
    env = make("Grasp", objects=objects, randomisation={"mass": (0.5, 0.5)})
    masses = {}
    for seed in range(6):
        _, told = env.reset(seed=seed)
        masses[told["randomised"]["object"]] = env.get_wrapper_attr("simulation").model.rigid_mass.tolist()
    assert masses == {"cube": [0.0005], "ball": [0.001]}


def test_a_difficulty_is_the_share_of_all_ranges() -> None:
    env = make("Grasp", randomisation=EVERYTHING, difficulty=0.0)
    easy = env.reset(seed=0)[1]["randomised"]
    assert easy == {"friction": 0.6, "mass": 1.0, "modulus": 1.0, "place right": 0.0, "place front": 0.0}
    half = env.reset(seed=0, options={"difficulty": 0.5})[1]["randomised"]
    whole = env.reset(seed=0, options={"difficulty": 1.0})[1]["randomised"]
    for name, value in whole.items():
        assert half[name] - easy[name] == pytest.approx(0.5 * (value - easy[name]))


def test_pushes_are_drawn_and_last_a_control_period() -> None:
    """Half of the periods, amounts within the range, in all directions; the same seed repeats them, none is at 0."""
    env = make("Grasp", randomisation={"push": (1.0, 2.0), "push_chance": 0.5})
    still = np.zeros(env.action_space.shape)
    runs = []
    for difficulty in (1.0, 1.0, 0.0):
        env.reset(seed=3, options={"difficulty": difficulty})
        seen = []
        for _ in range(40):
            env.step(still)
            seen.append(env.get_wrapper_attr("simulation").observe().external_forces["cube"])
        runs.append(np.array(seen))
    first, again, easy = runs
    np.testing.assert_array_equal(first, again)
    amounts = np.linalg.norm(first, axis=1)
    assert not easy.any() and 10 < (amounts > 0.0).sum() < 30
    assert 1.0 <= amounts[amounts > 0.0].min() < 1.3 and 1.7 < amounts.max() <= 2.0
    assert (first.min(axis=0) < 0.0).all() and (first.max(axis=0) > 0.0).all()


class Pushed(SoftRobotEnvironment):
    """The cube is pushed for two steps of each control period, and observed."""

    usual_scene = str(TINY_GRIPPER)
    usual_pressure = (0.0, 15.0)
    observations = ("external force",)

    def pushes(self) -> dict[str, Force | None]:
        return {self.object: Force([3.0, 0.0, 0.0], steps=2)}

    def reward(self, seen: Observation) -> float:
        return float(seen.object_velocities[self.object][0])


def test_own_pushes_act_for_their_steps() -> None:
    env = Pushed(scene=load_scene(TINY_GRIPPER, ("gravity=[0,0,0]", "rigid_bodies.cube.position=[0,0,60]")))
    env.reset(seed=0)
    for number in range(1, 4):
        readings, speed, *_ = env.step(np.full(2, -1.0))
        assert speed == pytest.approx(number * 2 * 0.01 * 3.0 / 0.001)
        assert not readings.any()  # it was over
    assert env.channels[0].name == "external force right"


class Pull(SoftRobotEnvironment):
    """A task without anything of its own: the base turns, tensions of cables would be asked for."""

    actions = ("pressure",)
    travel = Travel((0.0, 0.0, 0.0), (0.0, 0.0, 5.0), turn=0.1, turning_speed=0.5)
    observations = ("actuators", "wrist force", "contact pressure", "tactile")


def test_turning_base_stops_and_mistakes_are_named() -> None:
    env = Pull(scene=str(TINY_GRIPPER), pressure=(0.0, 15.0))
    env.reset(seed=0)
    with pytest.raises(NotImplementedError, match="Pull needs a method reward"):
        env.step(np.array([-1.0, -1.0, 0.0, 1.0]))
    env.reward = lambda seen: 0.0  # type: ignore[method-assign]
    for _ in range(8):
        env.step(np.array([-1.0, -1.0, 0.0, 1.0]))
    assert env.simulation.state.base_rotation @ env.axes[2] == pytest.approx(0.1)
    for wrong, problem in (
        ({"actions": ("presure",)}, "there is no 'presure'; did you mean 'pressure'"),
        ({"actions": ("cable_pull",)}, "needs a soft body with a cavity or a cable"),
        ({"actions": ("pressure", "valve")}, "no actuator of the scene is driven by 'valve'"),
        ({"observations": ("tips",)}, "there is no 'tips'; did you mean 'tip'"),
        ({"observations": (lambda env: 3,)}, "a function returned 3: must be a ChannelGroup"),
    ):
        with pytest.raises(SceneError, match=problem):
            type("Wrong", (Pull,), wrong)(scene=str(TINY_GRIPPER))
    for mistaken, problem in (
        (lambda: Travel((1.0, 0.0, 0.0), (0.0, 0.0, 5.0)), "travel: low = .* low below high"),
        (lambda: Travel((0.0, 0.0, 0.0), (0.0, 0.0, 5.0), speed=-1.0), "travel: speed and turning_speed must be above"),
        (lambda: Channel("force", "mN", 1.0, -1.0), "channel 'force': low = 1.0 must not be above high = -1.0"),
    ):
        with pytest.raises(SceneError, match=problem):
            mistaken()


def test_what_a_task_reads_draws_and_gives_is_checked() -> None:
    """A number too many would be an observation outside its space, and a misspelt draw would change nothing."""
    one = (Channel("force", "mN", 0.0, 1.0),)
    for wrong, problem in (
        (
            {"observations": (lambda env: ChannelGroup(one, lambda seen: [0.0, 1.0]),)},
            "'force' reads .*: must be 1 ",
        ),
        ({"randomise": lambda env: {"frict": 0.3}}, r"randomise\(\) drew 'frict'; did you mean 'friction'"),
        ({"reward": lambda env, seen: np.nan}, "reward = nan: must be a finite number"),
        ({"goal_channels": one, "achieved_goal": lambda env, seen: np.zeros(3)}, "achieved_goal = .*shape \\(1,\\)"),
    ):
        env = type("Wrong", (Pull,), wrong)(scene=str(TINY_GRIPPER), goals="goal_channels" in wrong)
        with pytest.raises(SceneError, match=problem):
            env.reset(seed=0)
            env.step(np.zeros(4))


def test_scene_sensors_disturb_readings_alone() -> None:
    scene = taichisoft.load_scene(str(TINY_GRIPPER), ["sensors.object_position={noise=5.0}"])
    env, exact = make("Grasp", scene=scene), make("Grasp")
    first, told = env.reset(seed=1)
    second, _ = env.reset()
    truth, expected = exact.reset(seed=1)
    assert told["lift"] == expected["lift"]
    places = [one[5:8].tobytes() for one in (first, second, truth)]
    assert len(set(places)) == 3
    assert env.reset(seed=1)[0].tobytes() == first.tobytes()


def test_the_scripted_baseline_reaches() -> None:
    assert score("Reach", 1, **FINGER).successes == 1
