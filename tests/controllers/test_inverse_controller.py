"""The controller "inverse": a tip follows a path, and what is out of reach ends the run before it begins."""

import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from taichisoft import Controller, Simulation, load_scene, make_controller
from taichisoft.errors import ControllerFailed, SceneError
from taichisoft.pytest_fixtures import TINY_GRIPPER
from taichisoft.scene import key_descriptions
from taichisoft_controllers.inverse_controller import InverseSettings

ALONE = ("rigid_bodies={}", "limits={}", "gravity=[0.0, 0.0, 0.0]", "soft_bodies.left.rayleigh_stiffness=0.005")
PATH = [[0.0, 0.0, 0.0, 0.0], [0.5, 1.5, 0.0, 0.5], [0.8, 1.0, 0.0, 0.0]]
BOUNDS = {"pressure.left.cavity": [0.0, 20.0], "base_translation.x": [-5.0, 5.0], "base_translation.z": [-5.0, 5.0]}
FIGURE = "tip_positions.left"


def made(**settings: Any) -> tuple[Simulation, Controller]:
    settings = {"figure": FIGURE, "path": PATH, "relative": True, "bounds": BOUNDS} | settings
    scene = load_scene(TINY_GRIPPER, ALONE)
    assert scene.controller is not None
    controller = scene.controller.model_copy(update={"name": "inverse", "settings": settings})
    scene = scene.model_copy(update={"controller": controller})
    return Simulation(scene), make_controller(scene)


def test_a_tip_follows_a_path() -> None:
    """It moves at 3 mm/s, and lags by a few hundredths of a millimetre, since damping takes time."""
    simulation, controller = made()
    controller.reset(simulation.model)
    rest = simulation.observe().tip_positions["left"]
    times, places = np.array(PATH)[:, 0], np.array(PATH)[:, 1:]
    off = []
    for _ in range(100):
        simulation.step(controller.control(simulation.observe()))
        seen = simulation.observe()
        goal = rest + [np.interp(seen.time, times, column) for column in places.T]
        off.append(float(np.linalg.norm(seen.tip_positions["left"] - goal)))
    assert max(off) < 0.1 and off[-1] < 1e-3
    assert controller.base_stops_at(simulation.observe()) == pytest.approx(1.0)
    other = made()[1]
    other.reset(simulation.model)
    other.restore(controller.save())
    assert other.control(simulation.observe()).pressure == controller.control(simulation.observe()).pressure


@pytest.mark.parametrize(
    ("settings", "error", "message"),
    [
        ({"path": [[0.0, 0.0, 90.0, 0.0]]}, ControllerFailed, "controller.settings.path: tip_positions.left cannot be"),
        ({"path": [[0.0, 0.0]]}, SceneError, "must have 4 numbers in a row, a time and tip_positions.left"),
        ({"path": [[0.0], [1.0]]}, SceneError, "each row must be a time and a value"),
        ({"path": [[0.0, 1.0], [0.0, 2.0]]}, SceneError, "times must rise from row to row"),
        ({"path": []}, SceneError, "controller.settings.path"),
        ({"bounds": {}}, SceneError, "controller.settings.bounds"),
        ({"bounds": {"pressure.left": [0.0, 1.0]}}, SceneError, "no cavity is called 'left'"),
        ({"figure": "tip_positions.middle"}, SceneError, "tip_positions has no 'middle'"),
        ({"figure": ""}, SceneError, "controller.settings.figure: which of 2 fingers?"),
        ({"spacings": 1.0}, SceneError, "spacings"),
    ],
)
def test_what_cannot_be_followed_is_said(settings: dict[str, Any], error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=re.escape(message)) as refused:
        simulation, controller = made(**settings)
        controller.reset(simulation.model)
    assert "\n" not in str(refused.value)


def test_the_guide_has_every_setting_and_its_scene_is_valid() -> None:
    guide = (Path(__file__).resolve().parents[2] / "docs" / "controllers.md").read_text(encoding="utf-8")
    section = guide.partition("\n## Inverse\n")[2]
    for key, meaning in key_descriptions(InverseSettings).items():
        assert re.search(rf"^\| `{key}` \| .* \| {re.escape(meaning)} \|$", section, re.MULTILINE), key
    (scene,) = re.findall(r"```toml\n(.*?)```", section, re.DOTALL)
    shown = tomllib.loads(scene)["controller"]
    assert shown["name"] == "inverse" and InverseSettings.checked(**shown["settings"]).relative
