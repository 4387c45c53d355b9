"""A single soft body under loads, brought to rest; the finger of SOFA's tutorial in particular."""

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from taichisoft.errors import TaichisoftError
from taichisoft.mesh import VolumeMesh, write_volume_mesh

if TYPE_CHECKING:
    from taichisoft.contact import Model
    from taichisoft.control import Control
    from taichisoft.running import Simulation

WEAK = 1e-6
"""Stiffness of springs so long that they pull with a constant force [mN/mm]."""
TO_REST = {"step": 1e3, "newton": 200, "newton_tolerance": 1e-7}
"""A time step that leads to rest in several linearisations."""
SMALL_STRAINS = {"step": 10.0, "dynamics": "overdamped"}
"""Time steps of a body that nothing needs to hold; one linearisation each is enough while strains are small."""
DAMPING = 5.0
"""Rayleigh's factor of the stiffness under overdamped dynamics [s]."""
MOST_STEPS = 400


def simulation_of(mesh: VolumeMesh, time: dict[str, Any], gravity: tuple[float, ...] = (0, 0, 0), **body: Any) -> Any:
    """The simulation of one body, "body".

    Args:
        mesh: mesh of the body.
        time: table `time` of the scene.
        gravity: [mm/s^2].
        body: keys of the soft body.
    """
    from taichisoft.running import Simulation
    from taichisoft.scene import scene_from_dict

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "body.msh"
        write_volume_mesh(mesh, path)
        bodies = {"body": {"mesh": str(path), "density": 1e-6, **body}}
        return Simulation(scene_from_dict({"time": time, "gravity": gravity, "soft_bodies": bodies}, mesh.source))


def settle(
    simulation: "Simulation", control_at: Callable[[float], "Control"], ramp: int, still: float = 1e-4
) -> np.ndarray:
    """Step under loads that rise until the body rests.

    Args:
        simulation: simulation at its start.
        control_at: control under a share of the loads, 0 to 1.
        ramp: number of steps in which the loads rise.
        still: largest motion of a node in a step, over the largest displacement, at which it rests [-].

    Returns:
        Displacements of the nodes [mm], shape (node_count, 3).
    """
    rest = before = simulation.model.rest_position
    for index in range(1, MOST_STEPS + 1):
        simulation.step(control_at(min(1.0, index / ramp)))
        after = simulation.state.position
        if index > ramp and farthest(after - before) <= still * farthest(after - rest):
            return np.asarray(after - rest)
        before = after
    raise TaichisoftError(f"the body still moves after {MOST_STEPS} steps")


def at_rest(
    mesh: VolumeMesh,
    pressure: float = 0.0,
    gravity: tuple[float, float, float] = (0.0, 0.0, 0.0),
    dead_load: "Callable[[Model], np.ndarray] | None" = None,
    small: bool = False,
    ramp: int = 1,
    **body: Any,
) -> np.ndarray:
    """Displacements of the nodes of a body under loads, and its rest positions.

    Args:
        mesh: mesh of the body, with the group "cavity" if there is a pressure.
        pressure: in the cavity [kPa].
        gravity: [mm/s^2].
        dead_load: forces on the nodes [mN], shape (node_count, 3); they act on nodes of `anchors` with the stiffness
            `WEAK`.
        small: whether strains are small; then nothing needs to hold the body.
        ramp: number of steps in which the loads rise.
        body: keys of the soft body.

    Returns:
        Displacements and rest positions [mm], shape (2, node_count, 3).
    """
    from taichisoft.control import Control

    if pressure:
        body = {"cavities": {"cavity": {"group": "cavity"}}, **body}
    if small:
        body = {"rayleigh_stiffness": DAMPING, **body}
    simulation = simulation_of(mesh, SMALL_STRAINS if small else TO_REST, **body)
    model = simulation.model
    anchored = model.anchored_nodes
    held = model.rest_position[anchored]
    pulled = np.zeros_like(held) if dead_load is None else dead_load(model)[anchored] / WEAK

    def control_at(share: float) -> Control:
        return Control(
            pressure={"body.cavity": share * pressure} if pressure else {},
            gravity=share * np.array(gravity),
            anchor_positions={"body": held + share * pulled} if dead_load is not None else {},
        )

    return np.array([settle(simulation, control_at, ramp), model.rest_position])


def farthest(motion: np.ndarray) -> float:
    """Length of the longest of the motions [mm], whose shape is (node_count, 3)."""
    return float(np.linalg.norm(motion, axis=1).max())


def traction(x: float, load: tuple[float, float, float]) -> "Callable[[Model], np.ndarray]":
    """A uniform traction with the sum `load` [mN] on the plane face at `x` [mm]."""
    return lambda model: _shares(model.soft_bodies[0].elements, model.rest_position, x)[:, None] * load


def _shares(elements: np.ndarray, nodes: np.ndarray, x: float) -> np.ndarray:
    """Shares of the nodes in a uniform traction on the plane face at `x` [mm], shape (node_count,)."""
    corners = np.array([[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]])
    middles = np.array([[4, 5, 6], [4, 8, 7], [6, 9, 7], [5, 9, 8]])
    faces = elements[:, corners].reshape(-1, 3)
    there = np.isclose(nodes[faces][:, :, 0], x).all(axis=1)
    a, b, c = np.moveaxis(nodes[faces[there]], 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    # Over a triangle, the integral of a corner's quadratic shape function is zero, of a middle node's a third.
    carries = faces if elements.shape[1] == 4 else elements[:, middles].reshape(-1, 3)
    shares = np.bincount(carries[there].ravel(), np.repeat(area, 3), len(nodes))
    return np.asarray(shares / shares.sum())


def bend(
    mesh: Any, even_mass: bool = False, step: float = 10.0, damping: float = 1.0, **body: Any
) -> tuple[int, int, float]:
    """Inflate the finger of SOFA's tutorial to 30 kPa, held at its base, until it rests.

    The result does not depend on `step` and `damping`.

    Args:
        mesh: value of `soft_bodies.NAME.mesh` in a scene; the cavity is the mesh's group "cavity".
        even_mass: whether every node has the same mass, as in SOFA's tutorial, instead of each element by its volume.
        step: time step [s]: a long step of implicit Euler is nearly one of Newton's method for the state of rest.
        damping: Rayleigh's factor of the stiffness [s]: a step covers step / (step + damping) of what is left.
        body: other keys of the soft body, which replace the keys of this function.

    Returns:
        Number of nodes, number of tetrahedra, and displacement of the node that moved farthest [mm].
    """
    from taichisoft.control import Control
    from taichisoft.running import Simulation
    from taichisoft.scene import scene_from_dict

    mass, silicone_volume = 0.04, 51162.5  # kg, mm^3
    finger = {
        "mesh": mesh,
        **({"mass": mass} if even_mass else {"density": mass / silicone_volume}),
        "young_modulus": 500.0,
        "poisson_ratio": 0.3,
        "rayleigh_stiffness": damping,
        "anchors": [{"box": ((-10.0, 0.0, -20.0), (0.0, 30.0, 20.0))}],
        "regions": [{"box": ((-100.0, 22.5, -8.0), (-19.0, 28.0, 8.0)), "young_modulus": 1500.0}],
        "cavities": {"cavity": {"group": "cavity"}},
        **body,
    }
    scene = {"gravity": (-9810.0, 0.0, 0.0), "time": {"step": step}, "soft_bodies": {"finger": finger}}
    simulation = Simulation(scene_from_dict(scene, "finger at rest"))
    displacement = settle(simulation, lambda share: Control(pressure={"finger.cavity": share * 30.0}), 10, 2e-6)
    return len(displacement), len(simulation.model.soft_bodies[0].elements), farthest(displacement)
