"""Small scenes for the laws: silicone blocks meshed in code, rigid boxes, planes."""

from typing import Any

import numpy as np

from taichisoft import Control, Simulation, StepReport
from taichisoft.mechanics import ElasticSystem
from taichisoft.scene import scene_from_dict

GRAVITY = 9810.0
CONTACT_DISTANCE = 1.0
FLOOR = {"plane": {"point": [0, 0, 0], "normal": [0, 0, 1]}}


def silicone(mesh: str, **changes: Any) -> dict[str, Any]:
    """A soft body's table."""
    table = {"mesh": mesh, "density": 1e-6, "young_modulus": 500, "poisson_ratio": 0.3, "rayleigh_stiffness": 0.01}
    return {**table, **changes}


def simulate(step: float = 0.01, gravity: tuple[float, float, float] = (0.0, 0.0, 0.0), **tables: Any) -> Simulation:
    """A simulation of the bodies in `tables`: soft_bodies, rigid_bodies, obstacles, contact."""
    return Simulation(scene_from_dict({"gravity": list(gravity), "time": {"step": step}, **tables}))


def advance(simulation: Simulation, seconds: float, control: Control | None = None) -> StepReport:
    """Step for some time; the last report. Every step must have converged."""
    report = simulation.report
    for _ in range(round(seconds / simulation.model.scene.time.step)):
        report = simulation.step(control)
        assert report.converged
    assert report is not None
    return report


def rigid_momentum(simulation: Simulation) -> np.ndarray:
    """Linear momentum [mN s] of all rigid bodies, shape (3,)."""
    return (simulation.model.rigid_mass[:, None] * simulation.state.rigid_velocity).sum(axis=0)


def soft_momentum(simulation: Simulation) -> np.ndarray:
    """Linear momentum [mN s] of all soft bodies, shape (3,)."""
    assert simulation.model.elasticity is not None
    return (simulation.model.elasticity.node_mass[:, None] * simulation.state.velocity).sum(axis=0)


def dense_matrix(system: ElasticSystem, node_count: int) -> np.ndarray:
    """The system matrix, (3 node_count, 3 node_count)."""
    matrix = np.zeros((node_count, 3, node_count, 3))
    for (row, column), block in zip(system.solver.symbolic.block_pairs, system.solver.blocks, strict=True):
        matrix[row, :, column] = block
        matrix[column, :, row] = block.T
    return matrix.reshape(3 * node_count, -1)
