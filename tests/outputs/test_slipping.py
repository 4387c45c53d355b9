"""Slip is the motion of an object against the surface that presses it, however that moves."""

from pathlib import Path

import numpy as np
import pytest
from blocks import make_block

from taichisoft import Control, Simulation, write_volume_mesh
from taichisoft.scene import scene_from_dict
from taichisoft_outputs.run_figures import Slipping

WAY = 6.0
"""Of the base, sideways [mm]."""


@pytest.mark.parametrize(("friction", "young_modulus"), [(0.0, 60.0), (2.0, 20.0)])
def test_a_cube_on_a_soft_block_whose_foot_moves(tmp_path: Path, friction: float, young_modulus: float) -> None:
    """Without friction the cube stays and the block slides away below it; with much, the block takes it along.

    Then it lags behind the base, as the block shears under the inertia of the cube, but does not slip. Where it slides,
    the block is stiffer, since the dent below the cube stretches the surface that passes: 5 % are tolerated for it.
    The cube slides out of its dent to either side, by 0.03 or 0.14 mm of 6 mm: 1e-7 mm at the start decide.
    """
    write_volume_mesh(make_block((3, 3, 2), (30.0, 30.0, 20.0)), tmp_path / "a.msh")
    block = {
        "mesh": str(tmp_path / "a.msh"),
        "element": "linear",
        "density": 1e-6,
        "young_modulus": young_modulus,
        "poisson_ratio": 0.3,
        "anchors": [{"box": [[-20, -20, -11], [20, 20, -9]]}],
    }
    scene = {
        "contact": {"friction": friction},
        "gravity": [0.0, 0.0, -9810.0],
        "soft_bodies": {"block": block},
        "rigid_bodies": {"cube": {"box": [12, 12, 12], "mass": 0.01, "position": [0, 0, 16.4]}},
    }
    simulation = Simulation(scene_from_dict(scene))
    for _ in range(30):
        simulation.step()
    start, slipping, slid, lag = simulation.state, Slipping(1, simulation.state), np.zeros(3), []
    for step in range(1, 31):
        simulation.step(Control(base_translation=np.array([0.0, min(1.0, step / 20) * WAY, 0.0])))
        slid += slipping.add(simulation.state)[0]
        moved = simulation.state.rigid_position[0] - start.rigid_position[0]
        lag.append(simulation.state.base_translation[1] - moved[1])
    if friction:
        assert max(np.abs(lag)) > 0.1
        assert abs(slid[1]) < 0.05 * max(np.abs(lag))
    else:
        assert slid[1] == pytest.approx(-WAY, rel=0.05)
        assert abs(moved[1]) < 0.03 * WAY


def test_what_nothing_soft_presses_moves_against_the_base(tmp_path: Path) -> None:
    """A falling cube, and a base that stands still: both fall by g t^2 / 2, but for the order of the time step."""
    scene = {"rigid_bodies": {"cube": {"box": [12, 12, 12], "mass": 0.01, "position": [0, 0, 0]}}}
    simulation = Simulation(scene_from_dict(scene))
    slipping = Slipping(0, simulation.state)
    slid = np.zeros(3)
    for _ in range(5):
        simulation.step()
        slid += slipping.add(simulation.state)[0]
    np.testing.assert_allclose(slid, simulation.state.rigid_position[0], rtol=1e-12)
    assert np.linalg.norm(slid) > 1.0
