"""Fingers of dimensions of one's own, of silicone whose Poisson's ratio is 0.499: they bend, and they grasp."""

import math
import warnings
from typing import Any

import numpy as np
import pytest
from conftest import Figures

from taichisoft import Control, Simulation
from taichisoft.scene import scene_from_dict

FINGER = {
    "body": {"length": 76.0, "width": 28.0, "height": 26.0},
    "slots": {"count": 3, "depth": 14.0},
    "channel": {"end": 60.0, "width": 22.0, "bottom": 16.5, "top": 19.0},
    "chambers": {"count": 4, "depth": 22.0, "height": 9.0, "width": 5.0},
    "stiff_layer": {"thickness": 4.0, "bottom": 20.5, "end": 61.0, "width": 24.0},
}
"""What is changed of the tutorial's finger: four wide, flat chambers instead of seven."""
GRAVITY = [-9810.0, 0.0, 0.0]
PRESSURE = 20.0
AXIS, SIDE = 49.0, 30.0
"""Where the axis of the gripper is along y, and edge of the cube [mm]."""


def finger(**keys: Any) -> dict[str, Any]:
    """The finger's table; a scene that names no element takes smoothed ones."""
    return {
        "mesh": {"file": "tutorial.toml", "set": FINGER},
        "density": 1.08e-6,
        "law": "neo-hookean",
        "young_modulus": 500.0,
        "poisson_ratio": 0.499,
        "rayleigh_mass": 0.1,
        "rayleigh_stiffness": 0.01,
        "anchors": [{"group": "base"}],
        "regions": [{"group": "stiff_layer", "young_modulus": 1500.0}],
        "cavities": {"cavity": {"group": "cavity"}},
        **keys,
    }


def made(**tables: Any) -> Simulation:
    """A simulation of which nobody warns that it locks."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        simulation = Simulation(scene_from_dict({"gravity": GRAVITY, **tables}))
    assert not [one for one in said if "lock" in str(one.message)]
    return simulation


def test_a_finger_of_smoothed_elements_bends_nearly_as_one_of_quadratic_ones(figures: Figures) -> None:
    """Largest displacement at 20 kPa after 0.6 s. What locks would leave a tenth: linear elements bend by 1.2 mm.

    On walls of one element smoothed ones are some 20 % too stiff; 25 % is the bound.
    """
    bends = {}
    for element in ("smoothed", "quadratic"):
        simulation = made(soft_bodies={"finger": finger(element=element)})
        for step in range(60):
            assert simulation.step(Control({"finger.cavity": PRESSURE * min(1.0, step / 30)})).converged
        motion = simulation.state.position - simulation.model.rest_position
        bends[element] = float(np.linalg.norm(motion, axis=1).max())
    assert bends["quadratic"] == pytest.approx(20.2, rel=0.05)  # another gmsh makes another mesh
    figures.close("bend of smoothed over quadratic [-]", bends["smoothed"] / bends["quadratic"], 1.0, 0.25)


def test_three_of_them_lift_a_cube(figures: Figures) -> None:
    """20 g at 20 kPa and friction 0.8: up by 25 mm in 0.4 s, and held; every step converges.

    The fingers give way to the weight by less than 1 mm. Creep in the last 0.2 s: bound 0.01 mm.
    """
    fingers = {"finger1": finger()}
    for number, side in ((2, 1), (3, -1)):
        turn = {"rotation": [-120.0 * (number - 1), 0.0, 0.0]}
        shift = {"translation": [0.0, 1.5 * AXIS, side * AXIS * math.sqrt(3) / 2]}
        fingers[f"finger{number}"] = {"like": "finger1", **turn, **shift}
    cube = {"box": [SIDE] * 3, "mass": 0.02, "position": [-66.0, AXIS, 0.0]}
    floor = {"plane": {"point": [-66.0 - SIDE / 2 - 1.0, 0.0, 0.0], "normal": [1.0, 0.0, 0.0]}}
    simulation = made(
        soft_bodies=fingers,
        rigid_bodies={"cube": cube},
        obstacles={"floor": floor},
        contact={"friction": 0.8, "contact_distance": 1.0, "alarm_distance": 5.0},
    )
    assert {body.settings.element for body in simulation.model.soft_bodies} == {"smoothed"}
    places = []
    for time in 0.01 * np.arange(130):
        pressure = PRESSURE * min(1.0, time / 0.4)
        base = np.array([25.0 * min(1.0, max(0.0, (time - 0.5) / 0.4)), 0.0, 0.0])
        report = simulation.step(
            Control(dict.fromkeys(simulation.model.cavities.names, pressure), base_translation=base)
        )
        assert report.converged
        places.append(simulation.state.rigid_position[0])
    figures.close("lift of the cube [mm]", float(places[-1][0]) + 66.0, 25.0, 1.0)
    figures.at_most("creep in the last 0.2 s [mm]", float(np.linalg.norm(places[-1] - places[-21])), 0.01)
