"""Sweep a parameter by hand: how stiff may the layer be that makes a finger bend?

`load_scene` takes overrides, "key=value" with the keys of docs/reference/scenes.md; entries of a list have an index.
A loop over scenes is a sweep. `taichisoft mesh-sweep` varies the dimensions of a finger in the same way.

Prints:

    layer [kPa]  bent by [degrees]  air [mm^3]
            500              25.67     12048.7
           1000              22.81     11677.5
           1500              20.60     11521.1
           3000              16.42     11321.1
           6000              12.58     11184.8
"""

import math

import taichisoft

print("layer [kPa]  bent by [degrees]  air [mm^3]")
for stiffness in (500.0, 1000.0, 1500.0, 3000.0, 6000.0):
    scene = taichisoft.load_scene("finger-inflated", [f"soft_bodies.finger.regions.0.young_modulus={stiffness}"])
    simulation = taichisoft.Simulation(scene)
    for _ in range(60):
        report = simulation.step(taichisoft.Control(pressure={"finger.cavity": 30.0}))
    angle = math.degrees(report.observation.bending_angles["finger"])
    print(f"{stiffness:11g}  {angle:17.2f}  {report.observation.volumes['finger.cavity']:10.1f}")
