"""The table of docs/materials.md: how far the tutorial's finger of silicone bends, by the mesh.

    python -m taichisoft_benchmarks.studies.silicone_finger [MESH ...]

MESH is the value of `soft_bodies.finger.mesh` in a scene; without one the two shipped meshes and a fine one are taken.
Each pressure takes ten minutes on the fine one.
"""

import sys

from taichisoft_benchmarks.studies.finger_at_rest import MOST_STEPS, RAMP, farthest

MESHES = ("tutorial-coarse", "tutorial-medium", "{file='tutorial.toml', preset='fine'}")
CASES = (
    ("dragon-skin-10", "dragon-skin-30", 10.0),
    ("dragon-skin-10", "dragon-skin-30", 15.0),
    ("dragon-skin-30", "sortaclear-40", 40.0),
)
"""Material of the finger, that of its stiff layer, and pressure [kPa]."""
STILL = 1e-3
"""Largest motion of a node in a step at which the finger counts as resting [mm]."""


def bend(mesh: str, silicone: str, layer: str, pressure: float) -> tuple[int, float, float]:
    """Number of nodes, displacement of the node that moved farthest [mm], and largest stretch of the finger at rest.

    Steps of 10 s with up to 20 linearisations lead there; the answer does not depend on their length.
    """
    from taichisoft.bodies.strain import Stretches
    from taichisoft.building.scene_files import load_scene
    from taichisoft.building.simulation import Simulation
    from taichisoft.control.control import Control
    from taichisoft.errors import TaichisoftError

    body = "soft_bodies.finger"
    changes = [f"{body}.mesh={mesh}", f"{body}.material={silicone}", f"{body}.regions.0.material={layer}"]
    changes += ["time.step=10.0", "time.newton=20", "limits.pressure_rate=1e9", f"{body}.rayleigh_stiffness=0.1"]
    simulation = Simulation(load_scene("finger-dragon-skin", changes))
    before = rest = simulation.model.rest_position
    for index in range(1, MOST_STEPS + 1):
        simulation.step(Control(pressure={"finger.cavity": pressure * min(1.0, index / RAMP)}))
        after = simulation.state.position
        if index > RAMP and farthest(after - before) < STILL:
            stretches = Stretches(rest, simulation.model.soft_bodies[0].elements)
            return len(rest), farthest(after - rest), float(stretches.largest(after).max())
        before = after
    raise TaichisoftError(f"{mesh}: still moves after {MOST_STEPS} steps")


if __name__ == "__main__":
    for name in sys.argv[1:] or MESHES:
        for case in CASES:
            nodes, way, stretch = bend(name, *case)
            print(f"{case[0]} {case[2]:g} kPa: {nodes} nodes, {way:.1f} mm, largest stretch {stretch:.2f}", flush=True)
