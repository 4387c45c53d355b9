"""Slender bars and Cook's membrane against theory, by the study of bending."""

import numpy as np
import pytest
from bending import (
    cook_deflection,
    cook_reference,
    critical_load_error,
    elastica,
    elastica_error,
    frequency_error,
)
from blocks import make_block
from conftest import Figures

import taichisoft
from taichisoft.mesh.volume_mesh import BENDS, GROWS
from taichisoft_benchmarks.regular_meshes import hollow_sphere

BENDING = ("smoothed", "quadratic")


def test_the_elastica_begins_as_a_straight_beam() -> None:
    """For small weights the deflection is w L^4 / (8 EI), but for its square."""
    assert elastica(1e-3) == pytest.approx(1e-3 / 8, rel=1e-6)


@pytest.mark.parametrize("element", BENDING)
@pytest.mark.parametrize("load", [2.0, 10.0])
def test_elastica(element: str, load: float, figures: Figures) -> None:
    """The end of a bar under its weight, w L^3 / EI = 2 and 10, sinks by 0.24 and 0.70 of its length, within 1 %.

    What is left is the mesh and the bar's extension, w L / EA = load (h / L)^2 / 12, which is 0.1 % for 10.
    """
    figures.at_most("relative error", abs(elastica_error(element, load)), 0.01)


@pytest.mark.parametrize("element", BENDING)
def test_eulers_column(element: str, figures: Figures) -> None:
    """pi^2 EI / (4 L^2), within 1 %: the compression of 1 % of the column at that load, and the mesh."""
    figures.at_most("relative error", abs(critical_load_error(element)), 0.01)


@pytest.mark.parametrize("element", BENDING)
def test_first_frequency_of_a_bar(element: str, figures: Figures) -> None:
    """1.8751^2 / (2 pi) sqrt(EI / (rho A L^4)), within 1 %: shear and the turning of sections take 0.1 %."""
    figures.at_most("relative error", abs(frequency_error(element)), 0.01)


def test_linear_tetrahedra_are_too_stiff() -> None:
    """What the others are for: with two cells over the height the frequency is a quarter too high."""
    assert frequency_error("linear") > 0.2


def test_hexahedra_bend_as_their_parasitic_shear_has_it(figures: Figures) -> None:
    """A cube with corners alone bends with a shear strain x where y is the height: G x^2 beside E y^2 of the strain.

    With G = E / 2 and n cubes over the height, the share 1 / n^2 of the stiffness that lies within cubes is half as
    large again: 1 + 1 / (2 n^2), here 1.125, and the frequency its root, to 0.2 % as for the other elements.
    """
    figures.close("frequency over the beam's [-]", 1.0 + frequency_error("hexahedral"), np.sqrt(1.125), 0.002)


def test_cooks_membrane(figures: Figures) -> None:
    """Nearly incompressible, at large strain: the rise of the corner by mixed elements, which do not lock.

    Six quadratic cells a side are a tenth below, 16 are 2 %: within 12 %. Linear tetrahedra lock: below half of it.
    Hexahedra with one volume each do not: 8 cells are 4.5 % below, 6 within 8 %.
    """
    exact = cook_reference(8)
    figures.close("mixed elements, 4 cells, over 8 [-]", cook_reference(4) / exact, 1.0, 0.01)
    figures.close("quadratic, 6 cells [mm]", cook_deflection("quadratic", 6), exact, 0.12 * exact)
    assert cook_deflection("linear", 8) < 0.5 * exact
    figures.close("hexahedral, 6 cells [mm]", cook_deflection("hexahedral", 6), exact, 0.08 * exact)


def test_the_reference_of_cooks_membrane_is_another_program_for_the_same_body(figures: Figures) -> None:
    """At Poisson's ratio 0.3, where nothing locks, both converge to one rise; 1 % is left with 8 cells a side."""
    ours, other = cook_deflection("quadratic", 8, 0.3), cook_reference(8, 0.3)
    figures.close("quadratic over mixed elements, 0.3 [-]", ours / other, 1.0, 0.01)


def simulated(mesh: taichisoft.VolumeMesh, step: float, gravity: float, **table: object) -> taichisoft.Simulation:
    body = {"mesh": "tutorial-coarse", "density": 1e-6, "young_modulus": 300.0, **table}
    scene = {"gravity": [0.0, 0.0, -gravity], "time": {"step": step}, "soft_bodies": {"body": body}}
    return taichisoft.Simulation(taichisoft.Model(taichisoft.scene_from_dict(scene), {"body": mesh}))


@pytest.mark.parametrize("ratio", [0.3, 0.45, 0.499])
@pytest.mark.parametrize("across", [1, 2])
def test_bars_bend_as_the_warning_says(across: int, ratio: float, figures: Figures) -> None:
    """A cantilever of 60 x 5 x 5 mm under its weight, over rho g A L^4 / (8 EI); two elements, as docs/elements.md."""
    mesh = make_block((12 * across, across, across), (60.0, 5.0, 5.0))
    anchors = [{"box": [[-31, -9, -9], [-29.99, 9, 9]]}]
    at_rest = taichisoft.equilibrium(simulated(mesh, 0.01, 490.5, poisson_ratio=ratio, anchors=anchors)).state.position
    tip = mesh.nodes[:, 0] > 29.99
    sag = (mesh.nodes - at_rest)[tip, 2].mean() / (1e-6 * 490.5 * 60.0**4 * 12.0 / (8 * 300.0 * 5.0**2))
    expected = BENDS[ratio] if across == 1 else {0.3: 1.01, 0.45: 0.94, 0.499: 0.72}[ratio]
    figures.close("deflection over theory [-]", sag, expected, 0.006)


@pytest.mark.parametrize("ratio", [0.3, 0.45, 0.499])
@pytest.mark.parametrize("across", [1, 2])
def test_spheres_grow_as_the_warning_says(across: int, ratio: float, figures: Figures) -> None:
    """Radii a = 10 and b = 13 mm under p = 0.1 kPa, over Lame's growth of the inner one."""
    mesh, inner, outer = hollow_sphere(10.0, 13.0, 4, across), 10.0, 13.0
    springs = [{"box": [[-14, -14, -14], [14, 14, 14]], "stiffness": 1e-3}]  # which hold it in place, and no more
    cavities = {"air": {"group": "cavity"}}
    simulation = simulated(mesh, 10.0, 0.0, poisson_ratio=ratio, anchors=springs, cavities=cavities)
    for _ in range(3):
        simulation.step(taichisoft.Control(pressure={"body.air": 0.1}))
    inside = np.linalg.norm(mesh.nodes, axis=1) < inner + 1e-6
    growth = ((simulation.state.position - mesh.nodes) * mesh.nodes)[inside].sum(axis=1).mean() / inner
    shape = (1 - 2 * ratio) * inner + (1 + ratio) * outer**3 / (2 * inner**2)
    lame = 0.1 * inner**3 / (outer**3 - inner**3) * shape / 300.0
    figures.close("growth over Lame's [-]", growth / lame, GROWS[ratio] if across == 1 else 1.01, 0.006)
