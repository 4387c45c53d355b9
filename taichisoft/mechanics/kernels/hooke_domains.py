"""Integration domains under Hooke's law: forces, and the system matrix by gathering."""

from typing import Any, NamedTuple

from taichisoft.mechanics.kernels.domain_deformation import (
    DILATION,
    LAMBDA,
    MU,
    SHAPE,
    Domains,
    DomainSums,
    Movement,
    deformation_and_rate,
)
from taichisoft.runtime.arithmetic import BEGUN, BEGUN_LATER, FINISHED, PATIENCE, reaches
from taichisoft.runtime.language import (
    CHUNK,
    Arrays,
    Integers,
    IntegerTable,
    Matrices,
    Scalars,
    ScalarTable,
    Vectors,
    VectorTable,
    func,
    mat3,
    ti,
    vec3,
)
from taichisoft.runtime.launch import kernel

# Blocks of the system matrix under corotated Hooke's law, gathered from what each domain stores for its nodes.
#
# With H_a = sqrt(w mu factor) R g_a for node a of a domain of volume w, and M = sum H_a H_b^T over the domains that
# contain both nodes of a block, the block is
#     sum (lambda / mu) H_a H_b^T + M^T + tr(M) I.
# Domains of one lambda / mu stand together, so that their products are summed before they are multiplied by it.

vec4 = ti.types.vector(4, ti.f64)
Quads: Any = Arrays(vec4, 1)


class HookeEntries(NamedTuple):
    """What a step computes for each entry, a node of a domain.

    Attributes:
        force: of the domain on the node [mN], shape (entry_count, 3).
        gradient: H, in rows that are vectors of the processor, shape (entry_count, 4); with lambda for mu where only
            the energy of volume counts.
    """

    force: Vectors
    gradient: Quads


class BlockParts(NamedTuple):
    """Which entries make up which blocks.

    Attributes:
        run_start: where each block's runs begin, shape (block_count + 1,); the domains of a run are alike.
        start: where each run's parts begin in the lists that follow, shape (run_count + 1,).
        lame_ratio: of each run lambda / mu, 0 without energy of volume, 1 with nothing else, shape (run_count,).
        shaped: 1 where energy of shape counts, else 0, shape (run_count,).
        row, column: entries of the block's two nodes in a domain.
        node: that of a block on the diagonal, -1 for others, shape (block_count,).
    """

    run_start: Integers
    start: Integers
    lame_ratio: Scalars
    shaped: Scalars
    row: Integers
    column: Integers
    node: Integers


@func
def gathered_stiffness(b: ti.i32, entries: HookeEntries, parts: BlockParts) -> mat3:
    """A block's stiffness."""
    # The columns of M, and of what is proportional to lambda.
    m0, m1, m2, l0, l1, l2 = vec4(0.0), vec4(0.0), vec4(0.0), vec4(0.0), vec4(0.0), vec4(0.0)
    for r in range(parts.run_start[b], parts.run_start[b + 1]):
        p0, p1, p2 = vec4(0.0), vec4(0.0), vec4(0.0)
        for c in range(parts.start[r], parts.start[r + 1]):
            row, column = entries.gradient[parts.row[c]], entries.gradient[parts.column[c]]
            p0 += column[0] * row
            p1 += column[1] * row
            p2 += column[2] * row
        m0 += parts.shaped[r] * p0
        m1 += parts.shaped[r] * p1
        m2 += parts.shaped[r] * p2
        l0 += parts.lame_ratio[r] * p0
        l1 += parts.lame_ratio[r] * p1
        l2 += parts.lame_ratio[r] * p2
    trace = m0[0] + m1[1] + m2[2]
    return ti.Matrix(
        [
            [l0[0] + m0[0] + trace, l1[0] + m0[1], l2[0] + m0[2]],
            [l0[1] + m1[0], l1[1] + m1[1] + trace, l2[1] + m1[2]],
            [l0[2] + m2[0], l1[2] + m2[1], l2[2] + m2[2] + trace],
        ]
    )


@func
def gathered_force(b: ti.i32, entries: HookeEntries, parts: BlockParts) -> vec3:
    """The force on the node of a block on the diagonal."""
    force = vec3(0.0)
    for c in range(parts.start[parts.run_start[b]], parts.start[parts.run_start[b + 1]]):
        force += entries.force[parts.row[c]]
    return force


# The rotation of a deformation, in closed form.
#
# Of all rotations R the one nearest to F has the largest tr(R^T F). With s1 >= s2 >= |s3| the singular values of F, the
# last with the sign of det F, that is l = s1 + s2 + s3, the largest root of
#     (l^2 - |F|^2)^2 - 8 l det F - 4 |cof F|^2 = 0,
# and with k = (l^2 - |F|^2) / 2
#     R = ((k + |F|^2) F + l cof F - F F^T F) / (k l - det F)
# (Markley 1993, Attitude Determination from Vector Observations: A Fast Optimal Matrix Algorithm). The divisor is
# (s1 + s2) (s2 + s3) (s3 + s1): it is zero where, and only where, the nearest rotation is not unique.
#
# An inverted element, of s3 < 0, gets a rotation like all others, never a reflection: it counts as turned inside out
# along the direction of its least stretch, so that its forces push it back that way. Where s2 + s3 is next to nothing
# the closed form loses digits; there R comes from the largest eigenvector of Davenport's matrix, by Jacobi's rotations.
# If it is nothing, as in an element that has become a line or a point, several rotations are equally near; it is one of
# them.

mat4 = ti.types.matrix(4, 4, ti.f64)

# Of (k l - det F) / l^3, which is 8 / 27 at rest. The closed form is good to 1e-16 over the square of it, about.
WELL_CONDITIONED = 0.02
# Halley's step is cubic: after one of this size, relative to l, the root is exact to round-off.
LAST_STEP = 1e-6


@func
def polar_rotation(deformation: mat3) -> mat3:
    """The rotation nearest to a deformation gradient, to round-off; also to an inverted one."""
    f = deformation
    cofactor = ti.Matrix.rows([row(f, 1).cross(row(f, 2)), row(f, 2).cross(row(f, 0)), row(f, 0).cross(row(f, 1))])
    determinant = row(f, 0).dot(row(cofactor, 0))
    squares = f.norm_sqr()
    root = largest_root(squares, determinant, cofactor.norm_sqr())
    pairs = 0.5 * (root * root - squares)
    divisor = pairs * root - determinant
    rotation = ti.Matrix.identity(ti.f64, 3)
    if divisor > WELL_CONDITIONED * root * root * root:
        outer = f @ f.transpose()
        rotation = ((pairs + squares) * f + root * cofactor - outer @ f) / divisor
    else:
        rotation = rotation_of_quaternion(largest_eigenvector(davenport_matrix(f)))
    return rotation


@func
def row(matrix: mat3, i: ti.template()) -> vec3:
    """A row of a matrix."""
    return vec3(matrix[i, 0], matrix[i, 1], matrix[i, 2])


@func
def largest_root(squares: ti.f64, determinant: ti.f64, cofactor_squares: ti.f64) -> ti.f64:
    """The largest root l of Markley's polynomial by Halley's steps, which fall from above: l^2 <= 3 |F|^2."""
    root = ti.sqrt(3.0 * squares)
    remaining = 50
    while remaining > 0:
        difference = root * root - squares
        value = difference * difference - 8.0 * root * determinant - 4.0 * cofactor_squares
        slope = 4.0 * root * difference - 8.0 * determinant
        curvature = 12.0 * root * root - 4.0 * squares
        divisor = 2.0 * slope * slope - value * curvature
        remaining -= 1
        step = 0.0
        if divisor > 0.0:
            step = 2.0 * value * slope / divisor
        root -= step
        if ti.abs(step) <= LAST_STEP * root:
            remaining = 0
    return root


@func
def davenport_matrix(f: mat3) -> mat4:
    """K with q^T K q = tr(R^T F) for the rotation R of every unit quaternion q."""
    trace = f.trace()
    turn = vec3(f[2, 1] - f[1, 2], f[0, 2] - f[2, 0], f[1, 0] - f[0, 1])
    matrix = ti.Matrix.zero(ti.f64, 4, 4)
    matrix[0, 0] = trace
    for i in ti.static(range(3)):
        matrix[0, i + 1] = turn[i]
        matrix[i + 1, 0] = turn[i]
        for j in ti.static(range(3)):
            matrix[i + 1, j + 1] = f[i, j] + f[j, i]
        matrix[i + 1, i + 1] -= trace
    return matrix


@func
def largest_eigenvector(symmetric: mat4) -> vec4:
    """The unit eigenvector of the largest eigenvalue by Jacobi's rotations (Golub and Van Loan, Matrix Computations,
    8.5), which end where the rest is round-off; of several one."""
    matrix = symmetric
    vectors = ti.Matrix.identity(ti.f64, 4)
    size = symmetric.norm_sqr()
    remaining = 20
    while remaining > 0:
        rest = 0.0
        for p in ti.static(range(3)):
            for q in ti.static(range(p + 1, 4)):
                rest += matrix[p, q] ** 2
                if ti.abs(matrix[p, q]) > 0.0:
                    half_difference = 0.5 * (matrix[q, q] - matrix[p, p]) / matrix[p, q]
                    tangent = 1.0 / (ti.abs(half_difference) + ti.sqrt(1.0 + half_difference**2))
                    if half_difference < 0.0:
                        tangent = -tangent
                    cosine = 1.0 / ti.sqrt(1.0 + tangent**2)
                    sine = tangent * cosine
                    for k in ti.static(range(4)):
                        first, second = matrix[k, p], matrix[k, q]
                        matrix[k, p], matrix[k, q] = cosine * first - sine * second, sine * first + cosine * second
                        first, second = vectors[k, p], vectors[k, q]
                        vectors[k, p], vectors[k, q] = cosine * first - sine * second, sine * first + cosine * second
                    for k in ti.static(range(4)):
                        first, second = matrix[p, k], matrix[q, k]
                        matrix[p, k], matrix[q, k] = cosine * first - sine * second, sine * first + cosine * second
        remaining -= 1
        if rest <= 1e-32 * size:
            remaining = 0
    largest = matrix[0, 0]
    vector = vec4(vectors[0, 0], vectors[1, 0], vectors[2, 0], vectors[3, 0])
    for i in ti.static(range(1, 4)):
        if matrix[i, i] > largest:
            largest = matrix[i, i]
            vector = vec4(vectors[0, i], vectors[1, i], vectors[2, i], vectors[3, i])
    return vector.normalized()


@func
def rotation_of_quaternion(q: vec4) -> mat3:
    """Rotation of a unit quaternion (w, x, y, z)."""
    axis = vec3(q[1], q[2], q[3])
    skew = ti.Matrix([[0.0, -q[3], q[2]], [q[3], 0.0, -q[1]], [-q[2], q[1], 0.0]])
    about = 2.0 * (axis.outer_product(axis) + q[0] * skew)
    return (q[0] ** 2 - axis.norm_sqr()) * ti.Matrix.identity(ti.f64, 3) + about


# Linear tetrahedra under corotated Hooke's law: rotations, nodal forces, and the system matrix by gathering.
#
# With g_a the gradient of corner a's shape function at rest, R the element's rotation and w its volume, the force on
# corner a is
#     f_a = -w R (lambda tr(e) I + 2 mu e) g_a,   e = sym(sum_b u_b g_b^T),   u_b = R^T x_b - X_b,
# and, R being frozen in the step (Mueller and Gross 2004, Interactive Virtual Materials), with G_a = R g_a,
#     K_ab = w (lambda G_a G_b^T + mu G_b G_a^T + mu (G_a . G_b) I).
# The gradients of the four corners add up to zero, and so do the forces: the fourth follows from three.

EDGES, POLAR, NONE = range(3)
"""What rotates an element: its first two edges, the polar decomposition, or nothing."""

# Elements and blocks of a task.
ELEMENTS_A_TASK = 128
LINEAR_BLOCKS_A_TASK = 256


class Elements(NamedTuple):
    """Linear tetrahedra of all soft bodies at rest; corner a of element e is entry 4 e + a.

    Attributes:
        nodes: of the corners, shape (element_count, 4).
        corotation: EDGES, POLAR or NONE, shape (element_count,).
        rest_frame: frame of the first two edges, shape (element_count, 3, 3).
        gradient: of the last three corners' shape functions [1/mm], shape (element_count, 3, 3).
        force_modulus: w lambda and w mu [mN mm], shape (element_count, 2).
        root: sqrt(w mu factor), with the factor of K in A, shape (element_count,).
        lag: s + b [s], 0 in overdamped dynamics, shape (element_count,).
    """

    nodes: IntegerTable
    corotation: Integers
    rest_frame: Matrices
    gradient: VectorTable
    force_modulus: ScalarTable
    root: Scalars
    lag: Scalars


@func
def edge_frame(along: vec3, across: vec3) -> mat3:
    """Orthonormal frame: first column along one edge, third normal to the plane of both."""
    first = along.normalized()
    third = first.cross(across).normalized()
    second = third.cross(first)
    return ti.Matrix.cols([first, second, third])


@func
def stress(gradient: mat3, lame_lambda: ti.f64, lame_mu: ti.f64) -> mat3:
    """Isotropic Hooke's law for a displacement gradient."""
    return lame_lambda * gradient.trace() * ti.Matrix.identity(ti.f64, 3) + lame_mu * (gradient + gradient.transpose())


@func
def strain_element(e: ti.i32, elements: Elements, movement: Movement, rotation: Matrices, entries: HookeEntries):
    """An element's rotation, its forces on its corners, and its turned gradients."""
    n0 = elements.nodes[e, 0]
    x0, v0, lag = movement.position[n0], movement.velocity[n0], elements.lag[e]
    present, lagged = ti.Matrix.zero(ti.f64, 3, 3), ti.Matrix.zero(ti.f64, 3, 3)
    for a in ti.static(range(3)):
        n, g = elements.nodes[e, a + 1], elements.gradient[e, a]
        edge = movement.position[n] - x0
        present += edge.outer_product(g)
        lagged += (edge + lag * (movement.velocity[n] - v0)).outer_product(g)
    r = ti.Matrix.identity(ti.f64, 3)
    if elements.corotation[e] == POLAR:
        r = polar_rotation(present)
    elif elements.corotation[e] == EDGES:
        n1, n2 = elements.nodes[e, 1], elements.nodes[e, 2]
        frame = edge_frame(movement.position[n1] - x0, movement.position[n2] - x0)
        r = frame @ elements.rest_frame[e].transpose()
    rotation[e] = r
    strain = r.transpose() @ lagged - ti.Matrix.identity(ti.f64, 3)
    pull = r @ stress(strain, elements.force_modulus[e, 0], elements.force_modulus[e, 1])
    turn = elements.root[e] * r
    first_force, first_gradient = vec3(0.0), vec3(0.0)
    for a in ti.static(range(3)):
        g = elements.gradient[e, a]
        force, turned = pull @ g, turn @ g
        first_force += force
        first_gradient += turned
        entries.force[4 * e + a + 1] = -force
        entries.gradient[4 * e + a + 1] = vec4(turned[0], turned[1], turned[2], 0.0)
    entries.force[4 * e] = first_force
    entries.gradient[4 * e] = -vec4(first_gradient[0], first_gradient[1], first_gradient[2], 0.0)


@func
def fill_block(b: ti.i32, entries: HookeEntries, parts: BlockParts, diagonal: Vectors, sums: DomainSums):
    """A block of the matrix from the elements that contain its two nodes, and on the diagonal the node's force."""
    total = gathered_stiffness(b, entries, parts)
    node = parts.node[b]
    if node >= 0:
        sums.force[node] = gathered_force(b, entries, parts)
        for d in ti.static(range(3)):
            total[d, d] += diagonal[node][d]
    sums.blocks[b] = total


@kernel
def assemble(
    elements: Elements,
    movement: Movement,
    rotation: Matrices,
    entries: HookeEntries,
    parts: BlockParts,
    diagonal: Vectors,
    sums: DomainSums,
    workers: ti.i32,
):
    """Nodal forces f - lag K v and the matrix A = diagonal + K, K already times its factor in A.

    First each element: its rotation, forces and turned gradients. f - lag K v is the force f for the positions
    x + lag v, since K has the rotations of this step. Then each block of A sums the stiffness of the elements that
    contain its two nodes, and each diagonal one their forces, in a fixed order.

    Each thread takes the next task until none is left; blocks wait for all elements.
    """
    element_count, block_count = elements.corotation.shape[0], sums.blocks.shape[0]
    element_tasks = (element_count + ELEMENTS_A_TASK - 1) // ELEMENTS_A_TASK
    block_tasks = (block_count + LINEAR_BLOCKS_A_TASK - 1) // LINEAR_BLOCKS_A_TASK
    for worker in range(workers * CHUNK):
        if worker % CHUNK == 0:
            t = ti.atomic_add(sums.progress[BEGUN], 1)
            while t < element_tasks:
                for e in range(t * ELEMENTS_A_TASK, ti.min((t + 1) * ELEMENTS_A_TASK, element_count)):
                    strain_element(e, elements, movement, rotation, entries)
                ti.atomic_add(sums.progress[FINISHED], 1)
                t = ti.atomic_add(sums.progress[BEGUN], 1)
            if reaches(sums.progress, FINISHED, element_tasks, PATIENCE):
                t = ti.atomic_add(sums.progress[BEGUN_LATER], 1)
                while t < block_tasks:
                    for b in range(t * LINEAR_BLOCKS_A_TASK, ti.min((t + 1) * LINEAR_BLOCKS_A_TASK, block_count)):
                        fill_block(b, entries, parts, diagonal, sums)
                    t = ti.atomic_add(sums.progress[BEGUN_LATER], 1)


# What a thread does in one go.
DOMAINS_A_TASK = 32
BLOCKS_A_TASK = 128


@func
def corotated_stress(d: ti.i32, deformation: mat3, rate: mat3, domains: Domains):
    """Rotation of a domain, and its stress w P, with `lag` times what it changes by at this rate."""
    rotation, unit = polar_rotation(deformation), ti.Matrix.identity(ti.f64, 3)
    first = domains.volume[d, DILATION] * domains.modulus[d, LAMBDA]
    second = domains.volume[d, SHAPE] * domains.modulus[d, MU]
    strain = rotation.transpose() @ (deformation + domains.lag[d] * rate) - unit
    return rotation, rotation @ (first * strain.trace() * unit + second * (strain + strain.transpose()))


@func
def strain_domain(d: ti.i32, domains: Domains, movement: Movement, entries: HookeEntries):
    """Forces and turned gradients of a domain."""
    deformation, rate = deformation_and_rate(d, domains, movement)
    rotation, stress = corotated_stress(d, deformation, rate, domains)
    weight = domains.volume[d, SHAPE] * domains.modulus[d, MU]
    if domains.volume[d, SHAPE] == 0.0:
        weight = domains.volume[d, DILATION] * domains.modulus[d, LAMBDA]
    turn = ti.sqrt(domains.factor[d] * weight) * rotation
    for c in range(domains.start[d], domains.start[d + 1]):
        g = domains.gradient[c]
        turned = turn @ g
        entries.force[c] = -(stress @ g)
        entries.gradient[c] = vec4(turned[0], turned[1], turned[2], 0.0)


@func
def add_block(b: ti.i32, block: Integers, entries: HookeEntries, parts: BlockParts, sums: DomainSums):
    """Add to a block of the matrix, and on the diagonal to the node's force, what the domains of its nodes give."""
    sums.blocks[block[b]] = sums.blocks[block[b]] + gathered_stiffness(b, entries, parts)
    node = parts.node[b]
    if node >= 0:
        sums.force[node] = sums.force[node] + gathered_force(b, entries, parts)


@kernel
def add_hooke_domains(
    domains: Domains,
    movement: Movement,
    block: Integers,
    entries: HookeEntries,
    parts: BlockParts,
    sums: DomainSums,
    workers: ti.i32,
):
    """Add the domains' nodal forces f - lag K v, and K times its factor, to forces and matrix.

    Number b of `parts` is number block[b] of the matrix. Each thread takes the next task until none is left; blocks,
    which gather their parts in a fixed order, wait for all domains.
    """
    domain_count, block_count = domains.lag.shape[0], block.shape[0]
    domain_tasks = (domain_count + DOMAINS_A_TASK - 1) // DOMAINS_A_TASK
    block_tasks = (block_count + BLOCKS_A_TASK - 1) // BLOCKS_A_TASK
    for worker in range(workers * CHUNK):
        if worker % CHUNK == 0:
            t = ti.atomic_add(sums.progress[BEGUN], 1)
            while t < domain_tasks:
                for d in range(t * DOMAINS_A_TASK, ti.min((t + 1) * DOMAINS_A_TASK, domain_count)):
                    strain_domain(d, domains, movement, entries)
                ti.atomic_add(sums.progress[FINISHED], 1)
                t = ti.atomic_add(sums.progress[BEGUN], 1)
            if reaches(sums.progress, FINISHED, domain_tasks, PATIENCE):
                t = ti.atomic_add(sums.progress[BEGUN_LATER], 1)
                while t < block_tasks:
                    for b in range(t * BLOCKS_A_TASK, ti.min((t + 1) * BLOCKS_A_TASK, block_count)):
                        add_block(b, block, entries, parts, sums)
                    t = ti.atomic_add(sums.progress[BEGUN_LATER], 1)
