"""Laws of a body of rubber that turns: its stresses turn with it, and Rayleigh damping resists strains alone."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from blocks import make_block
from scenes import silicone, simulate
from scipy.spatial.transform import Rotation

from taichisoft import write_volume_mesh
from taichisoft.mechanics import ElasticSystem
from taichisoft.mechanics.elasticity import internal_force

SIZE = (10.0, 8.0, 6.0)
DAMPING = 0.5
STEP = 0.01


def _body(tmp_path: Path, element: str, law: str) -> dict[str, Any]:
    path = tmp_path / "block.msh"
    write_volume_mesh(make_block((2, 2, 2), SIZE), path)
    body = silicone(str(path), element=element, law=law, poisson_ratio=0.49)
    if law == "yeoh":
        del body["young_modulus"]
        body["coefficients"] = {"c10": 36.0, "c20": 2.5}
    return body


@pytest.mark.parametrize("element", ["smoothed", "quadratic"])
@pytest.mark.parametrize("law", ["neo-hookean", "yeoh"])
def test_forces_turn_with_a_stretched_body(tmp_path: Path, element: str, law: str) -> None:
    """A rotation R by half a radian in the step, v = (R - 1) x / h, turns the forces of the body, f = R f(x).

    It does so for any stretches and with any damping. Tolerance 1e-11 of the largest force: round-off.
    """
    turn = Rotation.from_rotvec([0.3, -0.2, 0.35]).as_matrix()
    body = _body(tmp_path, element, law)
    for damping in (0.0, DAMPING):
        model = simulate(step=STEP, soft_bodies={"block": body | {"rayleigh_stiffness": damping}}).model
        assert model.elasticity is not None
        system = ElasticSystem(model.elasticity)
        system.position[:] = x = model.rest_position * [1.5, 0.9, 0.75]
        system.velocity[:] = (x @ turn.T - x) / STEP
        system.assemble()
        expected = internal_force(model.elasticity, x) @ turn.T
        np.testing.assert_allclose(system.force, expected, atol=1e-11 * np.abs(expected).max())


@pytest.mark.parametrize("element", ["smoothed", "quadratic"])
def test_pressure_does_not_make_a_body_more_viscous(tmp_path: Path, element: str) -> None:
    """Damping forces of a shear are those at rest, turned into lengths of a body that is as large in each direction.

    A neo-Hookean body pressed or blown up evenly by 4 %, by 3 to 4 moduli of shear, has the viscosity 2 mu: the power
    of a velocity gradient is that at rest, 1e-6 of it. What a pressure adds to the slope of the stresses has no trace.
    """
    body = _body(tmp_path, element, "neo-hookean")
    power = []
    for stretch in (1.0, 0.96, 1.04):
        forces = []
        for damping in (0.0, DAMPING):
            model = simulate(step=STEP, soft_bodies={"block": body | {"rayleigh_stiffness": damping}}).model
            assert model.elasticity is not None
            system = ElasticSystem(model.elasticity)
            system.position[:] = stretch * model.rest_position
            system.velocity[:] = 1e-3 * np.roll(model.rest_position, 1, axis=1) * [1.0, 0.0, 0.0]
            system.assemble()
            forces.append(system.force.copy())
        power.append(((forces[0] - forces[1]) * system.velocity).sum())
    np.testing.assert_allclose(power, power[0], rtol=1e-6)
    assert power[0] > 0.0
