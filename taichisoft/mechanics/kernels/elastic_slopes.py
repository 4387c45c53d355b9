"""The product of multipliers and elastic forces under Hooke's law, and its derivatives, for the adjoint of a step.

With the forces f_a = -w R sigma(R^T F' - 1) g_a, the deformation F' at positions ahead by the lag and the rotation R of
F at the start of the step, and L = sum m_a g_a^T of the multipliers m, it is

    -sum_a m_a . f_a = w sigma(S) : T,   S = R^T F' - 1,   T = R^T L.

It changes by w R sigma(T) with F', and with a turn w of R, in its own axes, by t . w, where [t] is the odd part of
R^T (F' sigma(T) + L sigma(S)). A change of F turns R by (tr(U) - U) w = axial(R^T dF), with F = R U.
"""

from typing import NamedTuple

from taichisoft.mechanics.kernels.hooke_domains import EDGES, POLAR, edge_frame, polar_rotation, stress
from taichisoft.runtime.language import Integers, Matrices, Scalars, ScalarTable, Vectors, func, mat3, ti, vec3
from taichisoft.runtime.launch import kernel


class ElasticPieces(NamedTuple):
    """Pieces with one deformation each, linear tetrahedra first; an entry is a node of a piece.

    Attributes:
        start: the first entry of each piece, shape (piece_count + 1,).
        node: of each entry, shape (entry_count,).
        gradient: g of each entry, at rest [1/mm], shape (entry_count, 3).
        corotation: EDGES, POLAR or NONE, shape (piece_count,).
        rest_frame: frame of these edges at rest, shape (piece_count, 3, 3).
        modulus: w lambda and w mu [mN mm], shape (piece_count, 2).
        lag: s + b [s], shape (piece_count,).
    """

    start: Integers
    node: Integers
    gradient: Vectors
    corotation: Integers
    rest_frame: Matrices
    modulus: ScalarTable
    lag: Scalars


class PieceSlopes(NamedTuple):
    """The product of each piece, and its derivatives.

    Attributes:
        product: shape (piece_count,).
        by_lag: by its lag, shape (piece_count,).
        by_position: by the start of each entry's node, shape (entry_count, 3).
    """

    product: Scalars
    by_lag: Scalars
    by_position: Vectors


@func
def axial(matrix: mat3) -> vec3:
    """The vector t with t . w = A : [w]."""
    return vec3(matrix[2, 1] - matrix[1, 2], matrix[0, 2] - matrix[2, 0], matrix[1, 0] - matrix[0, 1])


@kernel
def elastic_slopes(
    pieces: ElasticPieces, position: Vectors, velocity: Vectors, multiplier: Vectors, slopes: PieceSlopes
):
    """Fill in the slopes, with nodes at the start of the step and their velocities after it."""
    for e in range(pieces.lag.shape[0]):
        first, last = pieces.start[e], pieces.start[e + 1]
        n0 = pieces.node[first]
        f, rate, along = ti.Matrix.zero(ti.f64, 3, 3), ti.Matrix.zero(ti.f64, 3, 3), ti.Matrix.zero(ti.f64, 3, 3)
        for c in range(first + 1, last):
            n, g = pieces.node[c], pieces.gradient[c]
            f += (position[n] - position[n0]).outer_product(g)
            rate += (velocity[n] - velocity[n0]).outer_product(g)
            along += (multiplier[n] - multiplier[n0]).outer_product(g)
        lagged, one = f + pieces.lag[e] * rate, ti.Matrix.identity(ti.f64, 3)
        frame = edge_frame(
            position[pieces.node[first + 1]] - position[n0], position[pieces.node[first + 2]] - position[n0]
        )
        r = one
        if pieces.corotation[e] == POLAR:
            r = polar_rotation(f)
        elif pieces.corotation[e] == EDGES:
            r = frame @ pieces.rest_frame[e].transpose()
        back, weighted_lambda, weighted_mu = r.transpose(), pieces.modulus[e, 0], pieces.modulus[e, 1]
        turned = back @ along
        pull = stress(back @ lagged - one, weighted_lambda, weighted_mu)
        answer = stress(turned, weighted_lambda, weighted_mu)
        torque = axial(back @ (lagged @ answer + along @ pull))
        by_place = r @ answer
        slopes.product[e] = (pull * turned).sum()
        slopes.by_lag[e] = (by_place * rate).sum()
        if pieces.corotation[e] == POLAR:
            stretch = back @ f
            p = (stretch.trace() * one - stretch).inverse() @ torque
            by_place += r @ ti.Matrix([[0.0, -p[2], p[1]], [p[2], 0.0, -p[0]], [-p[1], p[0], 0.0]])
        for c in range(first, last):
            slopes.by_position[c] = by_place @ pieces.gradient[c]
        if pieces.corotation[e] == EDGES:
            # The frame turns with its first edge, and about that with the second.
            own = pieces.rest_frame[e].transpose() @ torque
            along_first = frame.transpose() @ (position[pieces.node[first + 1]] - position[n0])
            along_second = frame.transpose() @ (position[pieces.node[first + 2]] - position[n0])
            length, beside, height = along_first[0], along_second[0], along_second[1]
            by_first = frame @ vec3(0.0, own[2] / length, -(own[1] + own[0] * beside / height) / length)
            by_second = frame @ vec3(0.0, 0.0, own[0] / height)
            slopes.by_position[first + 1] = slopes.by_position[first + 1] + by_first
            slopes.by_position[first + 2] = slopes.by_position[first + 2] + by_second
            slopes.by_position[first] = slopes.by_position[first] - by_first - by_second
