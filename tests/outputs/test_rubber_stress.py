"""The stress of rubber in recordings is the one with which the engine moves the body."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from blocks import make_block

from taichisoft import make_model, write_volume_mesh
from taichisoft.mechanics import linear_tetrahedra
from taichisoft.mechanics.elasticity import internal_force
from taichisoft.scene import scene_from_dict
from taichisoft_outputs.stress import add_pressure, rubber_stress_parts

POISSON = 0.4


@pytest.mark.parametrize(
    ("law", "keys"),
    [
        ("neo-hookean", {"young_modulus": 250.0}),
        ("mooney-rivlin", {"coefficients": {"c10": 30.0, "c01": 8.0}}),
        ("yeoh", {"coefficients": {"c10": 36.0, "c20": 2.0, "c30": 0.1}}),
        ("ogden", {"coefficients": {"mu1": 60.0, "alpha1": 1.3, "mu2": -1.5, "alpha2": -2.0}}),
    ],
)
@pytest.mark.parametrize("along_x", [1.0, -0.6], ids=["deformed", "inside out"])
def test_forces_of_the_engine_follow_from_the_stress(
    tmp_path: Path, law: Any, keys: dict[str, Any], along_x: float
) -> None:
    """f_a = -sum over elements of w J s F^-T g_a, to round-off, for uneven strains of some 20 %, also mirrored."""
    mesh = make_block((2, 2, 2), (30.0, 20.0, 10.0))
    write_volume_mesh(mesh, tmp_path / "block.msh")
    body = {"mesh": str(tmp_path / "block.msh"), "element": "linear", "density": 1e-6, "poisson_ratio": POISSON, **keys}
    scene = scene_from_dict({"soft_bodies": {"block": {**body, "law": law}}})
    model = make_model(scene)
    position = mesh.nodes * [along_x, 1.0, 1.0] + np.random.default_rng(3).uniform(-0.5, 0.5, mesh.nodes.shape)
    gradients, volumes = linear_tetrahedra(mesh.nodes, mesh.elements)
    deformation = np.swapaxes(position[mesh.elements], 1, 2) @ gradients[:, 0]
    count = len(mesh.elements)
    young_modulus = np.full(count, scene.young_moduli["block"])
    stress = add_pressure(
        *rubber_stress_parts(deformation, law, keys.get("coefficients"), young_modulus, np.full(count, POISSON))
    )
    np.testing.assert_allclose(stress, np.swapaxes(stress, 1, 2), atol=1e-9)
    piola = np.linalg.det(deformation)[:, None, None] * stress @ np.swapaxes(np.linalg.inv(deformation), 1, 2)
    force = np.zeros_like(position)
    np.subtract.at(force, mesh.elements, volumes[:, :, None] * np.einsum("eij,eaj->eai", piola, gradients[:, 0]))
    expected = internal_force(model.elasticity, position)
    np.testing.assert_allclose(force, expected, atol=1e-10 * np.abs(expected).max())
