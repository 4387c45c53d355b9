"""A short run with everything in it: `python falling_finger.py` prints the hash of its last state.

The shipped finger is inflated while its base moves, a cube falls onto it and another finger, of smoothed elements, onto
the cube.
"""

import hashlib

import numpy as np

from taichisoft import Control, Scene, Simulation, State
from taichisoft.scene import scene_from_dict

STEPS = 12
REGION = {"box": [[-100.0, 22.5, -8.0], [-19.0, 28.0, 8.0]], "law": "hooke", "young_modulus": 1500}
UPPER = {"element": "smoothed", "law": "neo-hookean", "regions": [REGION]}


def make_scene() -> Scene:
    """Fingers of 531 nodes, so that loops over nodes and elements are shared out between threads."""
    finger = {
        "mesh": "tutorial-coarse",
        "element": "linear",
        "mass": 0.04,
        "young_modulus": 500,
        "poisson_ratio": 0.3,
        "rayleigh_stiffness": 0.1,
        "anchors": [{"box": [[-10, 0, -20], [0, 30, 20]]}],
        "cavities": {"cavity": {"group": "cavity"}},
    }
    return scene_from_dict(
        {
            "gravity": [0, -9810, 0],
            "soft_bodies": {"finger": finger, "upper": {**finger, **UPPER, "translation": [0, 75, 0]}},
            "rigid_bodies": {"cube": {"box": [40, 40, 40], "mass": 0.01, "position": [-80, 52, 0]}},
            "obstacles": {"floor": {"plane": {"point": [0, -2, 0], "normal": [0, 1, 0]}}},
        }
    )


def advance(simulation: Simulation, steps: int) -> None:
    """Inflate both fingers and lower the base."""
    for _ in range(steps):
        time = simulation.state.time
        pressure = {"finger.cavity": 300 * time, "upper.cavity": 200 * time}
        simulation.step(Control(pressure=pressure, base_translation=np.array([0, -10 * time, 0])))


def digest(state: State) -> str:
    """A hash of every bit of the state."""
    parts = [np.asarray(getattr(state, name)).tobytes() for name in sorted(vars(state))]
    return hashlib.sha256(b"".join(parts)).hexdigest()


if __name__ == "__main__":
    simulation = Simulation(make_scene())
    advance(simulation, STEPS)
    assert simulation.report is not None
    print(simulation.report.contact_count, digest(simulation.state))
