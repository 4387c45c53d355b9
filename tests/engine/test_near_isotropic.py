"""Domains of rubber whose stretches are equal to round-off: at rest, however turned, none has an undefined axis."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from taichisoft import Simulation, load_scene
from taichisoft.mechanics import ElasticSystem
from taichisoft.mechanics.kernels.domain_deformation import (
    LAW_NUMBERS,
    MODULI,
    PURE_NUMBERS,
    Domains,
    Movement,
    deformation_and_rate,
)
from taichisoft.mechanics.kernels.rubber_domains import respond_by_stretches
from taichisoft.runtime import kernel, ti
from taichisoft.runtime.language import Matrices
from taichisoft.scene import scene_from_dict

HALF_ULP = 2.0**-53
MU = 100.0


@kernel
def respond(domains: Domains, movement: Movement, stress: Matrices, axes: Matrices, tangent: Matrices):
    """Stress, right axes, and a part of the tangent of all domains."""
    ti.loop_config(serialize=True)
    for d in range(stress.shape[0]):
        deformation, rate = deformation_and_rate(d, domains, movement)
        stress[d], left, axes[d], hessian, same, _swapped = respond_by_stretches(d, deformation, rate, domains)
        tangent[d] = left @ (hessian + same)


def single_domains(count: int) -> Domains:
    """Domains with four nodes of their own each, the first at the origin: F has the others for columns."""
    ones = np.ones(count)
    return Domains(
        start=4 * np.arange(count + 1, dtype=np.int32),
        node=np.arange(4 * count, dtype=np.int32),
        gradient=np.tile(np.vstack([np.zeros(3), np.eye(3)]), (count, 1)),
        volume=np.ones((count, 2)),
        law=np.full(count, LAW_NUMBERS["yeoh"], dtype=np.int32),
        modulus=np.pad(np.tile([1000.0, MU], (count, 1)), ((0, 0), (0, MODULI - 2))),
        pure_number=np.zeros((count, PURE_NUMBERS)),
        lag=0.11 * ones,
        factor=1e-3 * ones,
        undamped=0.1 * ones,
    )


def noise(count: int) -> np.ndarray:
    """Of 1 to 8 units in the last place of one: in all entries, and as a multiple of one with quarters of a unit beside
    it, which a matrix has that came from a rotated body; shape (count, 3, 3)."""
    random = np.random.default_rng(1)
    full = random.integers(-16, 17, (count // 2, 3, 3)) * HALF_ULP
    equal = random.integers(-16, 17, (count - count // 2, 1, 1)) * np.eye(3)
    beside = random.integers(-2, 3, (count - count // 2, 3, 3)) / 2.0 * (1.0 - np.eye(3))
    return np.concatenate([full, (equal + beside) * HALF_ULP])


def test_deformations_next_to_none() -> None:
    """F = 1 + noise: axes are a rotation, and stresses are round-off: moduli of 1000 kPa times 1e-14."""
    deformation = np.eye(3) + noise(400_000)
    count = len(deformation)
    position = np.zeros((4 * count, 3))
    for k in range(3):
        position[k + 1 :: 4] = deformation[:, :, k]
    stress, axes, tangent = (np.zeros((count, 3, 3)) for _ in range(3))
    respond(single_domains(count), Movement(position, np.zeros_like(position)), stress, axes, tangent)
    assert np.isfinite(axes).all()
    assert np.abs(axes.transpose(0, 2, 1) @ axes - np.eye(3)).max() < 1e-14
    assert np.abs(stress).max() < 1e-10  # nan is not below
    assert np.isfinite(tangent).all()


@pytest.mark.parametrize("material", ["neo-hookean", "yeoh", "ogden"])
def test_turned_bodies_at_rest_have_a_matrix(block: Callable[..., str], material: str) -> None:
    """A block of smoothed elements in 20 orientations: its matrix is finite, its forces are round-off."""
    coefficients = {
        "neo-hookean": {"young_modulus": 300.0},
        "yeoh": {"coefficients": {"c10": 50.0, "c20": 2.0, "c30": 0.1}},
        "ogden": {"coefficients": {"mu1": 50.0, "alpha1": 2.5}},
    }[material]
    table = {"mesh": block((5, 4, 3), (50.0, 40.0, 30.0)), "density": 1e-6, "poisson_ratio": 0.499, "law": material}
    scene = scene_from_dict({"soft_bodies": {"block": {**table, "element": "smoothed", **coefficients}}})
    model = Simulation(scene).model
    assert model.elasticity is not None
    system = ElasticSystem(model.elasticity)
    for turn in Rotation.random(20, rng=np.random.default_rng(3)).as_matrix():
        system.position[:] = model.rest_position @ turn.T
        system.solver.blocks[:] = 0.0
        system.assemble()
        assert np.isfinite(system.solver.blocks).all()
        assert np.abs(system.force).max() < 1e-6


def test_the_mesh_that_failed_at_its_first_step(shared: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A finger of 4472 nodes, of which one domain around a node had no axes at rest."""
    folder = shared / "reference" / "indefinite"
    if not (folder / "badmesh.msh").exists():
        pytest.skip("needs ../shared/reference/indefinite, which is not part of the project")
    monkeypatch.chdir(folder)
    simulation = Simulation(load_scene("tip_force.toml"))
    simulation.step()
    assert np.isfinite(simulation.state.position).all()
