"""Inverse statics: which pressure and pose of the base bring the tip of a finger to a place, at rest.

`taichisoft.inverse` finds it by least squares over equilibria, with the derivatives of `Equilibrium.linearise`; the
compliance of the tip there comes along. A place out of reach gives the nearest one.

Prints:

    tip 4.0 mm to the side: 6.54 kPa, reached
    tip 8.0 mm to the side: 12.77 kPa, reached
    tip 16.0 mm to the side: 24.50 kPa, reached
    there a kPa more moves it by 0.706 mm, and a force of 1 mN by 0.0641 mm
    at a place and at an angle: reached
        pressure.finger.cavity = 19.669
        base_translation.x = 4.343
        base_translation.y = -0.635
"""

import numpy as np

import taichisoft

simulation = taichisoft.Simulation(taichisoft.load_scene("finger-inflated"))
rest = taichisoft.equilibrium(simulation)
simulation.restore(rest.state)
straight = rest.observation.tip_positions["finger"]
bounds = {"pressure.finger.cavity": (0.0, 25.0)}

for side in (4.0, 8.0, 16.0):
    found = taichisoft.inverse(simulation, {"tip_positions.finger": [np.nan, straight[1] + side, np.nan]}, bounds)
    pressure = found.values["pressure.finger.cavity"]
    print(f"tip {side:.1f} mm to the side: {pressure:.2f} kPa, {found.message}")

slope = found.equilibrium.linearise(["pressure.finger.cavity", "force.finger.y"])["tip_positions.finger"][1]
print(f"there a kPa more moves it by {slope[0]:.3f} mm, and a force of 1 mN by {slope[1]:.4f} mm")

bounds |= {"base_translation.x": (-20.0, 20.0), "base_translation.y": (-20.0, 20.0)}
place = {"tip_positions.finger": [straight[0] + 5.0, straight[1] + 12.0, np.nan], "bending_angles.finger": 0.25}
found = taichisoft.inverse(simulation, place, bounds)
print(f"at a place and at an angle: {found.message}")
for name, value in found.values.items():
    print(f"    {name} = {value:.3f}")
