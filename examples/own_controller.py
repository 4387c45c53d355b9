"""Write a controller: close each finger until it presses on the cube, then lift.

A controller derives from `taichisoft.Controller`; only `control` must be written. It is asked before every step, sees
an `Observation` and answers with a `Control`. `taichisoft.run` drives a simulation with it. To use one from the command
line (`taichisoft run gripper --plugin FILE --controller NAME`), a hook gives it a name: see docs/plugins.md.

Prints:

    0.23 s: finger2 presses at 23 kPa
    0.23 s: finger3 presses at 23 kPa
    0.34 s: finger1 presses at 34 kPa
    completed: the base has risen by 17.20 mm, the cube by 17.22 mm
"""

import numpy as np

import taichisoft


class Squeeze(taichisoft.Controller):
    """Raises the pressure of each finger until it presses on the cube with a given force, and lifts when all do."""

    def __init__(self, force: float):
        self.force = force  # [mN]

    def reset(self, model: taichisoft.Model) -> None:
        self.fingers = [body.name for body in model.soft_bodies]
        self.closed: list[str] = []

    def control(self, observation: taichisoft.Observation) -> taichisoft.Control:
        for finger in self.fingers:
            force = observation.normal_forces.get((finger, "cube"), 0.0)  # no entry: they are far apart
            if finger not in self.closed and force >= self.force:
                self.closed.append(finger)
                pressure = observation.pressures[f"{finger}.cavity"]
                print(f"{observation.time:.2f} s: {finger} presses at {pressure:.0f} kPa")
        if len(self.closed) == len(self.fingers):
            return taichisoft.Control(base_velocity=np.array([20.0, 0.0, 0.0]))  # [mm/s]; x points up in this scene
        opening = [f"{finger}.cavity" for finger in self.fingers if finger not in self.closed]
        return taichisoft.Control(pressure={name: observation.pressures[name] + 1.0 for name in opening})


simulation = taichisoft.Simulation(taichisoft.load_scene("gripper"))
start = simulation.observe().object_positions["cube"]
outcome = taichisoft.run(simulation, Squeeze(force=100.0), duration=1.2)

end = simulation.observe()
lift = end.object_positions["cube"][0] - start[0]
print(f"{outcome}: the base has risen by {end.base_translation[0]:.2f} mm, the cube by {lift:.2f} mm")
