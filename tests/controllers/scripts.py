"""What the tests of scripts share: a made-up model, and a script that is followed step by step."""

from collections.abc import Callable, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from taichisoft.control.control import Control
from taichisoft.control.observation import Observation
from taichisoft.scenes.scene import Scene
from taichisoft_controllers.scripted.controller import ScriptedController

CAVITIES = ("left.base", "left.tip", "right.base")
TIME_STEP = 0.01


def made_up_model(cavities: Sequence[str] = CAVITIES) -> Any:
    """Fingers with these cavities, and a cube."""
    finger = {"mesh": "m", "mass": 1.0, "young_modulus": 500.0, "poisson_ratio": 0.3, "anchors": [{"group": "base"}]}
    fingers = list(dict.fromkeys(cavity.partition(".")[0] for cavity in cavities))
    scene = Scene.model_validate(
        {
            "soft_bodies": dict.fromkeys(fingers, finger),
            "rigid_bodies": {"cube": {"box": [10.0, 10.0, 10.0], "mass": 0.001}},
        }
    )
    return SimpleNamespace(
        scene=scene,
        gravity=np.array(scene.gravity),
        body_names=(*fingers, "cube"),
        soft_bodies=[SimpleNamespace(name=name) for name in fingers],
        rigid_bodies=[SimpleNamespace(name="cube", start_position=np.zeros(3))],
        obstacles=[],
        cavities=SimpleNamespace(names=tuple(cavities)),
    )


def write(folder: Path, content: str, name: str = "script.toml") -> Path:
    """A script's file."""
    path = folder / name
    path.write_text(content, encoding="utf-8")
    return path


def controller_of(folder: Path, content: str, name: str = "script.toml", **settings: Any) -> ScriptedController:
    """A controller with a script, ready to begin."""
    controller = ScriptedController(write(folder, content, name), **settings)
    controller.reset(made_up_model())
    return controller


def observation(time: float, force: float = 0.0, **changes: Any) -> Observation:
    """What is seen at a time [s], with a force of the left finger on the cube [mN]."""
    values: dict[str, Any] = {
        "pressures": dict.fromkeys(CAVITIES, 0.0),
        "normal_forces": {"left|cube": force},
        "object_positions": {"cube": np.zeros(3)},
    }
    return Observation(time, round(time / TIME_STEP), **{**values, **changes})


def follow(
    controller: ScriptedController, until: float, force: Callable[[float], float] = lambda time: 0.0
) -> dict[float, Control]:
    """What it asks for by time [s], rounded, from 0 to `until`; the force on the cube depends on the time."""
    asked, time = {}, 0.0
    while time < until + 0.5 * TIME_STEP:
        asked[round(time, 6)] = controller.control(observation(time, force(time)))
        time += TIME_STEP  # a sum, with the round-off of the engine's own
    return asked


def pressures(control: Control) -> list[float]:
    """[kPa] in the order of CAVITIES."""
    return [control.pressure[name] for name in CAVITIES]
