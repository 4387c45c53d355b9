"""The bend of the tutorial's finger: held at its base and inflated until it rests."""

from typing import Any

import typer

from taichisoft_benchmarks.program import run_program
from taichisoft_benchmarks.studies.one_body import farthest, settle

PRESSURE = 30.0
"""Pressure in the cavity [kPa]."""
MASS, SILICONE = 0.04, 51162.5
"""Mass of the finger [kg], and volume of its silicone [mm^3]."""
GRAVITY = (-9810.0, 0.0, 0.0)
"""Gravity [mm/s^2], away from the base."""
BASE = ((-10.0, 0.0, -20.0), (0.0, 30.0, 20.0))
STIFF_LAYER = ((-100.0, 22.5, -8.0), (-19.0, 28.0, 8.0))
"""Two corners of the boxes of the held nodes and of the stiff layer [mm]."""
RAMP = 10
"""Number of steps in which the pressure rises."""
STILL = 2e-6
"""Largest motion of a node in a step, over that of the whole way, at which the finger counts as resting [-]."""

SILICONE_MESHES = ("tutorial-coarse", "tutorial-medium", "{file='tutorial.toml', preset='fine'}")
SILICONE_CASES = (
    ("dragon-skin-10", "dragon-skin-30", 10.0),
    ("dragon-skin-10", "dragon-skin-30", 15.0),
    ("dragon-skin-30", "sortaclear-40", 40.0),
)
"""Material of the finger, material of its stiff layer, and pressure [kPa]."""


def bend(
    mesh: Any, even_mass: bool = False, step: float = 10.0, damping: float = 1.0, **body: Any
) -> tuple[int, int, float]:
    """Inflate a finger until it rests; the answer does not depend on `step` and `damping`.

    Args:
        mesh: value of `soft_bodies.NAME.mesh` in a scene; the cavity is the mesh's group "cavity".
        even_mass: whether every node has the same mass, as in SOFA's tutorial, instead of each element by its volume.
        step: time step [s]: a long step of implicit Euler is nearly one of Newton's method for the state of rest.
        damping: Rayleigh's factor of the stiffness [s]: each step goes step / (step + damping) of the way.
        body: other keys of the soft body, which replace the keys of this module.

    Returns:
        Number of nodes, number of tetrahedra, and displacement of the node that moved farthest [mm].

    Raises:
        TaichisoftError: the mesh or the simulation failed, or the finger does not come to rest.
    """
    from taichisoft.running import Simulation
    from taichisoft.scene import scene_from_dict

    finger = {
        "mesh": mesh,
        **({"mass": MASS} if even_mass else {"density": MASS / SILICONE}),
        "young_modulus": 500.0,
        "poisson_ratio": 0.3,
        "rayleigh_stiffness": damping,
        "anchors": [{"box": BASE}],
        "regions": [{"box": STIFF_LAYER, "young_modulus": 1500.0}],
        "cavities": {"cavity": {"group": "cavity"}},
        **body,
    }
    scene = {"gravity": GRAVITY, "time": {"step": step}, "soft_bodies": {"finger": finger}}
    simulation = Simulation(scene_from_dict(scene, "finger at rest"))
    way = _inflate(simulation, PRESSURE, STILL)
    return len(way), len(simulation.model.soft_bodies[0].elements), farthest(way)


def silicone_bend(mesh: str, silicone: str, layer: str, pressure: float) -> tuple[int, float, float]:
    """Number of nodes, displacement of the node that moved farthest [mm], and largest stretch of a finger of silicone.

    Steps of 10 s with up to 20 linearisations lead to rest; the answer does not depend on their length.
    """
    from taichisoft.mechanics import Stretches
    from taichisoft.running import Simulation, load_scene

    body = "soft_bodies.finger"
    changes = [f"{body}.mesh={mesh}", f"{body}.material={silicone}", f"{body}.regions.0.material={layer}"]
    changes += ["time.step=10.0", "time.newton=20", "limits.pressure_rate=1e9", f"{body}.rayleigh_stiffness=0.1"]
    simulation = Simulation(load_scene("finger-dragon-skin", changes))
    way = _inflate(simulation, pressure, 2e-5)
    rest = simulation.model.rest_position
    stretches = Stretches(rest, simulation.model.soft_bodies[0].elements)
    return len(rest), farthest(way), float(stretches.largest(rest + way).max())


def _inflate(simulation: Any, pressure: float, still: float) -> Any:
    from taichisoft.control import Control

    return settle(simulation, lambda share: Control(pressure={"finger.cavity": share * pressure}), RAMP, still)


def main(
    meshes: list[str] = typer.Argument(SILICONE_MESHES, help="Values of soft_bodies.finger.mesh in a scene."),
) -> None:
    """Bends of the finger of silicone in docs/materials.md; each pressure takes ten minutes on a fine mesh."""
    for mesh in meshes:
        for silicone, layer, pressure in SILICONE_CASES:
            nodes, way, stretch = silicone_bend(mesh, silicone, layer, pressure)
            print(f"{silicone} {pressure:g} kPa: {nodes} nodes, {way:.1f} mm, stretch {stretch:.2f}", flush=True)


if __name__ == "__main__":
    run_program(main, "taichisoft_benchmarks.studies.finger_at_rest")
