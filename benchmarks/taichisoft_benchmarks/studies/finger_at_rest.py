"""The bend of the tutorial's finger in the engine: held at its base and inflated until it rests."""

from typing import Any

import numpy as np

from taichisoft.errors import TaichisoftError

PRESSURE = 30.0
"""Pressure in the cavity [kPa]."""
MASS = 0.04
"""Mass of the finger [kg]."""
SILICONE = 51162.5
"""Volume of silicone in the finger [mm^3]."""
GRAVITY = (-9810.0, 0.0, 0.0)
"""Gravity [mm/s^2], away from the base."""
SOFT, STIFF = 500.0, 1500.0
"""Young's moduli of the finger and of its stiff layer [kPa]."""
POISSON_RATIO = 0.3
BASE = ((-10.0, 0.0, -20.0), (0.0, 30.0, 20.0))
"""Two corners of the box of the nodes that are held [mm]."""
STIFF_LAYER = ((-100.0, 22.5, -8.0), (-19.0, 28.0, 8.0))
"""Two corners of the stiff layer [mm]."""
RAMP = 10
"""Number of steps in which the pressure rises."""

STEP = 10.0
"""Time step [s]: so long a step of implicit Euler is nearly one of Newton's method for the state of rest."""
DAMPING = 1.0
"""Rayleigh's factor of the stiffness [s]: each step goes step / (step + damping) of the way."""
STILL = 1e-4
"""Largest motion of a node in a step at which the finger counts as resting [mm]."""
MOST_STEPS = 300


def bend(
    mesh: Any, even_mass: bool = False, step: float = STEP, damping: float = DAMPING, **body: Any
) -> tuple[int, int, float]:
    """Inflate a finger until it rests; the answer does not depend on `step` and `damping`.

    Args:
        mesh: value of `soft_bodies.NAME.mesh` in a scene; the cavity is the mesh's group "cavity".
        even_mass: whether every node has the same mass, as in SOFA's tutorial, instead of each element by its volume.
        step: time step [s].
        damping: Rayleigh's factor of the stiffness [s].
        body: other keys of the soft body, which win over those of this module.

    Returns:
        Number of nodes, number of tetrahedra, and displacement of the node that moved farthest [mm].

    Raises:
        TaichisoftError: the mesh or the simulation failed, or the finger does not come to rest.
    """
    from taichisoft.building.simulation import Simulation
    from taichisoft.control.control import Control
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
    scene = {"gravity": GRAVITY, "time": {"step": step}, "soft_bodies": {"finger": finger}}
    simulation = Simulation(scene_from_dict(scene, "finger at rest"))
    before = rest = simulation.model.rest_position
    for index in range(1, MOST_STEPS + 1):
        simulation.step(Control(pressure={"finger.cavity": PRESSURE * min(1.0, index / RAMP)}))
        after = simulation.state.position
        if index > RAMP and farthest(after - before) < STILL:
            return len(rest), len(simulation.model.soft_bodies[0].elements), farthest(after - rest)
        before = after
    raise TaichisoftError(f"finger at rest: still moves after {MOST_STEPS} steps; try a smaller step")


def farthest(motion: np.ndarray) -> float:
    """Length of the longest of some motions [mm]; `motion` has the shape (node_count, 3)."""
    return float(np.linalg.norm(motion, axis=1).max())
