"""What an element's rotation must leave alone: the order in which a mesh lists things, and angular momentum."""

from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Figures

from taichisoft import Control, Simulation, VolumeMesh, read_volume_mesh, write_volume_mesh
from taichisoft.scene import find_file, scene_from_dict

EVEN = [order for order in permutations(range(4)) if np.linalg.det(np.eye(4)[list(order)]) > 0]


@pytest.fixture(scope="module")
def mesh() -> VolumeMesh:
    """The shipped finger of 626 nodes."""
    return read_volume_mesh(find_file("tutorial-coarse.msh", "meshes", ()))


def inflated(mesh: str, pressure: float, seconds: float, **body: Any) -> Simulation:
    """A finger whose pressure rises by 100 kPa a second, and stays."""
    finger = {
        "mesh": mesh,
        "element": "linear",
        "mass": 0.04,
        "young_modulus": 500,
        "poisson_ratio": 0.3,
        "rayleigh_stiffness": 0.1,
        "cavities": {"cavity": {"group": "cavity"}},
        **body,
    }
    simulation = Simulation(scene_from_dict({"gravity": [0, 0, 0], "soft_bodies": {"finger": finger}}))
    for step in range(round(100 * seconds)):
        simulation.step(Control({"finger.cavity": min(pressure, step + 1.0)}))
    return simulation


def renumbered(mesh: VolumeMesh, seed: int) -> tuple[VolumeMesh, np.ndarray]:
    """The mesh with its nodes, tetrahedra and their corners in another order, and which old node each new one is."""
    generator = np.random.default_rng(seed)
    order = generator.permutation(len(mesh.nodes))
    place = np.argsort(order).astype(np.int32)
    elements = generator.permutation(place[mesh.elements])
    turns = np.array(EVEN)[generator.integers(0, len(EVEN), len(elements))]
    elements = np.take_along_axis(elements, turns, axis=1)
    groups = {name: place[triangles] for name, triangles in mesh.surface_groups.items()}
    return VolumeMesh("renumbered", mesh.nodes[order], elements, groups), order


def test_the_order_of_nodes_and_corners_decides_nothing(mesh: VolumeMesh, tmp_path: Path, figures: Figures) -> None:
    """A finger under 80 kPa, whose strains reach 0.9, with its nodes, tetrahedra and their corners shuffled.

    Tolerance 1e-9 of the largest displacement: round-off of 120 steps. Rotations from edges leave 0.1.
    """
    anchors = [{"box": [[-10, 0, -20], [0, 30, 20]]}]
    as_shipped = inflated("tutorial-coarse", 80.0, 1.2, anchors=anchors).state.position
    largest = np.linalg.norm(as_shipped - mesh.nodes, axis=1).max()
    for seed in (1, 2):
        other, order = renumbered(mesh, seed)
        write_volume_mesh(other, tmp_path / "renumbered.msh")
        found = np.empty_like(as_shipped)
        found[order] = inflated(str(tmp_path / "renumbered.msh"), 80.0, 1.2, anchors=anchors).state.position
        miss = np.abs(found - as_shipped).max() / largest
        figures.at_most("order of nodes: change of any node, of the largest displacement", miss, 1e-9)


def test_a_free_finger_under_pressure_does_not_turn(figures: Figures) -> None:
    """Air in a closed cavity has no moment, and a body at rest has none of its own: it comes to rest and stays so.

    Bound 1e-6 degrees a second: what moves when the pressure rises has died away by e^-17 after 3 s. Rotations from
    edges, whose forces have a moment, settle at 28 degrees a second.
    """
    simulation = inflated("tutorial-coarse", 50.0, 3.5)
    assert simulation.model.elasticity is not None
    mass = simulation.model.elasticity.node_mass[:, None]
    state = simulation.state
    arm = state.position - (mass * state.position).sum(axis=0) / mass.sum()
    velocity = state.velocity - (mass * state.velocity).sum(axis=0) / mass.sum()
    inertia = (mass * arm**2).sum() * np.eye(3) - (mass * arm).T @ arm
    turning = np.linalg.solve(inertia, (mass * np.cross(arm, velocity)).sum(axis=0))
    figures.at_most("turning of a free finger at 50 kPa [degrees/s]", np.degrees(np.linalg.norm(turning)), 1e-6)
