"""Stretches of elements, and what a run says of bodies stretched beyond their law."""

import warnings
from collections.abc import Callable

import numpy as np
import pytest
from conftest import examples
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import taichisoft
from taichisoft import Control, Controller, Simulation, run
from taichisoft.errors import SimulationDiverged
from taichisoft.mechanics import Stretches
from taichisoft.mechanics.strain import HOOKE_STRETCH
from taichisoft.scene import scene_from_dict

TETRAHEDRA = np.random.default_rng(3).normal(size=(40, 3)) * 10.0
ELEMENTS = np.arange(40).reshape(-1, 4)


class Constant(Controller):
    """Asks for one pressure."""

    def __init__(self, pressure: float):
        self.pressure = pressure

    def control(self, observation) -> Control:
        return Control(pressure={"block.air": self.pressure})


@examples(60)
@given(seed=st.integers(0, 10**6), size=st.floats(0.0, 2.0))
def test_the_largest_stretch_is_the_largest_singular_value(seed: int, size: float) -> None:
    """Of x = F X + t, turned at random, for any F; tolerance 1e-7: where two stretches are equal, half the digits."""
    generator = np.random.default_rng(seed)
    deformation = np.eye(3) + size * generator.uniform(-1, 1, (3, 3))
    turned = Rotation.random(rng=generator).as_matrix() @ deformation
    found = Stretches(TETRAHEDRA, ELEMENTS).largest(TETRAHEDRA @ turned.T + 5.0)
    np.testing.assert_allclose(found, np.linalg.svd(deformation)[1][0], rtol=1e-7)


@pytest.mark.parametrize("stretch", [(1.0, 1.0, 1.0), (1.5, 1.5, 1.0), (1.5, 1.0, 1.0), (0.0, 0.0, 0.0)])
def test_equal_stretches_are_no_difficulty(stretch: tuple[float, float, float]) -> None:
    found = Stretches(TETRAHEDRA, ELEMENTS).largest(TETRAHEDRA * stretch)
    np.testing.assert_allclose(found, max(stretch), atol=1e-7)


def test_hookes_range_is_what_it_says() -> None:
    """E (l - 1) over E (l - l^-2) / 3, the force of neo-Hookean rubber of equal moduli: 1.19 at 1.2, 1.71 at 2."""
    for stretch, ratio in ((HOOKE_STRETCH, 1.187), (2.0, 1.714)):
        assert 3.0 * (stretch - 1.0) / (stretch - stretch**-2) == pytest.approx(ratio, abs=1e-3)


def scene(mesh: str, **body: object):
    table = {
        "mesh": mesh,
        "density": 1e-6,
        "young_modulus": 100.0,
        "poisson_ratio": 0.3,
        "rayleigh_stiffness": 0.1,
        "cavities": {"air": {"group": "cavity"}},
    }
    tables = {**table, **body}
    return scene_from_dict({"gravity": [0, 0, 0], "time": {"duration": 1.0}, "soft_bodies": {"block": tables}})


def said(mesh: str, pressure: float, **body: object) -> list[str]:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        run(Simulation(scene(mesh, **body)), Constant(pressure), [])
    return [str(one.message) for one in caught]


def test_a_run_says_once_that_a_body_has_left_the_range_of_its_law(block: Callable[..., str]) -> None:
    """Which body, how far, where and when; and nothing while the stretch is below 1.2."""
    mesh = block((4, 4, 4), (20.0, 20.0, 20.0), hollow=True)
    assert said(mesh, 5.0) == []
    (line,) = said(mesh, 15.0)
    assert line.startswith("'block' is stretched 1.")
    assert "-fold at (" in line and "Hooke's law holds up to 1.2" in line
    assert "\n" not in line


def test_leaving_a_law_is_told_without_a_run(block: Callable[..., str]) -> None:
    """Steps and equilibria say it once, and their results have the largest stretch over that of the law."""
    mesh = block((4, 4, 4), (20.0, 20.0, 20.0), hollow=True)
    anchors = [{"box": [[-11, -11, -11], [11, 11, -9.9]]}]
    simulation = Simulation(scene(mesh, anchors=anchors))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        at_rest = taichisoft.equilibrium(simulation, Control(pressure={"block.air": 5.0}))
        assert not caught and 0.5 < at_rest.stretch_over_law["block"] < 1.0
        reports = [simulation.step(Control(pressure={"block.air": 20.0})) for _ in range(60)]
        found = taichisoft.equilibrium(simulation)
    (line,) = (str(one.message) for one in caught)
    assert line.startswith("'block' is stretched 1.") and "Hooke's law holds up to 1.2" in line
    largest = Stretches(simulation.model.rest_position, simulation.model.soft_bodies[0].elements)
    assert reports[-1].stretch_over_law == {"block": largest.largest(simulation.state.position).max() / HOOKE_STRETCH}
    assert found.stretch_over_law["block"] > 1.0


def test_a_divergence_by_large_strain_names_the_law(block: Callable[..., str]) -> None:
    mesh = block((4, 4, 4), (20.0, 20.0, 20.0), hollow=True)
    simulation = Simulation(scene(mesh))
    with pytest.raises(SimulationDiverged, match=r"Hooke's law holds up to 1\.2"):
        for step in range(400):
            simulation.step(Control(pressure={"block.air": 2.0 * step}))


@pytest.mark.parametrize(("ratio", "warned"), [(0.45, False), (0.46, True)])
def test_linear_elements_of_hardly_compressible_rubber_are_warned_of(
    block: Callable[..., str], ratio: float, warned: bool
) -> None:
    """At loading; the line names the key and the remedy."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        mesh = block((4, 4, 4), (20.0, 20.0, 20.0), hollow=True)
        Simulation(scene(mesh, poisson_ratio=ratio, element="linear"))
    lines = [str(one.message) for one in caught]
    assert len(lines) == warned
    if warned:
        assert lines[0].startswith("soft_bodies.block.poisson_ratio = 0.46: linear elements lock above 0.45")
        assert 'element = "smoothed"' in lines[0]
