"""Law: Rayleigh damping resists strains, not turning.

Where two principal stretches are equal, turning about the third axis only turns the stress of a body. Damping, the
difference of the forces with and without it, has no share in that. Its tangent has one, of the size of the stress.
"""

from pathlib import Path

import numpy as np
import pytest
from blocks import make_block
from scenes import silicone, simulate

from taichisoft.bodies.elasticity import ElasticSystem
from taichisoft.meshes.files import write_volume_mesh

SIZE = (10.0, 8.0, 6.0)
STRETCHES = np.array([1.4, 1.4, 1 / 1.96])
DAMPING = 0.5


@pytest.mark.parametrize("element", ["smoothed", "quadratic"])
@pytest.mark.parametrize("law", ["neo-hookean", "yeoh"])
def test_damping_does_not_hold_a_stretched_body_that_turns(tmp_path: Path, element: str, law: str) -> None:
    """Forces of a rotation of 1 rad/s are at most round-off of those of a shear as fast, 1e-12 of them."""
    path = tmp_path / "block.msh"
    write_volume_mesh(make_block((2, 2, 2), SIZE), path)
    body = silicone(str(path), element=element, law=law, poisson_ratio=0.49)
    if law == "yeoh":
        del body["young_modulus"]
        body["coefficients"] = {"c10": 36.0, "c20": 2.5}
    forces = {}
    for damping in (0.0, DAMPING):
        model = simulate(soft_bodies={"block": body | {"rayleigh_stiffness": damping}}).model
        assert model.elasticity is not None
        system = ElasticSystem(model.elasticity)
        system.position[:] = x = model.rest_position * STRETCHES
        for motion, sign in (("turn", -1.0), ("shear", 1.0)):
            system.velocity[:] = np.column_stack([sign * x[:, 1], x[:, 0], np.zeros(len(x))])
            system.assemble()
            forces[motion, damping] = system.force.copy()
    of_turning, of_shear = (forces[motion, DAMPING] - forces[motion, 0.0] for motion in ("turn", "shear"))
    assert np.abs(of_turning).max() < 1e-12 * np.abs(of_shear).max()
