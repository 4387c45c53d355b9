"""A force from outside gives a body F / m for as long as it lasts."""

import numpy as np
import pytest

from taichisoft import Simulation
from taichisoft.errors import SceneError
from taichisoft.scene import scene_from_dict

SCENE = {
    "gravity": [0, 0, 0],
    "time": {"step": 0.01},
    "rigid_bodies": {"cube": {"box": [10, 10, 10], "mass": 0.02}, "other": {"box": [10, 10, 10], "mass": 1.0,
                                                                           "position": [0, 50, 0]}},
}  # fmt: skip


def test_a_push_gives_its_impulse_and_no_more():
    """m dv = F t: 0.02 kg and 30 mN for 0.2 s give 300 mm/s; another body, and times outside, are not touched."""
    push = {"body": "cube", "force": [0.0, 0.0, 30.0], "start": 0.1, "duration": 0.2}
    simulation = Simulation(scene_from_dict({**SCENE, "external_forces": [push]}))
    speeds = []
    for _ in range(50):
        simulation.step()
        speeds.append(simulation.state.rigid_velocity[0, 2])
    expected = np.clip(np.arange(1, 51) - 10, 0, 20) * 0.01 * 30.0 / 0.02
    np.testing.assert_allclose(speeds, expected, rtol=1e-12)
    assert not simulation.state.rigid_velocity[1].any()


def test_a_push_on_nothing_is_refused():
    push = {"body": "cub", "force": [0.0, 0.0, 1.0], "start": 0.0, "duration": 1.0}
    with pytest.raises(
        SceneError, match=r"external_forces\.0\.body is 'cub', which is not a rigid body; there are: cube"
    ):
        scene_from_dict({**SCENE, "external_forces": [push]})
