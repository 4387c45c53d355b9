"""Read contact forces: between pairs of bodies, and contact by contact.

`report.observation` has sums by pair of bodies, in the scene's order: `normal_forces["finger1", "cube"]`, and points
[mm] and forces of the contacts of a pair. `report` has all contacts in one row: `contact_points`, `contact_forces` and
the `contact_pairs` that they belong to. A force is on the second body of its pair. Forces are in mN, so that the weight
of a cube of 1 g is 9.81 mN.

Prints:

                         normal  friction [mN]
    finger1 on cube        92.7     55.6
    finger2 on cube       200.2    120.1
    finger3 on cube       200.3    120.2
    cube on floor         299.1     51.6
    All contacts together push the cube up with 9.81 mN; its weight is 9.81 mN.
    centre of finger1's force: (-112.56, 47.72, -1.00) mm
"""

import numpy as np

import taichisoft

simulation = taichisoft.Simulation(taichisoft.load_scene("gripper"))
cavities = simulation.model.cavities.names
for step in range(60):
    report = simulation.step(taichisoft.Control(pressure=dict.fromkeys(cavities, min(30.0, step))))

print("                     normal  friction [mN]")
for pair, force in report.observation.normal_forces.items():
    print(f"{' on '.join(pair):<18} {force:8.1f} {report.observation.friction_forces[pair]:8.1f}")

total = np.zeros(3)
for (first, second), force in zip(report.contact_pairs, report.contact_forces, strict=True):
    total += force * ((second == "cube") - (first == "cube"))
weight = simulation.model.rigid_mass[0] * simulation.model.gravity
print(f"All contacts together push the cube up with {total[0]:.2f} mN; its weight is {-weight[0]:.2f} mN.")

points = report.observation.contact_points["finger1", "cube"]
forces = report.observation.contact_forces["finger1", "cube"]
x, y, z = np.average(points, axis=0, weights=np.linalg.norm(forces, axis=1))
print(f"centre of finger1's force: ({x:.2f}, {y:.2f}, {z:.2f}) mm")
