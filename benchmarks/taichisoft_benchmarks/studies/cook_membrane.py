"""Cook's membrane in the plane, of mixed elements, which do not lock: the reference for the engine's.

Quadrilaterals with biquadratic displacements and a discontinuous linear pressure (Q2-P1; Sussman and Bathe 1987,
Computers & Structures 26), neo-Hookean in plane strain: the stationary point of the integral of

    mu/2 (I1 - 3 - 2 (J - 1) + (J - 1)^2) + p (J - 1) - p^2 / (2 lambda)

over displacements and pressures, less the work of the load, by Newton's method. The cells become small towards the
corners: at the clamped ones the stress is singular, and at the free ones the load ends where its shear cannot.
"""

from collections.abc import Sequence

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import spsolve

from taichisoft.errors import TaichisoftError

GRADE = 3.0
"""Power by which the cells grow with their distance from the nearer sides."""
LOAD_STEPS = 5
MOST_ITERATIONS = 30
STILL = 1e-9
"""Largest change of a displacement in a step of Newton's method at which it has converged [mm]."""
CROSS = np.array([[0.0, 1.0], [-1.0, 0.0]])
"""epsilon of two indices: the cofactor of F is epsilon F epsilon^T."""


def corner_rise(cells: int, shear_modulus: float, first_lame: float, load: float) -> float:
    """Rise of the upper corner of the free side [mm].

    Args:
        cells: along each side.
        shear_modulus, first_lame: mu and lambda [kPa].
        load: upwards on the free side, for each mm of thickness [mN/mm].

    Raises:
        TaichisoftError: Newton's method does not converge.
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
            raise TaichisoftError(f"Cook's membrane: Newton's method did not converge in {MOST_ITERATIONS} steps")
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
