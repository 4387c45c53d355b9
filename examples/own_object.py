"""Let the gripper hold an object of your own, made with trimesh.

Any closed surface (STL, OBJ, PLY, ...) can be a rigid body. Its mass, centre of mass and inertia follow from the
surface and a density, which is in kg/mm^3: silicone has 1e-6, wood about 5e-7. A scene is plain data: `model_dump`
gives its tables, and `scene_from_dict` makes a scene of tables.

Run it with a folder to keep the surface: python examples/own_object.py out/own_object

Prints:

    mass of the can: 6.098 g
    finger1 and can: 92.7 mN
    finger2 and can: 92.7 mN
    finger3 and can: 92.7 mN
    can and floor: 226.7 mN
"""

import sys
import tempfile
from pathlib import Path

import trimesh

import taichisoft

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())
folder.mkdir(parents=True, exist_ok=True)

RADIUS, HEIGHT, DENSITY = 22.0, 42.0, 1e-7
can = trimesh.creation.cylinder(RADIUS, HEIGHT, sections=12)  # along z, about the origin
can.export(folder / "can.stl")

tables = taichisoft.load_scene("gripper").model_dump(exclude_none=True)
del tables["goal"]  # it is about the cube
tables["rigid_bodies"] = {
    "can": {
        "surface": str(folder / "can.stl"),
        "density": DENSITY,
        "rotation": (0.0, 90.0, 0.0),  # upright: x points up in this scene
        "position": (-100.0, 70.0, 0.0),
    }
}
simulation = taichisoft.Simulation(taichisoft.scene_from_dict(tables))
print(f"mass of the can: {1000.0 * simulation.model.rigid_mass[0]:.3f} g")

for step in range(50):
    pressure = min(30.0, step)
    report = simulation.step(taichisoft.Control(pressure=dict.fromkeys(simulation.model.cavities.names, pressure)))
for (first, second), force in report.observation.normal_forces.items():
    print(f"{first} and {second}: {force:.1f} mN")
