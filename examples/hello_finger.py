"""Inflate one finger and watch it bend: a scene, a simulation, a step.

`load_scene` reads a shipped scene by name (or a TOML file of yours by path), `Simulation` begins at its initial state,
and every `step` advances it by the scene's time step, 0.01 s here. What a `Control` asks for stays until something else
is asked for. Lengths are in mm, pressures in kPa. The finger hangs along -x and bends towards +y.

Prints:

    0.3 s: 10 kPa, bent by 7.57 degrees, tip at (-114.60, 32.70, 0.49) mm
    0.6 s: 20 kPa, bent by 14.04 degrees, tip at (-114.03, 39.28, 0.43) mm
    0.9 s: 30 kPa, bent by 20.87 degrees, tip at (-112.86, 46.11, 0.37) mm
    The cavity holds 11436.2 mm^3, and 626 nodes have moved.
"""

import math

import taichisoft

simulation = taichisoft.Simulation(taichisoft.load_scene("finger-inflated"))

for pressure in (10.0, 20.0, 30.0):
    for _ in range(30):
        report = simulation.step(taichisoft.Control(pressure={"finger.cavity": pressure}))
    seen = report.observation
    x, y, z = seen.tip_positions["finger"]
    angle = math.degrees(seen.bending_angles["finger"])
    print(f"{report.time:.1f} s: {pressure:g} kPa, bent by {angle:.2f} degrees, tip at ({x:.2f}, {y:.2f}, {z:.2f}) mm")

volume = seen.volumes["finger.cavity"]
print(f"The cavity holds {volume:.1f} mm^3, and {simulation.model.node_count} nodes have moved.")
