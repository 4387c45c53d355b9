"""Law: a body of rubber that a pressure bends moves as fast in long steps as in short ones.

The pressure pulls its walls to up to twice their length. As they turn with the body, their stresses turn with them, and
so does the pressure: a linearisation that holds either back slows the motion as a large viscosity would.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from conftest import Figures
from scenes import simulate

from taichisoft.control.control import Control

PRESSURE, RISE, DURATION = 25.0, 0.1, 0.2
FAR = 5.0


def bend(body: dict[str, Any], step: float) -> tuple[np.ndarray, np.ndarray]:
    """Times [s] and distances of the tip from where it was at rest [mm]."""
    simulation = simulate(step=step, soft_bodies={"finger": body})
    rest = simulation.model.rest_position
    tip, times, distances = rest.sum(axis=1).argmax(), [0.0], [0.0]
    for index in range(1, round(DURATION / step) + 1):
        times.append(index * step)
        report = simulation.step(Control(pressure={"finger.cavity": PRESSURE * min(1.0, times[-1] / RISE)}))
        assert report.converged
        distances.append(float(np.linalg.norm(simulation.state.position[tip] - rest[tip])))
    return np.array(times), np.array(distances)


@pytest.mark.parametrize("element", ["smoothed"])
def test_a_finger_bends_as_fast_in_steps_of_10_ms(block: Callable[..., str], element: str, figures: Figures) -> None:
    """A hollow bar of Dragon Skin 10 with a stiff side, whose tip goes 5 of some 10 mm: it is there within 25 % of the
    time of steps of 1 ms. A viscosity that was made by the step took four times as long."""
    body = {
        "mesh": block((7, 4, 4), (100.0, 12.0, 12.0), hollow=True),
        "element": element,
        "material": "dragon-skin-10",
        "rayleigh_mass": 0.1,
        "rayleigh_stiffness": 0.01,
        "cavities": {"cavity": {"group": "cavity"}},
        "regions": [{"box": [[-51.0, -7.0, 3.0], [51.0, 7.0, 7.0]], "material": "dragon-skin-30"}],
        "anchors": [{"box": [[-51.0, -7.0, -7.0], [-49.9, 7.0, 7.0]]}],
    }
    took = []
    for step in (0.01, 0.001):
        times, distances = bend(body, step)
        arrived = int((distances > FAR).argmax())
        assert arrived > 0
        took.append(float(np.interp(FAR, distances[arrived - 1 : arrived + 1], times[arrived - 1 : arrived + 1])))
    figures.at_most(
        "time to 5 mm in steps of 10 ms, of that in steps of 1 ms, less 1", abs(took[0] / took[1] - 1), 0.25
    )
