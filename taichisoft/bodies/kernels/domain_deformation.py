"""Integration domains: what kernels read of them, and their deformation.

A domain is a piece of a body with one deformation gradient, F = sum_a x_a g_a^T over its nodes: a quadrature point of
an element, or what surrounds an edge or a node of the mesh (`bodies/domains.py`). It has any number of nodes. With P
the first Piola stress and C = dP/dF of an energy (`laws.py`), and w its volume,
    f_a = -w P g_a,   (K_ab)_ij = w sum_kl C_ik,jl (g_a)_k (g_b)_l,
where C has no negative eigenvalues left. Hooke's law, corotated with the polar rotation, which is frozen in C, has a
short way to the sums (`hooke_domains.py`); other laws take the general one (`rubber_domains.py`).
"""

from typing import NamedTuple

from taichisoft.runtime.launch import func
from taichisoft.runtime.taichi_start import Integers, Matrices, Scalars, ScalarTable, Vectors, ti

# Columns of `volume`.
SHAPE, DILATION = range(2)


class Domains(NamedTuple):
    """Integration domains of all soft bodies that have them; an entry is a node of a domain.

    Attributes:
        start: where each domain's entries begin, shape (domain_count + 1,).
        node: of each entry, shape (entry_count,).
        gradient: g of each entry, at rest [1/mm], shape (entry_count, 3).
        volume: for which the energies of shape and of volume count [mm^3], shape (domain_count, 2).
        law: HOOKE, POLYNOMIAL or OGDEN, shape (domain_count,).
        modulus: of the law, see `laws.py` [kPa], shape (domain_count, 5).
        exponent: Ogden's [-], shape (domain_count, 3).
        lag: h + b [s], 0 in first order dynamics, shape (domain_count,).
        factor: of K in A, shape (domain_count,).
        undamped: h / (h + b), the share of the lag and of the factor that is not damping's, shape (domain_count,).
    """

    start: Integers
    node: Integers
    gradient: Vectors
    volume: ScalarTable
    law: Integers
    modulus: ScalarTable
    exponent: ScalarTable
    lag: Scalars
    factor: Scalars
    undamped: Scalars


class Movement(NamedTuple):
    """Where the nodes are.

    Attributes:
        position: of the nodes [mm], shape (node_count, 3).
        velocity: of the nodes [mm/s], shape (node_count, 3).
    """

    position: Vectors
    velocity: Vectors


class DomainSums(NamedTuple):
    """What the domains add to.

    Attributes:
        force: f - (h + b) K v on each node [mN], shape (node_count, 3).
        blocks: of A, shape (block_count, 3, 3).
        progress: counters of `waiting`, 0 at the start.
    """

    force: Vectors
    blocks: Matrices
    progress: Integers


@func
def deformation_and_rate(d: ti.i32, domains: Domains, movement: Movement):
    """Deformation gradient of a domain [-], and how fast it changes [1/s]."""
    first = domains.start[d]
    x0, v0 = movement.position[domains.node[first]], movement.velocity[domains.node[first]]
    deformation, rate = ti.Matrix.zero(ti.f64, 3, 3), ti.Matrix.zero(ti.f64, 3, 3)
    for c in range(first + 1, domains.start[d + 1]):
        g = domains.gradient[c]
        deformation += (movement.position[domains.node[c]] - x0).outer_product(g)
        rate += (movement.velocity[domains.node[c]] - v0).outer_product(g)
    return deformation, rate
