"""What the tests of controllers share: a made-up model, and a script that is followed step by step or refused."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from taichisoft import Control, Controller, Observation, Scene
from taichisoft.errors import SceneError
from taichisoft.mechanics import UNLIMITED, ActuatorNames
from taichisoft.mechanics.actuator_kind import limits
from taichisoft.scene.actuators import CableSettings
from taichisoft_controllers.scripted_controller import scripted_controller

CAVITIES = ("left.base", "left.tip", "right.base")
TIME_STEP = 0.01


CABLE_LENGTH = 90.0


class _Actuators(ActuatorNames):
    """Cavities without limits of their own, and cables."""

    def __init__(self, cavities: Sequence[str], cables: Mapping[str, CableSettings]):
        super().__init__({"cavity": cavities, "cable": tuple(cables)})
        free = [limits(None, None)] * len(cavities)
        tensions = [limits(one.lowest_tension, one.highest_tension, UNLIMITED * -one.rod) for one in cables.values()]
        self.sets = {
            "cavity": _made_up_set(np.zeros(len(cavities)), free, free, [False] * len(cavities)),
            "cable": _made_up_set(
                np.full(len(cables), CABLE_LENGTH),
                tensions,
                [limits(one.lowest_pull, one.highest_pull) for one in cables.values()],
                [one.rod for one in cables.values()],
            ),
        }


def _made_up_set(rest_value: np.ndarray, efforts: Any, coordinates: Any, pushes_and_pulls: Sequence[bool]) -> Any:
    return SimpleNamespace(
        rest_value=rest_value,
        effort_range=np.array(efforts).reshape(-1, 2),
        coordinate_range=np.array(coordinates).reshape(-1, 2),
        pushes_and_pulls=pushes_and_pulls,
    )


def made_up_model(
    cavities: Sequence[str] = CAVITIES,
    cubes: Sequence[str] = ("cube",),
    cables: Mapping[str, Mapping[str, Any]] = MappingProxyType({}),
    **tables: Any,
) -> Any:
    """Fingers with these cavities and cables (keys by name), a mat that nothing holds, cubes, a floor and a wall.

    And other tables of a scene.
    """
    soft = {"mesh": "m", "mass": 1.0, "young_modulus": 500.0, "poisson_ratio": 0.3}
    held = {**soft, "anchors": [{"group": "base"}]}
    scene = Scene.model_validate(
        {
            "gravity": [-9810.0, 0.0, 0.0],
            "soft_bodies": {**{name.partition(".")[0]: held for name in (*cavities, *cables)}, "mat": soft},
            "rigid_bodies": {name: {"box": [10.0, 10.0, 10.0], "mass": 0.001} for name in cubes},
            "obstacles": {
                "floor": {"plane": {"point": [0.0, 0.0, 0.0], "normal": [1.0, 0.0, 0.0]}},
                "wall": {"plane": {"point": [0.0, -99.0, 0.0], "normal": [0.0, 1.0, 0.0]}},
            },
            **tables,
        }
    )
    return SimpleNamespace(
        scene=scene,
        body_names=(*scene.soft_bodies, *cubes, *scene.obstacles),
        soft_bodies=[SimpleNamespace(name=name) for name in scene.soft_bodies],
        rigid_bodies=[SimpleNamespace(name=name, start_position=np.array([5.0, 0.0, 0.0])) for name in cubes],
        obstacles=[SimpleNamespace(name=name) for name in scene.obstacles],
        actuators=_Actuators(
            cavities, {name: CableSettings(points="points.csv", **keys) for name, keys in cables.items()}
        ),
        cavities=SimpleNamespace(names=tuple(cavities)),
        cables=SimpleNamespace(
            names=tuple(cables),
            all=[
                SimpleNamespace(
                    name=name, rest_length=CABLE_LENGTH, settings=CableSettings(points="points.csv", **keys)
                )
                for name, keys in cables.items()
            ],
        ),
    )


def write(folder: Path, content: str, name: str = "script.toml") -> Path:
    """A script's file."""
    path = folder / name
    path.write_text(content, encoding="utf-8")
    return path


def refusal(path: Path, begin: Callable[[Path], Any] = scripted_controller) -> str:
    """What is said of a script that is refused, in one line, after the name of its file."""
    with pytest.raises(SceneError) as refused:
        begin(path)
    said = str(refused.value)
    assert said.startswith(f"{path}: ") and len(said.splitlines()) == 1
    return said.removeprefix(f"{path}: ")


def controller_of(
    folder: Path, content: str, name: str = "script.toml", model: Any = None, **settings: Any
) -> Controller:
    """A controller with a script, ready to begin."""
    controller = scripted_controller(write(folder, content, name), **settings)
    controller.reset(model or made_up_model())
    return controller


def observation(time: float, force: float = 0.0, **changes: Any) -> Observation:
    """What is seen at a time [s], with a force of the left finger on the cube [mN]."""
    values: dict[str, Any] = {
        "pressures": dict.fromkeys(CAVITIES, 0.0),
        "normal_forces": {("left", "cube"): force},
        "object_positions": {"cube": np.zeros(3)},
    }
    return Observation(time, round(time / TIME_STEP), **{**values, **changes})


def follow(
    controller: Controller, until: float, force: Callable[[float], float] = lambda time: 0.0
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
