"""Constant forces on the nodes of soft bodies."""

from pathlib import Path

import numpy as np
import pytest
from blocks import make_block
from scenes import silicone, simulate

from taichisoft import write_volume_mesh
from taichisoft.errors import SceneError
from taichisoft.mesh import boundary_triangles

LENGTH, WIDTH, E = 20.0, 10.0, 500.0
UNDAMPED = {"rayleigh_mass": 0.0, "rayleigh_stiffness": 0.0}


@pytest.mark.parametrize("newton", [1, 8])
def test_a_bar_under_uniform_tension_stretches_by_stress_over_modulus(tmp_path: Path, newton: int) -> None:
    """With nodal forces of a uniform stress s and Poisson's ratio 0 linear elements are exact: u_x = s x / E.

    At a strain of 1e-6 the rotations of the elements do not matter; 1e-9 of the stretch is round-off.
    """
    block = make_block((3, 2, 2), (LENGTH, WIDTH, WIDTH))
    path = tmp_path / "bar.msh"
    write_volume_mesh(block, path)
    triangles = boundary_triangles(block.elements)
    end = triangles[(block.nodes[triangles, 0] > LENGTH / 2 - 1e-9).all(axis=1)]
    share = np.zeros(len(block.nodes))
    corners = block.nodes[end]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    np.add.at(share, end, (area / 3)[:, None])
    stress = 1e-6 * E
    forces = [{"nodes": [int(i)], "force": [stress * share[i], 0, 0]} for i in np.flatnonzero(share)]
    wall = {"box": [[-LENGTH, -WIDTH, -WIDTH], [-LENGTH / 2, WIDTH, WIDTH]]}
    material = {"density": 1e-9, "young_modulus": E, "poisson_ratio": 0.0}
    bar = silicone(str(path), element="linear", anchors=[wall], forces=forces, **UNDAMPED, **material)
    time = {"step": 3600.0, "newton": newton}
    simulation = simulate(gravity=(0.0, 0.0, 0.0), soft_bodies={"bar": bar}, time=time)
    simulation.step()
    stretch = simulation.state.position - simulation.model.rest_position
    expected = 1e-6 * (simulation.model.rest_position[:, 0] + LENGTH / 2)
    assert stretch[:, 0] == pytest.approx(expected, abs=1e-9 * LENGTH * 1e-3)
    assert np.abs(stretch[:, 1:]).max() < 1e-9 * LENGTH * 1e-3


def test_a_free_body_moves_by_force_over_mass(tmp_path: Path) -> None:
    """Implicit Euler moves by F h^2 n (n + 1) / (2 m) in n steps; two forces on the same nodes add up."""
    path = tmp_path / "block.msh"
    block = make_block((2, 1, 1), (LENGTH, WIDTH, WIDTH))
    write_volume_mesh(block, path)
    every = list(range(len(block.nodes)))
    forces = [{"nodes": every, "force": [3.0, 0.0, -1.0]}, {"nodes": every, "force": [0.0, 2.0, 1.0]}]
    body = silicone(str(path), mass=0.02, anchors=[], forces=forces, **UNDAMPED)
    del body["density"]  # the mass is spread evenly over the nodes, as the forces are
    simulation = simulate(step=0.01, gravity=(0.0, 0.0, 0.0), soft_bodies={"block": body})
    for _ in range(10):
        simulation.step()
    moved = simulation.state.position - simulation.model.rest_position
    expected = np.array([3.0, 2.0, 0.0]) / 0.02 * 0.01**2 * 55.0
    assert moved == pytest.approx(np.tile(expected, (len(moved), 1)), rel=1e-9, abs=1e-9)


def test_a_force_on_nodes_that_are_not_there_is_an_error(tmp_path: Path) -> None:
    path = tmp_path / "block.msh"
    write_volume_mesh(make_block((1, 1, 1), (LENGTH, WIDTH, WIDTH)), path)
    body = silicone(str(path), anchors=[], forces=[{"nodes": [99], "force": [1, 0, 0]}])
    with pytest.raises(SceneError, match=r"soft_bodies.block.forces.0.nodes names node 99; .* has nodes 0 to 7"):
        simulate(soft_bodies={"block": body})
