"""Random inputs of a run: paths of the base, actions, states, settings, meshes at rest and bodies that burst."""

import dataclasses
import json
import os
import random
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from test_odd_input import base_scene

import taichisoft as ts
from taichisoft.base import PYTHON
from taichisoft.errors import PluginError, TaichisoftError
from taichisoft.mesh import write_volume_mesh
from taichisoft.pytest_fixtures import TINY_GRIPPER
from taichisoft_benchmarks.one_body import simulation_of
from taichisoft_benchmarks.regular_meshes import bar, hollow_sphere

NONSENSE: list[Any] = [
    None, "up", b"up", {}, [], [[]], 0.5, float("nan"), float("inf"), 1j, [1j] * 3, [[0.0], 0.0, 0.0],
]  # fmt: skip
SETTINGS: list[Any] = ["abc", "", "1", True, [], [1.0], ["a"], {}, {"a": 1.0}]
"""Values of settings that are not numbers."""
SEEDS = pytest.mark.parametrize("seed", range(2))


def refuse(function: Callable[[Any], Any], wrong: Any) -> None:
    """Assert that a value is refused in one line, which does not blame a plug-in."""
    with pytest.raises(TaichisoftError) as refused:
        function(wrong)
    assert "\n" not in str(refused.value) and not isinstance(refused.value, PluginError)


@SEEDS
def test_anchors_follow_random_paths_of_base(seed: int) -> None:
    """Six-dimensional paths at 10 to 500 mm/s with turns and stops: anchored nodes are where the observed pose is."""
    dice = np.random.default_rng(seed)
    pad = base_scene()["soft_bodies"]["left"] | {
        "element": ["linear", "smoothed", "quadratic"][dice.integers(3)],
        "law": ["hooke", "neo-hookean"][dice.integers(2)],
        "rayleigh_mass": dice.uniform(0.0, 1.0),
        "rayleigh_stiffness": dice.uniform(0.0, 0.1),
    }
    time = {"step": [0.002, 0.01][dice.integers(2)], "newton": [1, 10][dice.integers(2)]}
    simulation = ts.Simulation(ts.scene_from_dict({"gravity": [0.0] * 3, "time": time, "soft_bodies": {"pad": pad}}))
    model, control = simulation.model, ts.Control()
    held = model.rest_position[model.anchored_nodes] - model.base_pivot

    def direction() -> np.ndarray:
        vector = dice.standard_normal(3)
        return np.asarray(vector / np.linalg.norm(vector))

    for step in range(30):
        if step % 10 == 0:
            speed, turning = dice.uniform(10.0, 500.0), dice.uniform(0.0, 3.0)
            moving = 0.0 if step == 20 else 1.0
            control = ts.Control(
                base_velocity=moving * speed * direction(), base_angular_velocity=moving * turning * direction()
            )
        simulation.step(control)
        seen = simulation.observe()
        places = Rotation.from_rotvec(seen.base_rotation).apply(held) + model.base_pivot + seen.base_translation
        assert np.abs(simulation.state.position[model.anchored_nodes] - places).max() <= 1e-6


@pytest.fixture(scope="module")
def environment() -> Any:
    import gymnasium

    import taichisoft_gym  # noqa: F401

    return gymnasium.make("taichisoft/Grasp-v0", scene=str(TINY_GRIPPER), disable_env_checker=True).unwrapped


@SEEDS
def test_wrong_actions_are_refused(environment: Any, seed: int) -> None:
    """Numbers beyond the space count as its ends, for motion and reward."""
    dice = random.Random(f"action {seed}")
    environment.reset(seed=0)
    beyond = np.array([dice.uniform(-3.0, 3.0) for _ in range(3)])
    refuse(
        environment.step,
        dice.choice([*NONSENSE, beyond[:2], [*beyond, 0.0], [*beyond[:2], float("nan")], ["a", "b", "c"]]),
    )
    first = environment.step(beyond)[:2]
    environment.reset(seed=0)
    second = environment.step(np.clip(beyond, -1.0, 1.0))[:2]
    assert first[0].tobytes() == second[0].tobytes() and first[1] == second[1]


@SEEDS
def test_wrong_states_are_refused(environment: Any, seed: int) -> None:
    """Other values than finite numbers are refused, and the environment still works; not before the first reset."""
    from gymnasium.error import ResetNeeded

    fresh = type(environment)(scene=str(TINY_GRIPPER))
    with pytest.raises(ResetNeeded):
        fresh.step(np.zeros(3))
    environment.reset(seed=0)
    good, dice = environment.simulation.state, random.Random(f"state {seed}")
    name = dice.choice([field.name for field in dataclasses.fields(good) if np.size(getattr(good, field.name))])
    value = np.array(getattr(good, name))
    spoilt: list[Any] = [np.full(value.shape, "x"), "x", None, value.astype(object)]
    if value.dtype.kind == "f":
        spoilt.append(np.full(value.shape, dice.choice([np.nan, np.inf])))
    for wrong in (dice.choice(NONSENSE[1:]), good.changed(**{name: dice.choice(spoilt)})):
        refuse(lambda state: environment.reset(options={"state": state}), wrong)
        environment.reset(seed=0)
        environment.step(np.zeros(3))


@pytest.fixture
def squeeze() -> Iterator[None]:
    """A plug-in whose controller is never made."""

    class Squeeze(ts.Controller):
        def __init__(self, force: float = 20.0, fingers: tuple[str, ...] = ()):
            raise AssertionError("made with wrong settings")

        def control(self, observation: ts.Observation) -> ts.Control:
            return ts.Control()

    class Plugin:
        @ts.hookimpl
        def taichisoft_controllers(self) -> dict[str, Any]:
            return {"squeeze": Squeeze}

    name = ts.register_plugin(Plugin(), "squeezing")
    yield
    ts.unregister_plugin(name)


@pytest.mark.parametrize(
    ("key", "values"), [("force", SETTINGS), ("fingers", ["left", 1.0, [1.0], {}, True]), ("forse", [1.0])]
)
def test_wrong_settings_are_refused(squeeze: None, key: str, values: list[Any]) -> None:
    scene = ts.load_scene(str(TINY_GRIPPER)).model_dump(mode="json", exclude_none=True)
    for value in values:
        scene["controller"] = {"name": "squeeze", "settings": {key: value}}
        refuse(ts.make_controller, ts.scene_from_dict(scene))


@SEEDS
def test_turned_boxes_stay_at_rest(seed: int) -> None:
    """Boxes of smoothed rubber, turned at random: a step leaves them where they are."""
    dice = np.random.default_rng(seed)
    box = bar(tuple(dice.integers(2, 6, 3)), tuple(dice.uniform(5.0, 60.0, 3)))
    turn = Rotation.random(rng=dice).as_euler("xyz", degrees=True).tolist()
    ratio = float(dice.uniform(0.3, 0.499))
    simulation = simulation_of(box, {}, law="neo-hookean", young_modulus=200.0, poisson_ratio=ratio, rotation=turn)
    simulation.step()
    assert np.abs(simulation.state.position - simulation.model.rest_position).max() < 1e-8


BALLOON = """
[time]
step = 0.01
duration = 0.5
[controller]
name = "scripted"
settings = {{ script = "inflate", pressure = {pressure} }}
[limits]
pressure_rate = 1e4
[soft_bodies.ball]
mesh = "ball.msh"
material = "{material}"
rayleigh_stiffness = 0.02
cavities = {{ air = {{ group = "cavity" }} }}
"""
SOFT = ("ecoflex-00-10", "ecoflex-00-30", "ecoflex-00-50", "dragon-skin-fx-pro-slacker")
BEYOND = 6.0
"""Twice the stretch up to which these materials are fitted."""


@SEEDS
def test_burst_balloons_have_not_completed(tmp_path: Path, seed: int) -> None:
    """Balloons of soft silicone under 1 to 100 kPa: a run that ends far beyond its law has not completed."""
    dice = np.random.default_rng(seed)
    write_volume_mesh(hollow_sphere(10.0, float(dice.uniform(10.5, 13.0)), 2, 1), tmp_path / "ball.msh")
    pressure, material = 10.0 ** dice.uniform(0.0, 2.0), SOFT[dice.integers(len(SOFT))]
    (tmp_path / "ball.toml").write_text(BALLOON.format(pressure=pressure, material=material))
    words = ["run", "ball.toml", "--outputs", "metrics", "-o", "out"]
    run = subprocess.run(
        [*PYTHON, "-m", "taichisoft", *words],
        cwd=tmp_path,
        env={**os.environ, "TAICHISOFT_THREADS": "1"},
        capture_output=True,
        text=True,
    )
    figures = json.loads((tmp_path / "out" / "metrics.json").read_text())
    inside_out = figures.get("inverted_elements_at_end", 0)
    burst = inside_out or figures.get("stretch_99_percent", {}).get("ball", 1.0) > BEYOND
    if figures["outcome"].startswith(("completed", "beyond")):
        assert (run.returncode == 0) == (not burst), figures["outcome"]
