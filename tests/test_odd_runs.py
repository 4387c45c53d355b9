"""Random inputs of a run: paths of the base, actions, states, settings, meshes at rest and bodies that burst."""

import dataclasses
import json
import os
import random
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from mistaken_input import base_scene
from scipy.spatial.transform import Rotation

from taichisoft.base import PYTHON
from taichisoft_benchmarks.one_body import simulation_of
from taichisoft_benchmarks.regular_meshes import bar, hollow_sphere

BOUND = 1e-6
"""Farthest that an unloaded anchored node may be from where the base has it [mm]."""
STEPS = 30
"""Steps of a path of the base."""
NAME = "tries of settings"
NONSENSE: list[Any] = [
    None, "up", b"up", {}, [], [[]], 0.5, float("nan"), float("inf"), 1j, [1j] * 3, [[0.0], 0.0, 0.0],
]  # fmt: skip
SETTINGS: list[Any] = ["abc", "", "1", True, [], [1.0], ["a"], {}, {"a": 1.0}]
"""Values of settings that are not numbers."""


def base_paths(tries: int) -> list[str]:
    """Six-dimensional paths at 10 to 500 mm/s with turns and stops: anchored nodes are where the observed pose is."""
    return [
        f"path {number}: off by {lag:.2g} mm" for number in range(tries) if not (lag := largest_lag(number)) <= BOUND
    ]


def largest_lag(number: int) -> float:
    """How far anchored nodes are from their places in the steps of a path [mm]."""
    import taichisoft as ts

    dice = np.random.default_rng(number)
    pad = base_scene()["soft_bodies"]["left"] | {
        "element": ["linear", "smoothed", "quadratic"][dice.integers(3)],
        "law": ["hooke", "neo-hookean"][dice.integers(2)],
        "rayleigh_mass": dice.uniform(0.0, 1.0),
        "rayleigh_stiffness": dice.uniform(0.0, 0.1),
    }
    time = {"step": [0.002, 0.01][dice.integers(2)], "newton": [1, 10][dice.integers(2)]}
    simulation = ts.Simulation(ts.scene_from_dict({"gravity": [0.0] * 3, "time": time, "soft_bodies": {"pad": pad}}))
    model, worst, control = simulation.model, 0.0, ts.Control()
    held = model.rest_position[model.anchored_nodes] - model.base_pivot
    for step in range(STEPS):
        if step % 10 == 0:
            speed, turning = dice.uniform(10.0, 500.0), dice.uniform(0.0, 3.0)
            moving = 0.0 if step == 20 else 1.0
            control = ts.Control(
                base_velocity=moving * speed * _way(dice), base_angular_velocity=moving * turning * _way(dice)
            )
        simulation.step(control)
        seen = simulation.observe()
        places = Rotation.from_rotvec(seen.base_rotation).apply(held) + model.base_pivot + seen.base_translation
        worst = max(worst, float(np.abs(simulation.state.position[model.anchored_nodes] - places).max()))
    return worst


def _way(dice: np.random.Generator) -> np.ndarray:
    way = dice.standard_normal(3)
    return cast(np.ndarray, way / np.linalg.norm(way))


def _environment() -> Any:
    import gymnasium

    import taichisoft_gym  # noqa: F401
    from taichisoft.pytest_fixtures import TINY_GRIPPER

    return gymnasium.make("taichisoft/Grasp-v0", scene=str(TINY_GRIPPER), disable_env_checker=True).unwrapped


def wrong_actions(tries: int) -> list[str]:
    """Wrong actions are refused in one line; numbers beyond the space count as its ends for motion and reward."""
    environment, failures = _environment(), []
    for number in range(tries):
        dice = random.Random(f"action {number}")
        environment.reset(seed=0)
        beyond = np.array([dice.uniform(-3.0, 3.0) for _ in range(3)])
        if dice.random() < 0.5:
            wrong = dice.choice([*NONSENSE, beyond[:2], [*beyond, 0.0], [*beyond[:2], float("nan")], ["a", "b", "c"]])
            failures += _unless_refused(f"action {wrong!r}", environment.step, wrong)
            continue
        one = environment.step(beyond)[:2]
        environment.reset(seed=0)
        other = environment.step(np.clip(beyond, -1.0, 1.0))[:2]
        if one[0].tobytes() != other[0].tobytes() or one[1] != other[1]:
            failures.append(f"action {beyond} differs from the one at the ends of the space")
    return failures


def wrong_states(tries: int) -> list[str]:
    """A state with other values than finite numbers is refused in one line, and the environment goes on."""
    environment, failures = _environment(), []
    failures += [] if _raises(environment.step, np.zeros(3)) == "ResetNeeded" else ["a step before reset"]
    environment.reset(seed=0)
    good = environment.simulation.state
    names = [field.name for field in dataclasses.fields(good)]
    for number in range(tries):
        dice = random.Random(f"state {number}")
        name = dice.choice([one for one in names if np.size(getattr(good, one))])
        value = np.array(getattr(good, name))
        spoilt: list[Any] = [np.full(value.shape, "x"), "x", None, value.astype(object)]
        if value.dtype.kind == "f":
            spoilt.append(np.full(value.shape, dice.choice([np.nan, np.inf])))
        wrong = dice.choice([*NONSENSE[1:], *(good.changed(**{name: one}) for one in spoilt)])
        shown = f"state with another {name}" if not isinstance(wrong, str) else wrong
        failures += _unless_refused(shown, lambda state: environment.reset(options={"state": state}), wrong)
        environment.reset(seed=0)
        environment.step(np.zeros(3))
    return failures


def wrong_settings(tries: int) -> list[str]:
    """Settings of other types than a plug-in's controller declares are refused before the controller is made."""
    import taichisoft as ts
    from taichisoft.pytest_fixtures import TINY_GRIPPER

    class Squeeze(ts.Controller):
        def __init__(self, force: float = 20.0, fingers: tuple[str, ...] = ()):
            raise AssertionError("made with wrong settings")

        def control(self, observation: ts.Observation) -> ts.Control:
            return ts.Control()

    class Plugin:
        @ts.hookimpl
        def taichisoft_controllers(self) -> dict[str, Any]:
            return {"squeeze": Squeeze}

    plugin, failures = Plugin(), []
    ts.register_plugin(plugin, NAME)
    try:
        for number in range(tries):
            dice = random.Random(f"settings {number}")
            key, values = dice.choice(
                [("force", SETTINGS), ("fingers", ["left", 1.0, [1.0], {}, True]), ("forse", [1.0])]
            )
            settings = {key: dice.choice(values)}
            scene = ts.load_scene(str(TINY_GRIPPER)).model_dump(mode="json", exclude_none=True)
            scene["controller"] = {"name": "squeeze", "settings": settings}
            failures += _unless_refused(f"settings {settings}", ts.make_controller, ts.scene_from_dict(scene))
    finally:
        ts.unregister_plugin(NAME)
    return failures


def _raises(ask: Callable[[Any], Any], wrong: Any) -> str:
    """Name of the raised exception; empty for an error of the product in one line."""
    from taichisoft.errors import PluginError, TaichisoftError

    try:
        ask(wrong)
    except TaichisoftError as error:
        one_line = "\n" not in str(error) and not isinstance(error, PluginError)
        return "" if one_line else f"{type(error).__name__}: {error}"
    except Exception as error:
        return type(error).__name__
    return "nothing is raised"


def _unless_refused(shown: str, ask: Callable[[Any], Any], wrong: Any) -> list[str]:
    problem = _raises(ask, wrong)
    return [f"{shown}: {problem}"] if problem else []


EXPLODING = """
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


def turned_meshes(tries: int) -> list[str]:
    """Boxes of smoothed rubber at rest, turned at random: a step leaves them where they are."""
    from taichisoft.errors import TaichisoftError

    failures = []
    for number in range(tries):
        random = np.random.default_rng(number)
        box = bar(tuple(random.integers(2, 6, 3)), tuple(random.uniform(5.0, 60.0, 3)))
        turn = Rotation.random(rng=random).as_euler("xyz", degrees=True).tolist()
        ratio = float(random.uniform(0.3, 0.499))
        keys: dict[str, Any] = {"law": "neo-hookean", "young_modulus": 200.0, "poisson_ratio": ratio, "rotation": turn}
        try:
            simulation = simulation_of(box, {}, **keys)
            simulation.step()
        except TaichisoftError as error:
            failures.append(f"{number}: {error}")
            continue
        if not np.abs(simulation.state.position - simulation.model.rest_position).max() < 1e-8:
            failures.append(f"{number}: moves at rest")
    return failures


def exploded_scenes(tries: int) -> list[str]:
    """Balloons of soft silicone under 1 to 100 kPa: a run that ends far beyond its law has not completed."""
    from taichisoft.mesh import write_volume_mesh

    failures = []
    for number in range(tries):
        random = np.random.default_rng(number)
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            write_volume_mesh(hollow_sphere(10.0, float(random.uniform(10.5, 13.0)), 2, 1), folder / "ball.msh")
            pressure, material = 10.0 ** random.uniform(0.0, 2.0), SOFT[random.integers(len(SOFT))]
            (folder / "ball.toml").write_text(EXPLODING.format(pressure=pressure, material=material))
            words = ["run", "ball.toml", "--outputs", "metrics", "-o", "out"]
            run = subprocess.run(
                [*PYTHON, "-m", "taichisoft", *words],
                cwd=folder,
                env={**os.environ, "TAICHISOFT_THREADS": "1"},
                capture_output=True,
                text=True,
            )
            figures = json.loads((folder / "out" / "metrics.json").read_text())
            inside_out = figures.get("inverted_elements_at_end", 0)
            burst = inside_out or figures.get("stretch_99_percent", {}).get("ball", 1.0) > BEYOND
            if bool(burst) == (run.returncode == 0) and figures["outcome"].startswith(("completed", "beyond")):
                failures.append(f"{number}: exit code {run.returncode}, {inside_out} inside out: {figures['outcome']}")
    return failures


@pytest.mark.parametrize(
    "attempt",
    [base_paths, wrong_actions, wrong_states, wrong_settings, turned_meshes, exploded_scenes],
    ids=lambda attempt: attempt.__name__,
)
def test_random_inputs_of_a_run(attempt: Callable[[int], list[str]]) -> None:
    assert attempt(2) == []
