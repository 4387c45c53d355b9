"""A single soft body under loads, brought to rest."""

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from taichisoft.errors import TaichisoftError
from taichisoft.mesh import VolumeMesh, write_volume_mesh

if TYPE_CHECKING:  # a simulation brings Taichi
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
        still: largest motion of a node in a step, over that of the whole way, at which a body counts as resting [-].

    Returns:
        Displacements of the nodes [mm], shape (node_count, 3).

    Raises:
        TaichisoftError: the body does not come to rest.
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

    Raises:
        TaichisoftError: the body does not come to rest.
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
