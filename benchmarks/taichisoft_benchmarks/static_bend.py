"""How far the tutorial's finger bends when it is held at its base and inflated, at rest."""

from typing import Any

import numpy as np

PRESSURE = 30.0
"""[kPa]"""
MASS = 0.04
"""[kg] of the tutorial's finger."""
SILICONE = 51162.5
"""[mm^3] in it."""

SOFT, STIFF = 500.0, 1500.0
"""[kPa] Young's modulus, and that of the stiff layer."""
POISSON_RATIO = 0.3
BASE = ((-10.0, 0.0, -20.0), (0.0, 30.0, 20.0))
"""[mm] Box of the nodes that are held."""
STIFF_LAYER = ((-100.0, 22.5, -8.0), (-19.0, 28.0, 8.0))
"""[mm]"""

STEP = 10.0
"""[s] So long a step of implicit Euler is nearly one of Newton's method for the state of rest."""
DAMPING = 1.0
"""[s] Rayleigh's factor of the stiffness: each step goes step / (step + damping) of the way."""
RAMP = 10
"""Steps in which the pressure rises."""
STILL = 1e-4
"""[mm] No node moves farther in a step when the finger is said to be at rest."""
MOST_STEPS = 300


def bend(
    mesh: Any, even_mass: bool = False, step: float = STEP, damping: float = DAMPING, **body: Any
) -> tuple[int, int, float]:
    """Inflate a finger until it rests; the answer does not depend on `step` and `damping`.

    Args:
        mesh: `soft_bodies.NAME.mesh` of a scene; its cavity is the group "cavity".
        even_mass: give every node the same mass, as the tutorial does, instead of each element's by its volume.
        step: [s].
        damping: Rayleigh's factor of the stiffness [s].
        body: other keys of the soft body, instead of those here.

    Returns:
        Nodes, tetrahedra, and how far the node that moved farthest is from where it was [mm].

    Raises:
        TaichisoftError: the mesh or the simulation failed, or the finger does not come to rest.
    """
    from taichisoft.building.simulation import Simulation
    from taichisoft.control.control import Control
    from taichisoft.errors import TaichisoftError
    from taichisoft.scenes.file import scene_from_dict

    finger = {
        "mesh": mesh,
        **({"mass": MASS} if even_mass else {"density": MASS / SILICONE}),
        "young_modulus": SOFT,
        "poisson_ratio": POISSON_RATIO,
        "rayleigh_stiffness": damping,
        "anchors": [{"box": BASE}],
        "regions": [{"box": STIFF_LAYER, "young_modulus": STIFF}],
        "cavities": {"cavity": {"group": "cavity"}},
        **body,
    }
    scene = {"gravity": [-9810.0, 0.0, 0.0], "time": {"step": step}, "soft_bodies": {"finger": finger}}
    simulation = Simulation(scene_from_dict(scene, "finger at rest"))
    before = rest = simulation.model.rest_position
    for index in range(1, MOST_STEPS + 1):
        simulation.step(Control(pressure={"finger.cavity": PRESSURE * min(1.0, index / RAMP)}))
        after = simulation.state.position
        if index > RAMP and _farthest(before, after) < STILL:
            return len(rest), len(simulation.model.soft_bodies[0].elements), _farthest(rest, after)
        before = after
    raise TaichisoftError(f"finger at rest: still moves after {MOST_STEPS} steps; try a smaller step")


def _farthest(before: np.ndarray, after: np.ndarray) -> float:
    return float(np.linalg.norm(after - before, axis=1).max())
