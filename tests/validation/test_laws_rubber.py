"""Laws of rubber against their closed forms: on affine states, by virtual work, and where an element is inside out."""

from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
import pytest
from blocks import make_block
from scenes import advance, dense_matrix, silicone, simulate
from scipy.spatial.transform import Rotation

from taichisoft import Model, write_volume_mesh
from taichisoft.mechanics import ElasticSystem
from taichisoft.mechanics.elasticity import internal_force

SIZE = (30.0, 20.0, 10.0)
ELEMENTS = ("linear", "smoothed", "quadratic")
POISSON = 0.49


@dataclass(frozen=True)
class Law:
    """A law as a scene names it, and its energy of shape [kPa] as textbooks have it where the volume stays."""

    name: str
    keys: dict[str, Any]
    c10: float = 0.0
    c01: float = 0.0
    c20: float = 0.0
    c30: float = 0.0
    ogden: tuple[tuple[float, float], ...] = ()

    @property
    def shear_modulus(self) -> float:
        return 2 * (self.c10 + self.c01) + sum(mu * alpha for mu, alpha in self.ogden) / 2

    @property
    def lame(self) -> float:
        return 2 * self.shear_modulus * POISSON / (1 - 2 * POISSON)

    def slopes(self, i1: float) -> tuple[float, float]:
        """Derivatives of the energy by I1 and I2."""
        return self.c10 + 2 * self.c20 * (i1 - 3) + 3 * self.c30 * (i1 - 3) ** 2, self.c01

    def energy(self, deformation: np.ndarray, volume: np.ndarray) -> float:
        """Sum over domains of these volumes, (count, 2), for shape and for volume [uJ]; F of shape (count, 3, 3)."""
        stretch, j = np.linalg.svd(deformation)[1], np.linalg.det(deformation)
        stretch[:, 2] *= np.sign(j)
        i1 = (stretch**2).sum(axis=1)
        i2 = 0.5 * (i1**2 - (stretch**4).sum(axis=1))
        k, rest = i1 - 3 - 2 * (j - 1) + (j - 1) ** 2, i2 - 3 - 4 * (j - 1)
        shape = self.c10 * k + self.c01 * rest + self.c20 * k**2 + self.c30 * k**3
        for mu, alpha in self.ogden:
            shape = shape + mu / alpha * ((stretch**alpha).sum(axis=1) - 3) + mu * ((j - 1) ** 2 / 2 - (j - 1))
        return float(volume[:, 0] @ shape + volume[:, 1] @ (self.lame / 2 * (j - 1) ** 2))


OGDEN = ((60.0, 1.3), (0.4, 5.0), (-1.5, -2.0))
OGDEN_COEFFICIENTS = {
    f"{name}{p}": one for p, pair in enumerate(OGDEN, 1) for name, one in zip(("mu", "alpha"), pair, strict=True)
}
LAWS = {
    law.name: law
    for law in (
        Law("neo-hookean", {"young_modulus": 2 * (1 + POISSON) * 90.0}, c10=45.0),
        Law("mooney-rivlin", {"coefficients": {"c10": 35.0, "c01": 10.0}}, c10=35.0, c01=10.0),
        Law("yeoh", {"coefficients": {"c10": 36.0, "c20": 2.5, "c30": 0.2}}, c10=36.0, c20=2.5, c30=0.2),
        Law("ogden", {"coefficients": OGDEN_COEFFICIENTS}, ogden=OGDEN),
    )
}


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> dict[tuple[str, str], Model]:
    """A block of 48 tetrahedra by element and law."""
    path = tmp_path_factory.mktemp("mesh") / "block.msh"
    write_volume_mesh(make_block((2, 2, 2), SIZE), path)
    return {(element, name): _model(str(path), element, name) for element, name in product(ELEMENTS, LAWS)}


def _body(mesh: str, element: str, law: str, **changes: Any) -> dict[str, Any]:
    table = silicone(mesh, element=element, law=law, poisson_ratio=POISSON, **changes)
    return {key: value for key, value in table.items() if key != "young_modulus"} | LAWS[law].keys


def _model(mesh: str, element: str, law: str) -> Model:
    return simulate(soft_bodies={"block": _body(mesh, element, law, rayleigh_stiffness=0.0)}).model


def _forces(model: Model, position: np.ndarray) -> np.ndarray:
    assert model.elasticity is not None
    return internal_force(model.elasticity, position)


def _piola(model: Model, deformation: np.ndarray) -> np.ndarray:
    """The first Piola stress [kPa] of an affine state from the forces on the faces, whose tractions are -P N."""
    force, stress = _forces(model, model.rest_position @ deformation.T), np.zeros((3, 3))
    for axis in range(3):
        on_face = np.isclose(model.rest_position[:, axis], SIZE[axis] / 2)
        stress[:, axis] = -force[on_face].sum(axis=0) * SIZE[axis] / np.prod(SIZE)
    return stress


@pytest.mark.parametrize(("element", "name"), list(product(ELEMENTS, LAWS)))
@pytest.mark.parametrize("stretch", [0.7, 1.2, 2.5])
def test_tension_of_a_body_that_keeps_its_volume(
    models: dict[tuple[str, str], Model], element: str, name: str, stretch: float
) -> None:
    """Along one axis, along two, and along one with another held: differences of Cauchy stresses s_1 - s_3, which do
    not depend on the resistance to changes of volume, are 2 (l1^2 - l3^2) (W1 + l2^2 W2), Ogden's sum mu (l1^a - l3^a).

    Tolerance 1e-8 of the shear modulus: round-off times lambda, which is 50 shear moduli.
    """
    law = LAWS[name]
    for second in (stretch**-0.5, stretch, 1.0):
        stretches = np.array([stretch, second, 1 / (stretch * second)])
        cauchy = np.diag(_piola(models[element, name], np.diag(stretches))) * stretches
        l1, l2, l3 = stretches
        w1, w2 = law.slopes((stretches**2).sum())
        expected = 2 * (l1**2 - l3**2) * (w1 + l2**2 * w2) + sum(mu * (l1**a - l3**a) for mu, a in law.ogden)
        assert cauchy[0] - cauchy[2] == pytest.approx(expected, rel=1e-8, abs=1e-8 * law.shear_modulus)


@pytest.mark.parametrize(("element", "name"), list(product(ELEMENTS, LAWS)))
def test_simple_shear(models: dict[tuple[str, str], Model], element: str, name: str) -> None:
    """The shear stress is 2 g (W1 + W2), Ogden's sum mu (l^a - l^-a) / (l + 1 / l), for l - 1 / l = g."""
    law, shear = LAWS[name], 0.8
    turn = Rotation.from_rotvec([0.4, -1.0, 2.0]).as_matrix()
    deformation = np.eye(3)
    deformation[0, 1] = shear
    stress = turn.T @ _piola(models[element, name], turn @ deformation)
    l1 = (shear + np.sqrt(shear**2 + 4)) / 2
    expected = 2 * shear * sum(law.slopes(3 + shear**2)) + sum(
        mu * (l1**a - l1**-a) / (l1 + 1 / l1) for mu, a in law.ogden
    )
    assert stress[0, 1] == pytest.approx(expected, rel=1e-8)


@pytest.mark.parametrize(("element", "name"), list(product(ELEMENTS, LAWS)))
def test_virtual_work(models: dict[tuple[str, str], Model], element: str, name: str) -> None:
    """The forces are the slopes of the energy, which is computed apart, for strains that differ everywhere.

    Tolerance 1e-6 of the largest work: central differences of 1e-3 mm over 5 mm, squared, and round-off.
    """
    model, law, random = models[element, name], LAWS[name], np.random.default_rng(6)
    assert model.elasticity is not None
    assert model.elasticity.domains is not None
    domains = model.elasticity.domains.domains
    position = 1.1 * model.rest_position + random.uniform(-0.2, 0.2, model.rest_position.shape)
    force = _forces(model, position)
    for _ in range(3):
        motion = 1e-4 * random.uniform(-1, 1, position.shape)
        ahead, behind = (law.energy(domains.deformation(position + s * motion), domains.volume) for s in (1, -1))
        scale = np.abs(force * motion).sum()
        assert (ahead - behind) / 2 == pytest.approx(-(force * motion).sum(), abs=1e-6 * scale)


@pytest.mark.parametrize(("element", "name"), list(product(ELEMENTS, LAWS)))
def test_the_matrix_is_the_slope_of_the_forces_in_tension(
    models: dict[tuple[str, str], Model], element: str, name: str
) -> None:
    """In tension no eigenvalue is negative, so that K is exact: -df/dx = K, and f - h K v follows it without damping.

    Principal stresses must not be negative, nor so large that they turn the material: 0.6 shear moduli at J = 1.012.
    Smoothed elements have the energies of shape and volume in different domains, where only rest is so. Central
    differences: 1e-6 of the largest, also along velocities, since the body is turned on before it is linearised.
    """
    model, random = models[element, name], np.random.default_rng(8)
    assert model.elasticity is not None
    stretches = [1.0, 1.0, 1.0] if element == "smoothed" else [1.2, 1.05, 1.012 / (1.2 * 1.05)]
    turn = Rotation.from_rotvec([1.0, -0.3, 0.5]).as_matrix()
    position = model.rest_position @ (turn @ np.diag(stretches)).T
    system = ElasticSystem(model.elasticity)
    system.position[:] = position
    system.assemble()
    matrix = dense_matrix(system, len(position)) - np.diag(np.repeat(model.elasticity.node_mass, 3))
    lag = model.elasticity.node_lag[0]
    matrix /= model.scene.time.step * lag
    assert np.linalg.eigvalsh(matrix).min() > -1e-9 * np.abs(matrix).max()
    for _ in range(3):
        motion = random.uniform(-1, 1, position.shape)
        ahead, behind = (_forces(model, position + s * 1e-4 * motion) for s in (1, -1))
        pull = (matrix @ motion.ravel()).reshape(-1, 3)
        np.testing.assert_allclose((behind - ahead) / 2e-4, pull, atol=1e-6 * np.abs(pull).max())
        lagged = []
        for sign in (1, -1):
            system.velocity[:] = sign * 1e-3 * motion
            system.assemble()
            lagged.append(system.force.copy())
        np.testing.assert_allclose(lagged[1] - lagged[0], 2e-3 * lag * pull, atol=1e-9 * lag * np.abs(pull).max())


@pytest.mark.parametrize(("element", "name"), list(product(ELEMENTS, LAWS)))
def test_small_strains_follow_hookes_law(models: dict[tuple[str, str], Model], element: str, name: str) -> None:
    """At strains of 1e-6 the stress is lambda tr(e) 1 + 2 mu e, but for some 1e-5 of it."""
    law, strain = LAWS[name], 1e-6 * np.array([[1.0, 0.4, -0.2], [0.4, -0.5, 0.7], [-0.2, 0.7, 0.3]])
    expected = law.lame * np.trace(strain) * np.eye(3) + 2 * law.shear_modulus * strain
    stress = _piola(models[element, name], np.eye(3) + strain)
    np.testing.assert_allclose(stress, expected, atol=1e-5 * np.abs(expected).max())


@pytest.mark.parametrize(("element", "name"), list(product(ELEMENTS, LAWS)))
def test_a_body_turned_inside_out_comes_back(
    models: dict[tuple[str, str], Model], element: str, name: str, tmp_path: Any
) -> None:
    """Corners pushed through the block, held by nothing, come back to rest: all laws push inverted elements out."""
    path = tmp_path / "block.msh"
    write_volume_mesh(make_block((2, 2, 2), SIZE), path)
    simulation = simulate(soft_bodies={"block": _body(str(path), element, name, rayleigh_stiffness=0.1)})
    rest = simulation.model.rest_position
    position = rest.copy()
    corner = (rest == np.array(SIZE) / 2).all(axis=1)
    position[corner] *= 0.0 if element == "quadratic" else -0.3
    simulation.restore(simulation.state.changed(position=position))
    advance(simulation, 3.0)
    domains = simulation.model.elasticity.domains.domains
    assert np.linalg.det(domains.deformation(position)).min() < 0.0
    deformation = domains.deformation(simulation.state.position)
    np.testing.assert_allclose(np.linalg.svd(deformation)[1], 1.0, atol=0.02)
    assert np.linalg.det(deformation).min() > 0.9


@pytest.mark.parametrize("how", ["mirrored", "flat"])
@pytest.mark.parametrize(("element", "name"), list(product(("smoothed", "quadratic"), ("neo-hookean", "yeoh"))))
def test_a_body_wholly_inside_out_comes_back(element: str, name: str, how: str, tmp_path: Any) -> None:
    """Mirrored, or pressed flat, and let go: with converged steps it comes back to rest, and not to a mirror image.

    Some steps on the way do not converge, since far out the tangent is another than the slope; the last do.
    """
    path = tmp_path / "block.msh"
    write_volume_mesh(make_block((2, 2, 2), SIZE), path)
    body = _body(str(path), element, name, rayleigh_stiffness=0.1)
    simulation = simulate(time={"step": 0.05, "newton": 20}, soft_bodies={"block": body})
    rest = simulation.model.rest_position
    simulation.restore(simulation.state.changed(position=rest * {"mirrored": [-1, 1, 1], "flat": [1, 1, 0]}[how]))
    reports = [simulation.step() for _ in range(40)]
    assert reports[-1].inverted_elements == 0
    assert all(report.converged for report in reports[-10:])
    domains = simulation.model.elasticity.domains.domains
    deformation = domains.deformation(simulation.state.position)
    assert np.linalg.det(deformation).min() > 0.9
    np.testing.assert_allclose(np.linalg.svd(deformation)[1], 1.0, atol=0.01)
