"""A small block sunk into the rim of a table comes out upwards, although sideways edges seem to have crossed too."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import trimesh

from taichisoft import Simulation
from taichisoft.scene import scene_from_dict


def test_a_block_that_sank_into_the_rim_of_a_table_comes_out_upwards(tmp_path: Path) -> None:
    """The block of 6 mm overhangs the rim by 2 mm; its inner edge is 4 mm from the rim, within the alarm distance.

    It starts 1.2 mm lower than it may stand, 0.2 mm inside the table. After one step it stands where it should, to
    1e-6 mm: normals are exact here, and the solver's tolerance of 1e-5 mm/s times the step is 1e-7 mm. Afterwards it
    rests, and its weight (m g = 98.1 mN) is on the table.
    """
    trimesh.creation.box(extents=[80, 80, 100]).export(tmp_path / "table.stl")
    scene = scene_from_dict(
        {
            "rigid_bodies": {"block": {"box": [6.0, 20.0, 6.0], "mass": 0.01, "position": [39.0, 0.0, 54.0]}},
            "obstacles": {"table": {"surface": str(tmp_path / "table.stl")}},
        }
    )
    simulation = Simulation(scene)
    sunk = simulation.state.rigid_position - [0.0, 0.0, 1.2]
    simulation.restore(replace(simulation.state, rigid_position=sunk))
    simulation.step()
    np.testing.assert_allclose(simulation.state.rigid_position[0], [39.0, 0.0, 54.0], atol=1e-6)
    for _ in range(20):
        report = simulation.step()
    np.testing.assert_allclose(simulation.state.rigid_position[0], [39.0, 0.0, 54.0], atol=1e-5)
    np.testing.assert_allclose(report.observation.normal_forces["block", "table"], 98.1, rtol=1e-3)
