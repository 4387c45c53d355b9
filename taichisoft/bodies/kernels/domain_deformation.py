"""Integration domains: the arrays that kernels read, and their deformation.

A domain is a piece of a body with one deformation gradient, F = sum_a x_a g_a^T over its nodes: a quadrature point of
an element, or what surrounds an edge or a node of the mesh (`bodies/element_kinds.py`). It has any number of nodes.
With P the first Piola stress and C = dP/dF of an energy (`rubber_laws.py`), and w its volume,
    f_a = -w P g_a,   (K_ab)_ij = w sum_kl C_ik,jl (g_a)_k (g_b)_l,
where C has no negative eigenvalues left. Hooke's law, corotated with the polar rotation, which is frozen in C, has a
shorter form of the sums (`hooke_domains.py`); `rubber_domains.py` has the general form for other laws.
"""

from typing import NamedTuple

from taichisoft.runtime.language import Integers, Matrices, Scalars, ScalarTable, Vectors, func, ti

# Columns of `volume`.
SHAPE, DILATION = range(2)


class Domains(NamedTuple):
    """Integration domains of all soft bodies that have them; an entry is a node of a domain.

    Attributes:
        start: the first entry of each domain, shape (domain_count + 1,).
        node: of each entry, shape (entry_count,).
        gradient: g of each entry, at rest [1/mm], shape (entry_count, 3).
        volume: for which the energies of shape and of volume count [mm^3], shape (domain_count, 2).
        law: number in LAW_NUMBERS, shape (domain_count,).
        modulus: in the columns of `principal_stretches.py` [kPa], shape (domain_count, MODULI).
        pure_number: the law's coefficients without unit, shape (domain_count, PURE_NUMBERS).
        lag: s + b [s], 0 in overdamped dynamics, shape (domain_count,).
        factor: of K in A, shape (domain_count,).
        undamped: s / (s + b), the share of the lag and of the factor without damping, shape (domain_count,).
    """

    start: Integers
    node: Integers
    gradient: Vectors
    volume: ScalarTable
    law: Integers
    modulus: ScalarTable
    pure_number: ScalarTable
    lag: Scalars
    factor: Scalars
    undamped: Scalars


class Movement(NamedTuple):
    """Positions and velocities of the nodes.

    Attributes:
        position: of the nodes [mm], shape (node_count, 3).
        velocity: of the nodes [mm/s], shape (node_count, 3).
    """

    position: Vectors
    velocity: Vectors


class DomainSums(NamedTuple):
    """The sums to which the domains add.

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
