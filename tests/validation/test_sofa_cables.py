"""Fingers with cables against SOFA v25.06: the same equations, so the same numbers at every node and step.

Tolerance 1e-6 of the largest displacement: any wrong term leaves 1e-3 or more; what is left is 1e-12. Without contact.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Figures

from taichisoft import Control, Simulation, VolumeMesh, write_volume_mesh
from taichisoft.scene import scene_from_dict

TOLERANCE = 1e-6

# SOFA's example of the cable: soft, damped. The fingers of its tutorial: stiff, undamped, other embedding.
EXAMPLE = {"mass": 0.075, "young_modulus": 600, "poisson_ratio": 0.45, "rayleigh_mass": 0.1, "rayleigh_stiffness": 0.1}
OVERDAMPED = {"mass": 0.5, "young_modulus": 18000, "poisson_ratio": 0.3, "embedding": "grid"}
TUTORIAL = {"mass": 0.5, "young_modulus": 18000, "poisson_ratio": 0.3, "embedding": "grid"}


def _scene(run: Any, folder: Path, fingers: dict[str, str], body: dict[str, Any], first_order: bool, rod: bool) -> Any:
    """The fingers, whose cables are those of the names given."""
    bodies = {}
    for name, cable in fingers.items():
        mesh = folder / f"{name}.msh"
        write_volume_mesh(VolumeMesh(name, run[f"{name}_rest"], run[f"{name}_tets"].astype(np.int32)), mesh)
        bodies[name] = {
            "mesh": str(mesh),
            **body,
            "element": "linear",
            "corotation": "edges",  # SOFA's method "large"
            "damped_anchors": True,
            "anchors": [
                {"nodes": run[f"{name}_fixed_rss"].tolist(), "stiffness": float(run[f"{name}_rss_stiffness"][0])}
            ],
            "cables": {
                "cable": {
                    "points": run[f"{cable}_rest"][run[f"{cable}_indices"]].tolist(),
                    "pull_point": run[f"{cable}_pullPoint"].tolist(),
                    "pull_point_moves": False,
                    "rod": rod,
                }
            },
        }
    time = {"step": float(run["dt"]), "dynamics": "overdamped" if first_order else "inertial"}
    return scene_from_dict({"gravity": run["gravity"].tolist(), "time": time, "soft_bodies": bodies})


@pytest.mark.parametrize(
    ("name", "body", "fingers", "rod"),
    [
        ("a_finger_disp", EXAMPLE, {"finger": "finger_cable"}, False),
        ("a_finger_force", EXAMPLE, {"finger": "finger_cable"}, False),
        ("a_finger_push", EXAMPLE, {"finger": "finger_cable"}, True),
        ("b_CableForce", OVERDAMPED, {"finger": "finger_cable"}, True),
        ("e_step5", TUTORIAL, {f"Finger{n}": f"Finger{n}_PullingCable" for n in (1, 2, 3)}, True),
    ],
)
def test_fingers_with_cables_follow_sofa(
    shared: Path, tmp_path: Path, figures: Figures, name: str, body: dict, fingers: dict, rod: bool
) -> None:
    """Every node at every step, lengths [mm] and tensions (as SOFA's multipliers)."""
    run = dict(np.load(shared / "reference" / "sofa-cables" / f"{name}.npz"))  # else each look reads the file again
    first_order = name.startswith("b_")
    simulation = Simulation(_scene(run, tmp_path, fingers, body, first_order, rod))
    model = simulation.model
    # The multiplier is an impulse, but a force in overdamped scenes.
    per_tension = 1.0 if first_order else float(run["dt"])
    by_force = "force" in name.lower()
    worst = worst_length = worst_tension = largest = 0.0
    for cable, rest in zip(fingers.values(), model.cables.rest_value, strict=True):
        figures.close("rest length [mm]", float(rest), float(run[f"{cable}_initialLength"]), 1e-12 * rest)
    for k in range(len(run["num_constraints"])):
        asked = {f"{finger}.cable": float(run[f"{cable}_value"][k]) for finger, cable in fingers.items()}
        if by_force:
            asked = {cable: value / per_tension for cable, value in asked.items()}
        simulation.step(Control(cable_tension=asked) if by_force else Control(cable_pull=asked))
        state = simulation.state
        for index, (finger, cable) in enumerate(fingers.items()):
            position = state.position[model.soft_bodies[index].nodes]
            worst = max(worst, np.abs(position - run[f"{finger}_x"][k]).max())
            largest = max(largest, np.abs(run[f"{finger}_x"][k] - run[f"{finger}_rest"]).max())
            worst_length = max(worst_length, abs(state.actuator_value[index] - run[f"{cable}_length_after"][k]))
            worst_tension = max(
                worst_tension, abs(state.actuator_effort[index] * per_tension - run[f"{cable}_force"][k])
            )
    figures.at_most("worst node and step, of the largest displacement", worst / largest, TOLERANCE)
    figures.at_most("worst length [mm]", worst_length, 1e-6)
    figures.at_most("worst multiplier", worst_tension, 1e-6 * max(1.0, np.nanmax(np.abs(run["lambda"]))))
