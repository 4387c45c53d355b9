"""Surfaces that overlap during a run are said once, with the bodies, the step, the cause and what helps."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from taichisoft import Control, Controller, Observation, Simulation, run
from taichisoft.errors import SceneError
from taichisoft.scene import scene_from_dict

FLOOR = {"plane": {"point": [0, 0, 0], "normal": [0, 0, 1]}}


class Idle(Controller):
    """Asks for nothing."""

    def control(self, observation: Observation) -> Control:
        """Nothing."""
        return Control()


def on_the_floor(**contact: float) -> Simulation:
    box = {"box": [10, 10, 10], "mass": 0.01, "position": [0, 0, 6]}
    return Simulation(
        scene_from_dict({"rigid_bodies": {"cube": box}, "obstacles": {"floor": FLOOR}, "contact": contact})
    )


def test_what_overlaps_is_said_once() -> None:
    simulation = on_the_floor()
    simulation.restore(replace(simulation.state, rigid_position=np.array([[0.0, 0.0, 4.7]])))
    with pytest.warns(
        UserWarning, match="step 0: 'cube' and 'floor' overlap by 0.3 mm: they overlap at the start; move one"
    ) as said:
        run(simulation, Idle(), duration=0.05)
    assert len(said) == 1


def test_what_only_comes_close_is_not() -> None:
    simulation = on_the_floor()
    simulation.restore(replace(simulation.state, rigid_position=np.array([[0.0, 0.0, 5.1]])))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run(simulation, Idle(), duration=0.05)


def test_a_contact_distance_larger_than_a_body_is_refused() -> None:
    with pytest.raises(SceneError, match=r"contact_distance = 11 mm is larger than 'cube', which measures 10 mm"):
        on_the_floor(contact_distance=11.0, alarm_distance=20.0)
