"""The product of multipliers and elastic forces, and its derivatives, for the adjoint of a step.

The force on a node is -w P g, and so the product with -m of the multipliers m is w P : L with L = sum m_a g_a^T.

Under Hooke's law P = R sigma(R^T F' - 1), with the deformation F' at positions ahead by the lag and the rotation R of F
at the start of the step, and the product is

    w sigma(S) : T,   S = R^T F' - 1,   T = R^T L.

It changes by w R sigma(T) with F', and with a turn w of R, in its own axes, by t . w, where [t] is the odd part of
R^T (F' sigma(T) + L sigma(S)). A change of F turns R by (tr(U) - U) w = axial(R^T dF), with F = R U.

Under a law of rubber, with s ahead along the velocities before the step in F1 = R1 U1, and stiffness K of the stretches
U of F with b / s of its damping, it is

    T : (dW/dU + K (S - U)),   S = R1^T F'',   T = R1^T L,

where F'' is s ahead along the velocities after it. By U, of which K is a function, it is derived by differences.
"""

from typing import NamedTuple

from taichisoft.mechanics.kernels.domain_deformation import (
    DILATION,
    EQUAL_STRETCHES,
    HOOKE,
    LAMBDA,
    MU,
    SHAPE,
    Domains,
    Movement,
    deformation_and_rate,
    diagonal,
)
from taichisoft.mechanics.kernels.hooke_domains import EDGES, POLAR, edge_frame, polar_rotation, stress
from taichisoft.mechanics.kernels.rubber_domains import stiffness_by_stretches, tangent_of_pairs
from taichisoft.runtime.arithmetic import symmetric_eigen
from taichisoft.runtime.language import Integers, Matrices, Scalars, Vectors, func, mat3, ti, vec3
from taichisoft.runtime.launch import kernel

STRETCHED = 1e-6
"""Half width of differences by stretches [-]: their error and round-off are both some 1e-10."""


class PieceSlopes(NamedTuple):
    """The product of each piece, and its derivatives.

    Attributes:
        product: shape (piece_count,).
        by_lag: by its lag, shape (piece_count,).
        by_position: by the start of each entry's node, shape (entry_count, 3).
        by_known: by its velocity before the step, with that after it as it is, likewise.
        by_velocity: by its velocity after the step, likewise.
    """

    product: Scalars
    by_lag: Scalars
    by_position: Vectors
    by_known: Vectors
    by_velocity: Vectors


@func
def axial(matrix: mat3) -> vec3:
    """The vector t with t . w = A : [w]."""
    return vec3(matrix[2, 1] - matrix[1, 2], matrix[0, 2] - matrix[2, 0], matrix[1, 0] - matrix[0, 1])


@func
def of_turn(stretch: mat3, torque: vec3) -> mat3:
    """What a torque on the rotation R of R U is by a change of R^T (R U)."""
    p = (stretch.trace() * ti.Matrix.identity(ti.f64, 3) - stretch).inverse() @ torque
    return ti.Matrix([[0.0, -p[2], p[1]], [p[2], 0.0, -p[0]], [-p[1], p[0], 0.0]])


# Laws of rubber, along the axes of the stretches.


@func
def times(along: mat3, same: mat3, swapped: vec3, strain: mat3) -> mat3:
    """K times a strain, with K of ii,jj in a matrix, of ik,ik in another, of ik,ki at the number of the third axis."""
    result = diagonal(along @ vec3(strain[0, 0], strain[1, 1], strain[2, 2]))
    for j in ti.static(range(3)):
        i, k = ti.static((j + 1) % 3), ti.static((j + 2) % 3)
        result[i, k] = same[i, k] * strain[i, k] + swapped[j] * strain[k, i]
        result[k, i] = same[k, i] * strain[k, i] + swapped[j] * strain[i, k]
    return result


@func
def beside(s: vec3, entry: ti.i32, width: ti.f64):
    """Stretches and axes of a diagonal U that is larger by a width in an entry, and in the one across the diagonal."""
    stretches, axes = s, ti.Matrix.identity(ti.f64, 3)
    for i, j in ti.static(ti.ndrange(3, 3)):
        if entry == ti.static(3 * i + j):
            if ti.static(i == j):
                stretches[i] += width
            else:
                mean, half = 0.5 * (s[i] + s[j]), 0.5 * (s[i] - s[j])
                root, angle = ti.sqrt(half * half + width * width), 0.5 * ti.atan2(width, half)
                cosine, sine = ti.cos(angle), ti.sin(angle)
                stretches[i], stretches[j] = mean + root, mean - root
                axes[i, i], axes[i, j], axes[j, i], axes[j, j] = cosine, -sine, sine, cosine
    return stretches, axes


@func
def rubber_piece(
    d: ti.i32,
    f: mat3,
    rate: mat3,
    change: mat3,
    multiplied: mat3,
    elastic: ti.f64,
    only_product: ti.i32,
    domains: Domains,
    slopes: PieceSlopes,
):
    """The product, and its derivatives by F, by its rate before the step and by that after it."""
    stage, one = domains.undamped[d] * domains.lag[d], ti.Matrix.identity(ti.f64, 3)
    viscous = (1.0 - domains.undamped[d]) / domains.undamped[d]
    ahead = f + stage * rate
    start, turned = polar_rotation(f), polar_rotation(ahead)
    back, stretch = turned.transpose(), start.transpose() @ f
    s, axes = symmetric_eigen(0.5 * (stretch + stretch.transpose()))
    along, strained = back @ multiplied, back @ (ahead + stage * change)
    own, own_strained = axes.transpose() @ along @ axes, axes.transpose() @ strained @ axes
    by_stretch, pull, answer = 0.0 * one, 0.0 * one, 0.0 * one
    for number in range(12 * only_product, 13):
        # Beside U: entries on and above the diagonal, each with more and with less; then U itself.
        entry = number // 2 + ti.select(number < 6, 0, ti.select(number < 10, 1, 3))
        apart = ti.select(entry == 1, s[0] - s[1], ti.select(entry == 2, s[0] - s[2], s[1] - s[2]))
        if ti.abs(apart) > EQUAL_STRETCHES and (entry == 1 or entry == 2 or entry == 5):
            continue  # a turn of the axes
        width = ti.select(number % 2 == 0, STRETCHED, -STRETCHED)
        stretches, turn = beside(s, entry, width)
        slope, hessian, viscous_hessian, flip, twist, share = stiffness_by_stretches(d, stretches, domains)
        same, swapped = tangent_of_pairs(stretches, flip, twist, share, elastic, viscous)
        stiffness = elastic * hessian + viscous * viscous_hessian
        strain, weight = turn.transpose() @ own_strained @ turn - diagonal(stretches), turn.transpose() @ own @ turn
        pull = elastic * diagonal(slope) + times(stiffness, same, swapped, strain)
        product = (weight * pull).sum()
        for i, j in ti.static(ti.ndrange(3, 3)):
            if entry == ti.static(3 * i + j):
                by_stretch[i, j] += 0.5 * product / width
        if entry == 9:
            slopes.product[d] = product
            answer = times(stiffness, same, swapped, weight)
            same, swapped = tangent_of_pairs(stretches, flip, twist, share, 0.0, 1.0)
            slopes.by_lag[d] = (weight * times(viscous_hessian, same, swapped, strain)).sum() / stage
    turning = own.transpose() @ pull - pull @ own.transpose()
    turning += own_strained.transpose() @ answer - answer @ own_strained.transpose()
    for i, j in ti.static([(0, 1), (0, 2), (1, 2)]):
        if ti.abs(s[i] - s[j]) > EQUAL_STRETCHES:
            by_stretch[i, j] = (turning[i, j] - turning[j, i]) / (s[j] - s[i])
    answer = axes @ answer @ axes.transpose()
    by_stretch = axes @ (0.5 * (by_stretch + by_stretch.transpose())) @ axes.transpose()
    pull = axes @ pull @ axes.transpose()
    torque = axial(strained @ answer.transpose() + along @ pull.transpose())
    by_turn = turned @ of_turn(back @ ahead, torque)
    by_place = turned @ answer + by_turn + start @ (by_stretch + of_turn(stretch, axial(stretch @ by_stretch)))
    return by_place, stage * by_turn, stage * turned @ answer


@kernel
def elastic_slopes(
    pieces: Domains,
    corotation: Integers,
    rest_frame: Matrices,
    movement: Movement,
    change: Movement,
    elastic: ti.f64,
    only_product: ti.i32,
    slopes: PieceSlopes,
):
    """Fill in the slopes.

    Args:
        pieces: with one deformation each, linear tetrahedra first.
        corotation: EDGES, POLAR or NONE, under Hooke's law, shape (piece_count,).
        rest_frame: frame of these edges at rest, shape (piece_count, 3, 3).
        movement: of the nodes before the step.
        change: of velocities in the step, in the place of positions, and the multipliers.
        elastic: 1; or 0 of damping alone.
        only_product: 1 where other slopes may be wrong; or 0.
        slopes: of each piece and entry.
    """
    for e in range(pieces.lag.shape[0]):
        first, one = pieces.start[e], ti.Matrix.identity(ti.f64, 3)
        f, known = deformation_and_rate(e, pieces, movement)
        more, along = deformation_and_rate(e, pieces, change)
        r, frame, torque = one, one, vec3(0.0)
        to_first, to_second = vec3(0.0), vec3(0.0)
        by_place, by_known, by_velocity = 0.0 * one, 0.0 * one, 0.0 * one
        if pieces.law[e] != HOOKE:
            by_place, by_known, by_velocity = rubber_piece(
                e, f, known, more, along, elastic, only_product, pieces, slopes
            )
        else:
            if corotation[e] == POLAR:
                r = polar_rotation(f)
            elif corotation[e] == EDGES:
                to_first = movement.position[pieces.node[first + 1]] - movement.position[pieces.node[first]]
                to_second = movement.position[pieces.node[first + 2]] - movement.position[pieces.node[first]]
                frame = edge_frame(to_first, to_second)
                r = frame @ rest_frame[e].transpose()
            lag, back = pieces.lag[e] * (1.0 - (1.0 - elastic) * pieces.undamped[e]), r.transpose()
            lagged, turned = elastic * f + lag * (known + more), back @ along
            weighted_lambda = pieces.volume[e, DILATION] * pieces.modulus[e, LAMBDA]
            weighted_mu = pieces.volume[e, SHAPE] * pieces.modulus[e, MU]
            pull = stress(back @ lagged - elastic * one, weighted_lambda, weighted_mu)
            answer = stress(turned, weighted_lambda, weighted_mu)
            torque = axial(back @ (lagged @ answer + along @ pull))
            slopes.product[e] = (pull * turned).sum()
            by_place = r @ answer
            slopes.by_lag[e], by_velocity = (by_place * (known + more)).sum(), lag * by_place
            by_place = elastic * by_place
            if corotation[e] == POLAR:
                by_place += r @ of_turn(back @ f, torque)
        for c in range(first, pieces.start[e + 1]):
            g = pieces.gradient[c]
            slopes.by_position[c] = by_place @ g
            slopes.by_known[c], slopes.by_velocity[c] = by_known @ g, by_velocity @ g
        if corotation[e] == EDGES:
            # The frame turns with its first edge, and about that with the second.
            own = rest_frame[e].transpose() @ torque
            along_first, along_second = frame.transpose() @ to_first, frame.transpose() @ to_second
            length, beside, height = along_first[0], along_second[0], along_second[1]
            by_first = frame @ vec3(0.0, own[2] / length, -(own[1] + own[0] * beside / height) / length)
            by_second = frame @ vec3(0.0, 0.0, own[0] / height)
            slopes.by_position[first + 1] = slopes.by_position[first + 1] + by_first
            slopes.by_position[first + 2] = slopes.by_position[first + 2] + by_second
            slopes.by_position[first] = slopes.by_position[first] - by_first - by_second
