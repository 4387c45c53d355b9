"""A made-up run for the tests of the output "csv". `python csv_run.py FOLDER` goes on until it is killed."""

import sys
from itertools import count
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from taichisoft import Observation, Scene
from taichisoft.mechanics import ActuatorNames
from taichisoft_outputs.csv_output import BUFFERED_STEPS, CsvOutput

STEP = 0.01
RUBBER = {"mass": 1.0, "young_modulus": 500.0, "poisson_ratio": 0.3}


def model() -> Any:
    """Two fingers, two cubes and a floor; gravity along -x."""
    return SimpleNamespace(
        scene=Scene.model_validate(
            {
                "gravity": [-9810.0, 0.0, 0.0],
                "soft_bodies": {
                    "left": {"mesh": "m", "anchors": [{"group": "g"}], **RUBBER},
                    "right": {"mesh": "m", **RUBBER},
                },
                "rigid_bodies": {name: {"box": [1.0, 1.0, 1.0], "mass": 1.0} for name in ("cube", "ball")},
            }
        ),
        soft_bodies=[SimpleNamespace(name=name) for name in ("left", "right")],
        rigid_bodies=[
            SimpleNamespace(name=name, collides=True, follows=None, start_position=np.array(place))
            for name, place in (("cube", [5.0, 1.0, 2.0]), ("ball", [7.0, 3.0, 4.0]))
        ],
        obstacles=[SimpleNamespace(name="floor")],
        actuators=ActuatorNames({"cavity": ("left.air", "right.base", "right.tip"), "cable": ("right.tendon",)}),
    )


def report(step: int, **changes: Any) -> Any:
    """Of a step: the cubes rise by 1 and 2 mm in each."""
    seen: dict[str, Any] = {
        "base_translation": np.array([0.1, 0.2, 0.3]) * step,
        "base_rotation": np.array([0.0, 0.0, np.pi / 180]) * step,
        "object_positions": {
            "cube": np.array([5.0 + step, 1.0, 2.0]),
            "ball": np.array([7.0 + 2.0 * step, 3.0, 4.0]),
        },
        "pressures": {"left.air": 1.0 * step, "right.base": 2.0 * step, "right.tip": 3.0 * step},
        "volumes": {"left.air": 100.0, "right.base": 200.0, "right.tip": 300.0 + 1.0 / 3.0},
        "air_masses": {"left.air": 1e-7, "right.base": 2e-7, "right.tip": 3e-7 * step},
        "air_flows": {"left.air": 1e-6 * step, "right.base": 2e-6, "right.tip": -3e-6},
        "valve_openings": {"left.air": 0.5, "right.base": -0.5, "right.tip": 0.0},
        "cable_tensions": {"right.tendon": 400.0 * step},
        "cable_pulls": {"right.tendon": -0.5 * step},
        "cable_lengths": {"right.tendon": 90.0 + 0.5 * step},
        "tip_positions": {"left": np.array([1.0, 2.0, 3.0]) * step},
        "bending_angles": {"left": np.radians(5.0 * step)},
        "normal_forces": {("left", "cube"): 10.0 * step, ("cube", "floor"): 9.81, ("left", "right"): 99.0},
        "friction_forces": {("left", "cube"): 1.0 * step},
        "slip_speeds": {("cube", "ball"): 0.5},
        "contact_areas": {("left", "cube"): 12.0},
        "contact_area_errors": {("left", "cube"): 2.0},
        "peak_pressures": {("left", "cube"): 6.5},
        "peak_pressure_errors": {("left", "cube"): 0.5},
        "external_forces": dict.fromkeys(("left", "right", "cube", "ball", "base"), np.array([0.0, 0.0, 7.0]) * step),
        "base_force": np.array([1.0, 2.0, 3.0]) * step,
        "base_torque": np.array([4.0, 5.0, 6.0]) * step,
        "base_force_in_base": np.array([2.0, -1.0, 3.0]) * step,
        "base_torque_in_base": np.array([5.0, -4.0, 6.0]) * step,
        "clipped": (),
    }
    signals = changes.pop("signals", {"set_point": 60.0, "error": -step})
    observation = Observation(step * STEP, step, **{**seen, **changes})
    return SimpleNamespace(time=step * STEP, signals=signals, observation=observation)


if __name__ == "__main__":
    endless = CsvOutput(Path(sys.argv[1]))
    endless.begin(model(), None)  # type: ignore[arg-type]
    for number in count(1):
        endless.record(None, report(number))  # type: ignore[arg-type]
        if number == 2 * BUFFERED_STEPS:
            print("ready", flush=True)
            sys.stdin.read()  # stand still until it is killed
