"""Isotropic hyperelastic laws as energies of the principal stretches: their slopes, and what their tangents need.

An energy is that of shape plus that of volume, U(J) = lambda / 2 (J - 1)^2, which have weights of their own. With
    K = I1 - 3 - 2 (J - 1) + (J - 1)^2,   L = I2 - 3 - 4 (J - 1),
which are I1 - 3 and I2 - 3 where the volume stays, and 2 e : e for small strains e, those of shape are
    polynomial  c10 K + c01 L + c20 K^2 + c30 K^3,
        c10 alone the stable neo-Hookean law of Smith, de Goes and Kim 2018 (Stable Neo-Hookean Flesh Simulation, whose
        lambda is lambda + mu here), with c01 Mooney and Rivlin's, with c20 and c30 Yeoh's;
    Ogden       sum_p mu_p / a_p (s1^a_p + s2^a_p + s3^a_p - 3) + mu_p ((J - 1)^2 / 2 - (J - 1)).
All agree with Hooke's law for small strains, and none has a barrier at J = 0, so that inverted elements can come back.

The second derivatives by F = U diag(s) V^T have, in the axes of U and V, the Hessian by the stretches, and for each
pair of axes i, j with the third one k two eigenvalues (Smith, de Goes and Kim 2019, Analytic Eigensystems for Isotropic
Distortion Energies): of the symmetric part ("flip") and of the antisymmetric part ("twist"),
    flip_k = (psi_i - psi_j) / (s_i - s_j),   twist_k = (psi_i + psi_j) / (s_i + s_j).
"""

from taichisoft.runtime.launch import func
from taichisoft.runtime.taichi_start import ScalarTable, mat3, ti, vec3

HOOKE, POLYNOMIAL, OGDEN = range(3)
# Columns of a material's moduli [kPa]: Lame's lambda, then mu of Hooke's law, or these.
LAMBDA, MU = 0, 1
C10, C01, C20, C30 = 1, 2, 3, 4
OGDEN_TERMS = 3
MODULI = 5

# Below this stretch a power of Ogden's law goes on as its parabola (Stomakhin et al. 2012, Energetically Consistent
# Invertible Elasticity): it has no value at negative stretches. A membrane is as thin at 4.5 times its size.
SMALLEST_STRETCH = 0.05
# Closer together than this, two stretches count as equal in a difference quotient of slopes.
EQUAL_STRETCHES = 1e-4


@ti.func
def products_of_others(s: vec3) -> vec3:
    """The derivatives of J = s1 s2 s3."""
    return vec3(s[1] * s[2], s[2] * s[0], s[0] * s[1])


@ti.func
def off_diagonal(v: vec3) -> mat3:
    """The symmetric matrix whose entry of two axes is that of the third."""
    return ti.Matrix([[0.0, v[2], v[1]], [v[2], 0.0, v[0]], [v[1], v[0], 0.0]])


@ti.func
def diagonal(v: vec3) -> mat3:
    """The diagonal matrix of these."""
    return ti.Matrix([[v[0], 0.0, 0.0], [0.0, v[1], 0.0], [0.0, 0.0, v[2]]])


@func
def polynomial_law(m: ti.i32, modulus: ScalarTable, shape: ti.f64, volume: ti.f64, s: vec3):
    """Slope and Hessian by the stretches, flips and twists, for weights of the energies of shape and volume."""
    cofactor = products_of_others(s)
    j = s[0] * cofactor[0]
    squares = s * s
    i1 = squares.sum()
    k = i1 - 3.0 - 2.0 * (j - 1.0) + (j - 1.0) * (j - 1.0)
    first = shape * (modulus[m, C10] + k * (2.0 * modulus[m, C20] + 3.0 * k * modulus[m, C30]))
    bend = shape * (2.0 * modulus[m, C20] + 6.0 * k * modulus[m, C30])
    second = shape * modulus[m, C01]
    pressure = 2.0 * first * (j - 2.0) - 4.0 * second + volume * modulus[m, LAMBDA] * (j - 1.0)
    stiffness = 2.0 * first + volume * modulus[m, LAMBDA]
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
def ogden_law(m: ti.i32, modulus: ScalarTable, exponent: ScalarTable, shape: ti.f64, volume: ti.f64, s: vec3):
    """Slope and Hessian by the stretches, flips and twists, for weights of the energies of shape and volume."""
    cofactor = products_of_others(s)
    j = s[0] * cofactor[0]
    slope, bend = vec3(0.0), vec3(0.0)
    total = 0.0
    for p in ti.static(range(OGDEN_TERMS)):
        mu, power = shape * modulus[m, MU + p], exponent[m, p] - 1.0
        total += mu
        for i in ti.static(range(3)):
            base = ti.max(s[i], SMALLEST_STRETCH)
            value = mu * ti.pow(base, power)
            bend[i] += power * value / base
            slope[i] += value + power * value / base * (s[i] - base)
    flip, twist = vec3(0.0), vec3(0.0)
    for k in ti.static(range(3)):
        a, b = ti.static((k + 1) % 3), ti.static((k + 2) % 3)
        flip[k] = 0.5 * (bend[a] + bend[b])
        if ti.abs(s[a] - s[b]) > EQUAL_STRETCHES:
            flip[k] = (slope[a] - slope[b]) / (s[a] - s[b])
        if s[a] + s[b] > EQUAL_STRETCHES:  # where two stretches cancel, the twist has no limit
            twist[k] = (slope[a] + slope[b]) / (s[a] + s[b])
    pressure = total * (j - 2.0) + volume * modulus[m, LAMBDA] * (j - 1.0)
    stiffness = total + volume * modulus[m, LAMBDA]
    slope += pressure * cofactor
    hessian = diagonal(bend) + off_diagonal(pressure * s) + stiffness * cofactor.outer_product(cofactor)
    return slope, hessian, flip - pressure * s, twist + pressure * s
