"""A silicone block with two cables, run a few steps, for the tests of what is shown of cables.

`block.tendon` rubs in the block and is pulled from a point that moves with the base; `block.link` leads to a cube.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from blocks import make_block

from taichisoft import Control, Scene, Simulation, write_volume_mesh
from taichisoft.scene import scene_from_dict

STEPS = 12
TENDON, LINK = "block.tendon", "block.link"


def cable_scene(folder: Path, cables: bool = True) -> Scene:
    """The scene, whose mesh is written into the folder; without cables where they are not wanted."""
    folder.mkdir(parents=True, exist_ok=True)
    mesh = folder / "block.msh"
    write_volume_mesh(make_block((8, 2, 2), (40.0, 10.0, 10.0)), mesh)
    tendon = {
        "points": [[-10.0, 2.0, 4.0], [0.0, -2.0, 3.5], [10.0, 1.0, 4.5], [18.0, 0.0, 4.0]],
        "pull_point": [-30.0, 0.0, 4.0],
        "friction": 0.3,
    }
    link = {"points": [[20.0, 0.0, 0.0], {"body": "cube", "point": [-5.0, 0.0, 2.0]}]}
    block: dict[str, Any] = {
        "mesh": str(mesh),
        "element": "linear",
        "density": 1e-6,
        "young_modulus": 500.0,
        "poisson_ratio": 0.3,
        "rayleigh_mass": 1.0,
        "rayleigh_stiffness": 0.01,
        "anchors": [{"box": [[-20.0, -5.0, -5.0], [-20.0, 5.0, 5.0]]}],
        "cables": {"tendon": tendon, "link": link} if cables else {},
    }
    cube = {"box": [10.0, 10.0, 10.0], "mass": 0.02, "position": [50.0, 0.0, 0.0]}
    tables = {"soft_bodies": {"block": block}, "rigid_bodies": {"cube": cube}, "gravity": [0.0, 0.0, 0.0]}
    return scene_from_dict({"time": {"step": 0.01, "duration": 0.01 * STEPS}, **tables})


def control(step: int) -> Control:
    """Pull both cables a little more in each step, while the base turns."""
    return Control(
        cable_pull={TENDON: 0.2 * (step + 1)},
        cable_tension={LINK: 5.0 * (step + 1)},
        base_rotation=np.array([0.0, 0.0, 0.01 * (step + 1)]),
    )


def run_cables(folder: Path, outputs: Sequence[Any] = (), cables: bool = True) -> Simulation:
    """The simulation after STEPS steps, seen by the outputs."""
    simulation = Simulation(cable_scene(folder, cables))
    for output in outputs:
        output.begin(simulation.model, simulation.state)
    for step in range(STEPS):
        report = simulation.step(control(step) if cables else None)
        for output in outputs:
            output.record(simulation.state, report)
    for output in outputs:
        output.end("completed")
    return simulation
