"""Read contact forces: between pairs of bodies, and contact by contact.

`report.observation` has sums by pair of bodies, in the scene's order: `normal_forces["finger1", "cube"]`. `report` has
the contacts themselves, `contact_points` [mm] and `contact_forces` [mN]; a force is on the second body of its pair,
whose numbers are in `state.contact_body_pair`. Forces are in mN, so that the weight of a cube of 1 g is 9.81 mN.

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

cube = simulation.model.body_names.index("cube")
first, second = simulation.state.contact_body_pair.T
on_cube = np.vstack([report.contact_forces[second == cube], -report.contact_forces[first == cube]])
total = on_cube.sum(axis=0)
weight = simulation.model.rigid_mass[0] * simulation.model.gravity
print(f"All contacts together push the cube up with {total[0]:.2f} mN; its weight is {-weight[0]:.2f} mN.")

finger = simulation.model.body_names.index("finger1")
from_finger = (first == finger) & (second == cube)
strength = np.linalg.norm(report.contact_forces[from_finger], axis=1)
x, y, z = np.average(report.contact_points[from_finger], axis=0, weights=strength)
print(f"centre of finger1's force: ({x:.2f}, {y:.2f}, {z:.2f}) mm")
