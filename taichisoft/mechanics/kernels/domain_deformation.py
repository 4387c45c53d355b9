"""Integration domains: the arrays that kernels read, and their deformation.

A domain is a piece of a body with one deformation gradient, F = sum_a x_a g_a^T over its nodes: a quadrature point of
an element, or what surrounds an edge or a node of the mesh (`mechanics/element_kinds.py`). It has any number of nodes.
With P the first Piola stress and C = dP/dF of an energy (`rubber_laws.py`), and w its volume,
    f_a = -w P g_a,   (K_ab)_ij = w sum_kl C_ik,jl (g_a)_k (g_b)_l,
where C has no negative eigenvalues left. Hooke's law, corotated with the polar rotation, which is frozen in C, has a
shorter form of the sums (`hooke_domains.py`); `rubber_domains.py` has the general form for other laws.
"""

from collections.abc import Callable
from types import FunctionType
from typing import Any, NamedTuple

from taichisoft.runtime.language import Integers, Matrices, Scalars, ScalarTable, Vectors, func, mat3, ti, vec3
from taichisoft.runtime.rubber_laws import RUBBER_LAWS, SMALLEST_STRETCH, InvariantLaw, RubberLaw, StretchLaw

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
        modulus: in the columns below [kPa], shape (domain_count, MODULI).
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


# Laws of rubber in the principal stretches: slopes of their energies, and what their tangents need.
#
# `taichisoft/runtime/rubber_laws.py` has the energies; the energies of shape and of volume have weights of their own.
# The second derivatives by F = U diag(s) V^T have, in the axes of U and V, the Hessian by the stretches, and for each
# pair of axes i, j with the third one k two eigenvalues (Smith,
# de Goes and Kim 2019, Analytic Eigensystems for Isotropic
# Distortion Energies): of the symmetric part ("flip") and of the antisymmetric part ("twist"),
#     flip_k = (psi_i - psi_j) / (s_i - s_j),   twist_k = (psi_i + psi_j) / (s_i + s_j).

# Laws of invariants come before laws of stretches.
_BY_FORM = sorted(RUBBER_LAWS, key=lambda name: isinstance(RUBBER_LAWS[name], StretchLaw))
LAW_NUMBERS = {name: number for number, name in enumerate(["hooke", *_BY_FORM])}
HOOKE = LAW_NUMBERS["hooke"]
FIRST_STRETCH_LAW = 1 + sum(isinstance(law, InvariantLaw) for law in RUBBER_LAWS.values())
# Columns of a material's moduli [kPa]: Lame's lambda, then mu of Hooke's law or the moduli of each term.
LAMBDA, MU = 0, 1


def term_columns(law: RubberLaw, term: int) -> tuple[list[int], list[int]]:
    """Columns of the coefficients of a term: of the moduli [kPa] and of the pure numbers."""
    moduli = sum(one.unit == "kPa" for one in law.coefficients)
    pure_numbers = len(law.coefficients) - moduli
    return (
        [1 + term * moduli + i for i in range(moduli)],
        [term * pure_numbers + i for i in range(pure_numbers)],
    )


_LAST_TERMS = [term_columns(law, law.terms - 1) for law in RUBBER_LAWS.values()]
MODULI = 1 + max(column for moduli, _ in _LAST_TERMS for column in moduli)
PURE_NUMBERS = 1 + max(column for _, numbers in _LAST_TERMS for column in numbers)

# Closer together than this, two stretches count as equal in a difference quotient of slopes.
EQUAL_STRETCHES = 1e-4


def for_kernels(function: Callable[..., Any]) -> Any:
    """A function of numpy's arithmetic as one of Taichi's: np.exp is ti.exp in it, and so on."""
    return func(FunctionType(function.__code__, function.__globals__ | {"np": ti}, function.__name__))


# Number of the law, derivatives, and columns of each term of each law.
INVARIANT_TERMS, STRETCH_TERMS = (
    [
        (LAW_NUMBERS[name], derivatives, *term_columns(law, term))
        for name, law in RUBBER_LAWS.items()
        if isinstance(law, form)
        for derivatives in [for_kernels(law.derivatives)]
        for term in range(law.terms)
    ]
    for form in (InvariantLaw, StretchLaw)
)


@func
def products_of_others(s: vec3) -> vec3:
    """The derivatives of J = s1 s2 s3."""
    return vec3(s[1] * s[2], s[2] * s[0], s[0] * s[1])


@func
def off_diagonal(v: vec3) -> mat3:
    """The symmetric matrix whose entry of two axes is that of the third."""
    return ti.Matrix([[0.0, v[2], v[1]], [v[2], 0.0, v[0]], [v[1], v[0], 0.0]])


@func
def diagonal(v: vec3) -> mat3:
    """The diagonal matrix of v."""
    return ti.Matrix([[v[0], 0.0, 0.0], [0.0, v[1], 0.0], [0.0, 0.0, v[2]]])


@func
def respond_by_invariants(d: ti.i32, domains: Domains, s: vec3):
    """Slope and Hessian by the stretches of a domain's energy times its volumes, flips and twists."""
    shape, volume = domains.volume[d, SHAPE], domains.volume[d, DILATION]
    cofactor = products_of_others(s)
    j = s[0] * cofactor[0]
    squares = s * s
    i1 = squares.sum()
    k = i1 - 3.0 - 2.0 * (j - 1.0) + (j - 1.0) * (j - 1.0)
    first, second, bend = 0.0, 0.0, 0.0
    for number, derivatives, moduli, pure_numbers in ti.static(INVARIANT_TERMS):
        if domains.law[d] == number:
            by_k, by_l, by_k_twice = derivatives(
                k,
                *[domains.modulus[d, column] for column in ti.static(moduli)],
                *[domains.pure_number[d, column] for column in ti.static(pure_numbers)],
            )
            first += shape * by_k
            second += shape * by_l
            bend += shape * by_k_twice
    pressure = 2.0 * first * (j - 2.0) - 4.0 * second + volume * domains.modulus[d, LAMBDA] * (j - 1.0)
    stiffness = 2.0 * first + volume * domains.modulus[d, LAMBDA]
    slope_of_k = 2.0 * s + 2.0 * (j - 2.0) * cofactor
    slope = 2.0 * first * s + 2.0 * second * s * (i1 - squares) + pressure * cofactor
    hessian = (
        diagonal(2.0 * first + 2.0 * second * (i1 - squares))
        + off_diagonal(4.0 * second * cofactor + pressure * s)
        + stiffness * cofactor.outer_product(cofactor)
        + bend * slope_of_k.outer_product(slope_of_k)
    )
    flip = 2.0 * first + 2.0 * second * (squares - cofactor) - pressure * s
    twist = 2.0 * first + 2.0 * second * (squares + cofactor) + pressure * s
    return slope, hessian, flip, twist


@func
def respond_by_sums(d: ti.i32, domains: Domains, s: vec3):
    """Slope and Hessian by the stretches of a domain's energy times its volumes, flips and twists."""
    shape, volume = domains.volume[d, SHAPE], domains.volume[d, DILATION]
    cofactor = products_of_others(s)
    j = s[0] * cofactor[0]
    slope, bend = vec3(0.0), vec3(0.0)
    at_rest = 0.0
    for number, derivatives, moduli, pure_numbers in ti.static(STRETCH_TERMS):
        if domains.law[d] == number:
            own_moduli = ti.static([shape * domains.modulus[d, column] for column in moduli])
            own_numbers = ti.static([domains.pure_number[d, column] for column in pure_numbers])
            at_rest += derivatives(1.0, *own_moduli, *own_numbers)[0]
            for i in ti.static(range(3)):
                base = ti.max(s[i], SMALLEST_STRETCH)
                own_slope, own_bend = derivatives(base, *own_moduli, *own_numbers)
                bend[i] += own_bend
                slope[i] += own_slope + own_bend * (s[i] - base)
    flip, twist = vec3(0.0), vec3(0.0)
    for k in ti.static(range(3)):
        a, b = ti.static((k + 1) % 3), ti.static((k + 2) % 3)
        flip[k] = 0.5 * (bend[a] + bend[b])
        if ti.abs(s[a] - s[b]) > EQUAL_STRETCHES:
            flip[k] = (slope[a] - slope[b]) / (s[a] - s[b])
        if s[a] + s[b] > EQUAL_STRETCHES:  # where two stretches cancel, the twist has no limit
            twist[k] = (slope[a] + slope[b]) / (s[a] + s[b])
    pressure = at_rest * (j - 2.0) + volume * domains.modulus[d, LAMBDA] * (j - 1.0)
    stiffness = at_rest + volume * domains.modulus[d, LAMBDA]
    slope += pressure * cofactor
    hessian = diagonal(bend) + off_diagonal(pressure * s) + stiffness * cofactor.outer_product(cofactor)
    return slope, hessian, flip - pressure * s, twist + pressure * s
