"""Bending, buckling and swinging of bars, and Cook's membrane, by each kind of element, against theory.

    python -m taichisoft_benchmarks.studies.bending --output docs/elements.md

fills the section "bending" of the page, in some three minutes.
"""

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.integrate import solve_bvp
from scipy.optimize import brentq
from scipy.sparse import diags_array
from scipy.sparse.linalg import eigsh

from taichisoft.mesh import VolumeMesh
from taichisoft_benchmarks.marked_page import PageOption, fill_section, heading, row
from taichisoft_benchmarks.measures.factorisation_times import system_matrix
from taichisoft_benchmarks.program import run_program
from taichisoft_benchmarks.regular_meshes import bar
from taichisoft_benchmarks.studies.cook_membrane import corner_rise
from taichisoft_benchmarks.studies.one_body import WEAK, at_rest, simulation_of

if TYPE_CHECKING:
    from taichisoft.contact import Model

LENGTH, HEIGHT = 100.0, 4.0
"""Of the bar [mm]; it is square, and clamped at one end."""
YOUNG_MODULUS, DENSITY = 500.0, 1e-6
STIFFNESS = YOUNG_MODULUS * HEIGHT**4 / 12
"""EI [mN mm^2]; Poisson's ratio is 0, so that sections keep their shape as in the theory of beams."""
CELLS = {"linear": (50, 2, 2), "smoothed": (50, 2, 2), "quadratic": (25, 1, 1), "hexahedral": (50, 2, 2)}
"""Of the bar's meshes: quadratic elements have as many nodes as the others."""

COOK_MODULUS, COOK_POISSON, COOK_LOAD = 240.565, 0.4999, 100.0
"""kPa, and mN for each mm of thickness (de Souza Neto et al. 1996, Design of simple low order finite elements)."""


def traction(x: float, load: tuple[float, float, float]) -> "Callable[[Model], np.ndarray]":
    """A uniform traction with the sum `load` [mN] on the plane face at `x` [mm]."""
    return lambda model: _shares(model.soft_bodies[0].elements, model.rest_position, x)[:, None] * load


def _shares(elements: np.ndarray, nodes: np.ndarray, x: float) -> np.ndarray:
    """Shares of the nodes in a uniform traction on the plane face at `x` [mm], shape (node_count,)."""
    corners = np.array([[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]])
    middles = np.array([[4, 5, 6], [4, 8, 7], [6, 9, 7], [5, 9, 8]])
    faces = elements[:, corners].reshape(-1, 3)
    there = np.isclose(nodes[faces][:, :, 0], x).all(axis=1)
    a, b, c = np.moveaxis(nodes[faces[there]], 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    # Over a triangle, the integral of a corner's quadratic shape function is zero, of a middle node's a third.
    carries = faces if elements.shape[1] == 4 else elements[:, middles].reshape(-1, 3)
    shares = np.bincount(carries[there].ravel(), np.repeat(area, 3), len(nodes))
    return np.asarray(shares / shares.sum())


def _clamp() -> list[dict[str, Any]]:
    return [{"box": [[-1e-6, -1.0, -1.0], [1e-6, HEIGHT + 1.0, HEIGHT + 1.0]]}]


def _bar_at_rest(element: str, load: tuple[float, float, float], weight: float = 0.0) -> np.ndarray:
    """Mean displacement of the end of the bar [mm] under a force there [mN] and weight of so much a length [mN/mm]."""
    face = {"box": [[LENGTH - 1e-6, -1.0, -1.0], [LENGTH + 1e-6, HEIGHT + 1.0, HEIGHT + 1.0]], "stiffness": WEAK}
    motion, nodes = at_rest(
        bar(CELLS[element], (LENGTH, HEIGHT, HEIGHT), element),
        gravity=(0.0, 0.0, -weight / (DENSITY * HEIGHT**2)),
        dead_load=traction(LENGTH, load),
        element=element,
        law="neo-hookean",
        young_modulus=YOUNG_MODULUS,
        poisson_ratio=0.0,
        anchors=[*_clamp(), face],
    )
    return np.asarray(motion[np.isclose(nodes[:, 0], LENGTH)].mean(axis=0))


def elastica(load: float) -> float:
    """Deflection of the end of an inextensible cantilever over its length, by w L^3 / EI, w weight a length.

    th'' = -k (1 - s) cos th, th(0) = 0, th'(1) = 0, for angles th below the level and s from 0 to 1.
    """

    def slopes(s: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.vstack([y[1], -load * (1 - s) * np.cos(y[0]), np.sin(y[0])])

    def ends(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.array([a[0], b[1], a[2]])

    s = np.linspace(0, 1, 101)
    found = solve_bvp(slopes, ends, s, np.vstack([s, 1 - s, s**2 / 2]), tol=1e-8)
    return float(found.y[2, -1])


def elastica_error(element: str, load: float) -> float:
    """Relative error of the bar's deflection under its own weight, by w L^3 / EI."""
    tip = _bar_at_rest(element, (0.0, 0.0, 0.0), load * STIFFNESS / LENGTH**3)
    return float(-tip[2] / LENGTH / elastica(load) - 1.0)


def critical_load_error(element: str) -> float:
    """Relative error of Euler's critical load of a column, pi^2 EI / (4 L^2), from how a compression of half of it
    lets the column give way to a small force across: by 3 (tan u - u) / u^3, u = L sqrt(P / EI)."""
    across, compression = 1e-4 * STIFFNESS / LENGTH**2, np.pi**2 * STIFFNESS / (8 * LENGTH**2)
    alone = _bar_at_rest(element, (0.0, 0.0, across))[2]
    together = _bar_at_rest(element, (-compression, 0.0, across))[2]
    u = brentq(lambda u: 3 * (np.tan(u) - u) / u**3 - together / alone, 1e-3, 0.5 * np.pi - 1e-6)
    return float(compression * (np.pi / 2 / u) ** 2 / (np.pi**2 * STIFFNESS / (4 * LENGTH**2)) - 1.0)


def frequency_error(element: str) -> float:
    """Relative error of the bar's first frequency, 1.8751^2 / (2 pi) sqrt(EI / (rho A L^4)), by the matrices."""
    from taichisoft.mechanics import ElasticSystem

    keys: dict[str, Any] = {
        "density": DENSITY,
        "young_modulus": YOUNG_MODULUS,
        "poisson_ratio": 0.0,
        "element": element,
    }
    mesh = bar(CELLS[element], (LENGTH, HEIGHT, HEIGHT), element)
    model = simulation_of(mesh, {"step": 1.0}, anchors=_clamp(), **keys).model
    assert model.elasticity is not None
    system = ElasticSystem(model.elasticity)
    system.position[:] = model.rest_position
    system.assemble()
    matrix = system_matrix(system.solver.symbolic.block_pairs, system.solver.blocks, model.node_count)
    mass = diags_array(np.repeat(model.elasticity.node_mass, 3))
    # M + h^2 K, with a step of 1 s; inverse iteration about 0 finds the lowest frequencies.
    lowest = eigsh((matrix - mass).tocsc(), 2, mass.tocsc(), sigma=0.0, return_eigenvectors=False).min()
    exact = 1.8751040687**2 * np.sqrt(STIFFNESS / (DENSITY * HEIGHT**2 * LENGTH**4))
    return float(np.sqrt(lowest) / exact - 1.0)


def cook_deflection(element: str, cells: int, poisson_ratio: float = COOK_POISSON) -> float:
    """Rise of the upper corner of Cook's membrane [mm] in plane strain, at large strain.

    A panel of 48 mm, 44 mm high where it is clamped and 16 mm where it is sheared, a cell thick.
    """
    thickness = 44.0 / cells
    mesh = bar((cells, cells, 1), (1.0, 1.0, thickness), element)
    across, up = mesh.nodes[:, 0].copy(), mesh.nodes[:, 1].copy()
    nodes = np.column_stack([48.0 * across, 44.0 * across + (44.0 - 28.0 * across) * up, mesh.nodes[:, 2]])
    panel = VolumeMesh("Cook's membrane", nodes, mesh.elements, {}).check()
    clamp = {"box": [[-1e-6, -1.0, -1.0], [1e-6, 45.0, 50.0]]}
    sides = [{"box": [[-1.0, -1.0, z - 1e-6], [49.0, 61.0, z + 1e-6]], "directions": ["z"]} for z in (0.0, thickness)]
    face = {"box": [[48.0 - 1e-6, -1.0, -1.0], [48.0 + 1e-6, 61.0, thickness + 1.0]], "stiffness": WEAK}
    motion, rest_nodes = at_rest(
        panel,
        dead_load=traction(48.0, (0.0, COOK_LOAD * thickness, 0.0)),
        ramp=4,
        element=element,
        law="neo-hookean",
        density=DENSITY,
        young_modulus=COOK_MODULUS,
        poisson_ratio=poisson_ratio,
        anchors=[clamp, *sides, face],
    )
    corner = np.isclose(rest_nodes[:, :2], [48.0, 60.0]).all(axis=1)
    return float(motion[corner, 1].mean())


def cook_reference(cells: int, poisson_ratio: float = COOK_POISSON) -> float:
    """The same rise by mixed elements in the plane, which do not lock [mm]."""
    shear, first = COOK_MODULUS / (2 * (1 + poisson_ratio)), poisson_ratio / (1 - 2 * poisson_ratio)
    return corner_rise(cells, shear, 2 * shear * first, COOK_LOAD)


def page_section() -> Iterator[str]:
    """The study as Markdown, line by line."""
    yield heading(["", *CELLS])
    rows = {
        "elastica, w L^3 / EI = 2, deflection": lambda element: elastica_error(element, 2.0),
        "elastica, w L^3 / EI = 10, deflection": lambda element: elastica_error(element, 10.0),
        "Euler's column, critical load": critical_load_error,
        "first frequency of the bar": frequency_error,
    }
    for name, error in rows.items():
        yield row([name, *(f"{error(element):+.1%}" for element in CELLS)])
    for cells in (8, 16):
        found = [cook_deflection(name, cells // 2 if name == "quadratic" else cells) for name in CELLS]
        name = f"Cook's membrane, {cells} cells a side (quadratic {cells // 2})"
        yield row([name, *(f"{rise:.2f} mm" for rise in found)])
    yield f"| Cook's membrane, quadratic, 16 cells a side | | | {cook_deflection('quadratic', 16):.2f} mm | |"
    mixed = ", ".join(f"{cook_reference(cells):.3f}" for cells in (8, 16, 24))
    yield f"| Cook's membrane, mixed elements in the plane, 8, 16, 24 cells a side | | | {mixed} mm | |"


def main(output: PageOption = None) -> None:
    """Bars and Cook's membrane by each kind of element, against theory."""
    fill_section(output, "bending", page_section())


if __name__ == "__main__":
    run_program(main, "taichisoft_benchmarks.studies.bending")
