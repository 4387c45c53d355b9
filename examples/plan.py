"""Plan while acting: model predictive control by the cross-entropy method, which finds out how to lift the cube.

Every 0.08 s it draws plans of pressures and lifting speeds around the last one, looks at what becomes of each in
futures of the present state (`taichisoft.rollouts`, on two threads), and makes the beginning of the mean of the best
ones. It knows nothing of grasping: the cost is how far the cube is from 10 mm up, and how far it hangs behind the base.

`python examples/plan.py --reduced out/reduced` does the same with reduced fingers (`taichisoft reduce gripper -o
out/reduced`), in 0.4 of the time: a plan of 96 steps in 0.08 s, so that a real gripper need not wait.

Prints:

    0.08 s: base at 0.3 mm, cube -0.0 mm up
    0.16 s: base at 2.7 mm, cube 0.8 mm up
    0.24 s: base at 7.5 mm, cube 5.3 mm up
    0.32 s: base at 12.2 mm, cube 10.0 mm up
    0.40 s: base at 15.5 mm, cube 13.2 mm up
"""

import argparse

import numpy as np

import taichisoft

PLANS, SAMPLES, BEST = 5, 6, 3
KNOTS, STEPS = 2, 8  # a plan has two pairs of pressure and speed, each for 8 steps; the first one is made
SPREAD = np.tile([15.0, 30.0], (KNOTS, 1))
LOWEST, HIGHEST = np.array([0.0, 0.0]), np.array([60.0, 60.0])  # [kPa], [mm/s]
GOAL = 10.0  # [mm]


def control(knot: np.ndarray) -> taichisoft.Control:
    """The control of a knot: pressure of all fingers [kPa] and speed of the base upwards [mm/s]."""
    return taichisoft.Control(pressure=dict.fromkeys(cavities, knot[0]), base_velocity=np.array([knot[1], 0.0, 0.0]))


parser = argparse.ArgumentParser()
parser.add_argument("--reduced", help="folder of `taichisoft reduce gripper`")
folder = parser.parse_known_args()[0].reduced
reduced = [f"soft_bodies.finger1.reduced={folder}/finger1.npz"] if folder else []  # the other fingers are like it
simulation = taichisoft.Simulation(taichisoft.load_scene("gripper", reduced))
cavities = simulation.model.cavities.names
ground = simulation.observe().object_positions["cube"][0]
random = np.random.default_rng(0)
mean = np.tile([40.0, 0.0], (KNOTS, 1))
for _ in range(PLANS):
    plans = np.clip(mean + SPREAD * random.standard_normal((SAMPLES, KNOTS, 2)), LOWEST, HIGHEST)
    controls = [[control(knot) for knot in plan] for plan in plans]
    figures = ["object_positions.cube", "base_translation"]
    futures = taichisoft.rollouts(simulation, controls, figures=figures, steps_per_control=STEPS)
    lift = futures["object_positions.cube"][:, :, 0] - ground
    behind = futures["base_translation"][:, :, 0] - lift
    cost = np.nan_to_num((GOAL - lift) ** 2 + behind**2, nan=1e6).sum(axis=1)  # NaN where a future diverged
    mean = plans[np.argsort(cost)[:BEST]].mean(axis=0)
    for step in range(STEPS):
        simulation.step(control(mean[0]) if step == 0 else None)
    mean = np.vstack([mean[1:], mean[-1:]])
    seen = simulation.observe()
    cube = seen.object_positions["cube"][0] - ground
    print(f"{seen.time:.2f} s: base at {seen.base_translation[0]:.1f} mm, cube {cube:.1f} mm up")
