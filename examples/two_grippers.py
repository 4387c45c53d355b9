"""Simulate two grippers on one model: the model never changes, so simulations share it.

`make_model` reads the meshes, lays out the arrays and factorises the matrix, once; each `Simulation` of a model has a
state of its own. They may be stepped in any order: each gives the bits that it would give alone.

Prints:

    gentle: the fingers press with 19.4, 138.4, 138.4 mN
    firm: the fingers press with 235.8, 345.0, 344.8 mN
    the same state as alone, bit for bit: True
"""

import taichisoft


def squeeze(simulation: taichisoft.Simulation, pressure: float) -> taichisoft.StepReport:
    """One step with the same pressure in all fingers."""
    return simulation.step(taichisoft.Control(pressure=dict.fromkeys(simulation.model.cavities.names, pressure)))


model = taichisoft.make_model(taichisoft.load_scene("gripper"))
gentle, firm = taichisoft.Simulation(model), taichisoft.Simulation(model)
for _ in range(60):  # in turn
    reports = {"gentle": squeeze(gentle, 25.0), "firm": squeeze(firm, 40.0)}

for name, report in reports.items():
    forces = [report.observation.normal_forces[f"finger{number}", "cube"] for number in (1, 2, 3)]
    print(f"{name}: the fingers press with {', '.join(f'{force:.1f}' for force in forces)} mN")

alone = taichisoft.Simulation(model)
for _ in range(60):
    squeeze(alone, 40.0)
print("the same state as alone, bit for bit:", alone.state == firm.state)
