"""Slender bars and Cook's membrane by each kind of element, and the references that they are compared with."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.integrate import solve_bvp
from scipy.optimize import brentq
from scipy.sparse import coo_matrix, diags_array
from scipy.sparse.linalg import eigsh, spsolve

from taichisoft.mesh import VolumeMesh
from taichisoft_benchmarks.measures import system_matrix
from taichisoft_benchmarks.one_body import WEAK, at_rest, simulation_of, traction
from taichisoft_benchmarks.regular_meshes import bar

if TYPE_CHECKING:
    pass

LENGTH, HEIGHT = 100.0, 4.0
"""Of the bar [mm]; it is square, and clamped at one end."""
YOUNG_MODULUS, DENSITY = 500.0, 1e-6
STIFFNESS = YOUNG_MODULUS * HEIGHT**4 / 12
"""EI [mN mm^2]; Poisson's ratio is 0, so that sections keep their shape as in the theory of beams."""
CELLS = {"linear": (50, 2, 2), "smoothed": (50, 2, 2), "quadratic": (25, 1, 1), "hexahedral": (50, 2, 2)}
"""Of the bar's meshes: quadratic elements have as many nodes as the others."""

COOK_MODULUS, COOK_POISSON, COOK_LOAD = 240.565, 0.4999, 100.0
"""kPa, and mN for each mm of thickness (de Souza Neto et al. 1996, Design of simple low order finite elements)."""


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
    solution = solve_bvp(slopes, ends, s, np.vstack([s, 1 - s, s**2 / 2]), tol=1e-8)
    return float(solution.y[2, -1])


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


GRADE = 3.0
"""Power by which the cells grow with their distance from the nearer sides."""
LOAD_STEPS = 5
MOST_ITERATIONS = 30
STILL = 1e-9
"""Largest change of a displacement in a step of Newton's method at which it has converged [mm]."""
CROSS = np.array([[0.0, 1.0], [-1.0, 0.0]])
"""epsilon of two indices: the cofactor of F is epsilon F epsilon^T."""


def corner_rise(cells: int, shear_modulus: float, first_lame: float, load: float) -> float:
    """Rise of the upper corner of the free side of Cook's membrane in the plane, of mixed elements [mm].

    Quadrilaterals with biquadratic displacements and a discontinuous linear pressure (Q2-P1; Sussman and Bathe 1987,
    Computers & Structures 26), neo-Hookean in plane strain: the stationary point of the integral of

        mu/2 (I1 - 3 - 2 (J - 1) + (J - 1)^2) + p (J - 1) - p^2 / (2 lambda)

    over displacements and pressures, less the work of the load, by Newton's method. The cells become small towards the
    corners: at the clamped ones the stress is singular, and at the free ones the load ends where its shear cannot.

    Args:
        cells: along each side.
        shear_modulus, first_lame: mu and lambda [kPa].
        load: upwards on the free side, for each mm of thickness [mN/mm].
    """
    nodes, elements = _mesh(cells)
    values, slopes = _shapes(np.sqrt(0.6) * np.array([-1.0, 0.0, 1.0]))
    jacobian = np.einsum("qai,eaj->eqij", slopes, nodes[elements])
    weight = np.outer(*2 * [np.array([5.0, 8.0, 5.0]) / 9]).ravel() * np.linalg.det(jacobian)
    gradient = np.einsum("eqji,qai->eqaj", np.linalg.inv(jacobian), slopes)
    pressures = values @ _pressure_shapes()
    pull = _edge_load(cells, nodes, load)
    held = np.flatnonzero(nodes[:, 0] == 0.0)
    free = np.setdiff1d(np.arange(2 * len(nodes)), np.concatenate([2 * held, 2 * held + 1]))
    unknowns = (2 * elements[:, :, None] + np.arange(2)).reshape(len(elements), -1)
    motion, pressure = np.zeros(2 * len(nodes)), np.zeros((len(elements), 3))
    compliance = np.einsum("eq,qm,qn->emn", weight, pressures, pressures) / first_lame
    for share in np.arange(1, LOAD_STEPS + 1) / LOAD_STEPS:
        for _ in range(MOST_ITERATIONS):
            turn = np.eye(2) + np.einsum("eai,eqaj->eqij", motion.reshape(-1, 2)[elements], gradient)
            cofactor, growth = CROSS @ turn @ CROSS.T, np.linalg.det(turn) - 1.0
            along = (pressure @ pressures.T + shear_modulus * (growth - 1.0))[:, :, None, None]
            stress = shear_modulus * turn + along * cofactor
            force = np.einsum("eq,eqij,eqaj->eai", weight, stress, gradient).reshape(len(elements), -1)
            slope = np.einsum("eq,eqijkl,eqaj,eqbl->eaibk", weight, _tangent(shear_modulus, along, cofactor), gradient,
                              gradient, optimize=True).reshape(len(elements), 18, 18)  # fmt: skip
            coupling = np.einsum("eq,eqij,eqaj,qm->eaim", weight, cofactor, gradient, pressures, optimize=True)
            coupling = coupling.reshape(len(elements), 18, 3)
            left = np.einsum("eq,qm,eq->em", weight, pressures, growth) - np.einsum("emn,en->em", compliance, pressure)
            # The pressures of an element belong to it alone: they are eliminated before the system is put together.
            by_pressure = np.linalg.solve(compliance, np.concatenate([coupling.swapaxes(1, 2), left[:, :, None]], 2))
            slope += coupling @ by_pressure[:, :, :18]
            force += np.einsum("eam,em->ea", coupling, by_pressure[:, :, 18])
            matrix = coo_matrix(
                (slope.ravel(), (np.repeat(unknowns, 18, axis=1).ravel(), np.tile(unknowns, (1, 18)).ravel()))
            ).tocsc()
            unbalanced = share * pull - np.bincount(unknowns.ravel(), force.ravel())
            change = np.zeros_like(motion)
            change[free] = spsolve(matrix[free][:, free], unbalanced[free])
            motion += change
            pressure += by_pressure[:, :, 18] + np.einsum("ema,ea->em", by_pressure[:, :, :18], change[unknowns])
            if np.abs(change).max() < STILL:
                break
        else:
            raise AssertionError(f"Cook's membrane: Newton's method did not converge in {MOST_ITERATIONS} steps")
    return float(motion[-1])


def _mesh(cells: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (N, 2) [mm], row by row from the clamped side on, and the nine of each cell, in the order of `_shapes`."""
    line = np.arange(2 * cells + 1) / (2 * cells)
    near = 0.5 * (2.0 * np.minimum(line, 1.0 - line)) ** GRADE
    line = np.where(line < 0.5, near, 1.0 - near)
    across, up = (part.ravel() for part in np.meshgrid(line, line, indexing="ij"))
    # Middle nodes are put into the middles: cells with straight, evenly divided sides.
    grid = np.stack([across, up], axis=1).reshape(2 * cells + 1, 2 * cells + 1, 2)
    grid[1::2] = (grid[:-1:2] + grid[2::2]) / 2
    grid[:, 1::2] = (grid[:, :-1:2] + grid[:, 2::2]) / 2
    across, up = grid.reshape(-1, 2).T
    nodes = np.column_stack([48.0 * across, 44.0 * across + (44.0 - 28.0 * across) * up])
    first = (2 * np.arange(cells)[:, None] * (2 * cells + 1) + 2 * np.arange(cells)).ravel()
    return nodes, first[:, None] + np.add.outer(np.arange(3) * (2 * cells + 1), np.arange(3)).ravel()


def _shapes(places: Sequence[float] | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values (Q, 9) and slopes (Q, 9, 2) of the biquadratic functions at all pairs of places between -1 and 1."""
    x = np.asarray(places)
    value = np.stack([x * (x - 1) / 2, 1 - x**2, x * (x + 1) / 2], axis=1)
    slope = np.stack([x - 0.5, -2 * x, x + 0.5], axis=1)
    count = len(x) ** 2
    values = np.einsum("ia,jb->ijab", value, value).reshape(count, 9)
    slopes = [np.einsum("ia,jb->ijab", *pair).reshape(count, 9) for pair in ((slope, value), (value, slope))]
    return values, np.stack(slopes, axis=2)


def _pressure_shapes() -> np.ndarray:
    """The functions 1, x and y of a cell at its nine nodes, shape (9, 3)."""
    x, y = np.meshgrid([-1.0, 0.0, 1.0], [-1.0, 0.0, 1.0], indexing="ij")
    return np.stack([np.ones(9), x.ravel(), y.ravel()], axis=1)


def _tangent(shear_modulus: float, along: np.ndarray, cofactor: np.ndarray) -> np.ndarray:
    """Slope of the stress, dP_ij / dF_kl, at the given pressures, shape (E, Q, 2, 2, 2, 2)."""
    same = np.einsum("ik,jl->ijkl", np.eye(2), np.eye(2))
    turned = np.einsum("ik,jl->ijkl", CROSS, CROSS)
    spread = np.einsum("eqij,eqkl->eqijkl", cofactor, cofactor)
    return shear_modulus * (same + spread) + along[..., None, None] * turned


def _edge_load(cells: int, nodes: np.ndarray, load: float) -> np.ndarray:
    """Forces of an even shear of the free side [mN/mm], shape (2 N,): Simpson's rule on each side of a cell."""
    forces = np.zeros_like(nodes)
    edge = np.arange(len(nodes) - (2 * cells + 1), len(nodes))
    heights = nodes[edge[2::2], 1] - nodes[edge[:-1:2], 1]
    share = load * heights / heights.sum() / 6
    for offset, part in enumerate((1.0, 4.0, 1.0)):
        np.add.at(forces[:, 1], edge[offset : offset + 2 * cells - 1 : 2], part * share)
    return forces.ravel()
