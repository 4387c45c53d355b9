"""Sweep a parameter by hand: how stiff may the layer be that makes a finger bend?

`load_scene` takes overrides, "key=value" with the keys of docs/reference/scenes.md; entries of a list have an index.
A loop over scenes is a sweep. `taichisoft study sweep` makes one on all cores or a cluster, of dimensions as well.

Prints:

    layer [kPa]  bent by [degrees]  air [mm^3]
            500              26.73     12013.6
           1000              23.73     11649.7
           1500              21.41     11495.6
           3000              17.00     11297.1
           6000              12.96     11160.6
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
