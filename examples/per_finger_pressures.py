"""Ask for a pressure of its own in each finger, and read what each does.

Cavities are named "BODY.CAVITY". Whatever a `Control` does not mention stays as it was. The scene's `[limits]` stand
between what is asked for and what happens: this gripper's pressures change by 300 kPa/s at most, and
`Observation.clipped` names what was held back.

Prints:

    held back in the first step: finger1.cavity, finger2.cavity, finger3.cavity
    finger1: 5.0 kPa bend it by 4.86 degrees
    finger2: 10.0 kPa bend it by 7.95 degrees
    finger3: 15.0 kPa bend it by 10.88 degrees
    finger3 vented: 4.87, 7.97, 1.91 degrees
"""

import math

import taichisoft

simulation = taichisoft.Simulation(taichisoft.load_scene("gripper"))
asked = {"finger1.cavity": 5.0, "finger2.cavity": 10.0, "finger3.cavity": 15.0}

report = simulation.step(taichisoft.Control(pressure=asked))
print("held back in the first step:", ", ".join(report.observation.clipped))

for _ in range(60):
    report = simulation.step()  # goes on with what was asked for
for finger in ("finger1", "finger2", "finger3"):
    pressure = report.observation.pressures[f"{finger}.cavity"]
    angle = math.degrees(report.observation.bending_angles[finger])
    print(f"{finger}: {pressure:.1f} kPa bend it by {angle:.2f} degrees")

for _ in range(60):
    report = simulation.step(taichisoft.Control(pressure={"finger3.cavity": 0.0}))
angles = ", ".join(f"{math.degrees(angle):.2f}" for angle in report.observation.bending_angles.values())
print(f"finger3 vented: {angles} degrees")
