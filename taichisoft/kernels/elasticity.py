"""Corotational linear elasticity: rotations, nodal forces, and the system matrix by gathering.

An element has any number of nodes and quadrature points. With g_a the gradient of node a's shape function at
rest, R the element's rotation and w the volume of a quadrature point, the force on node a is
    f_a = -sum_q w R (lambda tr(e) I + 2 mu e) g_a,   e = sym(sum_b u_b g_b^T),   u_b = R^T x_b - X_b,
and, R being frozen in the step (Mueller and Gross 2004, Interactive Virtual Materials), with G_a = R g_a,
    K_ab = sum_q w (lambda G_a G_b^T + mu G_b G_a^T + mu (G_a . G_b) I).
"""

from taichisoft.kernels.launch import kernel
from taichisoft.kernels.rotations import polar_rotation
from taichisoft.kernels.runtime import CHUNK, THREADS, Integers, Matrices, Scalars, ScalarTable, Vectors, mat3, ti, vec3

# What a thread does in one go.
ELEMENTS_A_TASK = 128
BLOCKS_A_TASK = 256
# What `progress` counts.
NEXT_TASK, ELEMENTS_DONE = range(2)


@ti.func
def edge_frame(along: vec3, across: vec3) -> mat3:
    """Orthonormal frame: first column along one edge, third normal to the plane of both."""
    first = along.normalized()
    third = first.cross(across).normalized()
    second = third.cross(first)
    return ti.Matrix.cols([first, second, third])


@ti.func
def stress(gradient: mat3, lame_lambda: ti.f64, lame_mu: ti.f64) -> mat3:
    """Isotropic Hooke's law for a displacement gradient."""
    return lame_lambda * gradient.trace() * ti.Matrix.identity(ti.f64, 3) + lame_mu * (gradient + gradient.transpose())


@ti.func
def load(array: Scalars, place: ti.i32) -> vec3:
    """Three numbers from a place on."""
    return vec3(array[place], array[place + 1], array[place + 2])


@ti.func
def store(array: Scalars, place: ti.i32, value: vec3):
    """Put three numbers from a place on."""
    for d in ti.static(range(3)):
        array[place + d] = value[d]


@ti.func
def strain_element(
    e: ti.i32,
    corner_count: ti.i32,
    point_stride: ti.i32,
    elements: Integers,
    polar: Integers,
    rest_frame: Matrices,
    volume: ScalarTable,
    shape_gradient: Scalars,
    scaled_gradient: Scalars,
    lame: ScalarTable,
    lag: Scalars,
    position: Scalars,
    velocity: Scalars,
    rotation: Matrices,
    rotated_gradient: Scalars,
    element_force: Scalars,
):
    """An element's rotation, its forces on its corners, and its rotated gradients."""
    n0 = 3 * elements[e * corner_count]
    n1, n2 = 3 * elements[e * corner_count + 1], 3 * elements[e * corner_count + 2]
    x0, v0 = load(position, n0), load(velocity, n0)
    r = edge_frame(load(position, n1) - x0, load(position, n2) - x0) @ rest_frame[e].transpose()
    if polar[e] != 0:
        deformation = ti.Matrix.zero(ti.f64, 3, 3)
        for q in range(volume.shape[1]):
            for a in range(corner_count):
                g = load(shape_gradient, q * point_stride + 4 * (e * corner_count + a))
                x = load(position, 3 * elements[e * corner_count + a])
                deformation += volume[e, q] * (x - x0).outer_product(g)
        r = polar_rotation(deformation, r)
    rotation[e] = r
    for a in range(corner_count):
        store(element_force, 4 * (e * corner_count + a), vec3(0.0))
    for q in range(volume.shape[1]):
        first = q * point_stride + 4 * e * corner_count
        gradient = ti.Matrix.zero(ti.f64, 3, 3)
        for a in range(1, corner_count):
            n = 3 * elements[e * corner_count + a]
            lagged = load(position, n) - x0 + lag[e] * (load(velocity, n) - v0)
            gradient += lagged.outer_product(load(shape_gradient, first + 4 * a))
        strain = r.transpose() @ gradient - ti.Matrix.identity(ti.f64, 3)
        pull = -volume[e, q] * (r @ stress(strain, lame[e, 0], lame[e, 1]))
        for a in range(corner_count):
            place = first + 4 * a
            store(rotated_gradient, place, r @ load(scaled_gradient, place))
            here = 4 * (e * corner_count + a)
            store(element_force, here, load(element_force, here) + pull @ load(shape_gradient, place))


@ti.func
def gather_block(
    k: ti.i32,
    point_count: ti.i32,
    point_stride: ti.i32,
    rotated_gradient: Scalars,
    element_force: Scalars,
    block_start: Integers,
    row_place: Integers,
    column_place: Integers,
    lame_ratio: Scalars,
    diagonal_block: Integers,
    diagonal: Scalars,
    force: Vectors,
    blocks: Matrices,
):
    """A block of the matrix from the elements that contain its two nodes, and on the diagonal the node's force."""
    shear = ti.Matrix.zero(ti.f64, 3, 3)
    total = ti.Matrix.zero(ti.f64, 3, 3)
    for c in range(block_start[k], block_start[k + 1]):
        for q in range(point_count):
            row = load(rotated_gradient, q * point_stride + row_place[c])
            column = load(rotated_gradient, q * point_stride + column_place[c])
            product = row.outer_product(column)
            shear += product
            total += lame_ratio[c] * product
    total += shear.transpose() + shear.trace() * ti.Matrix.identity(ti.f64, 3)
    node = diagonal_block[k]
    if node >= 0:
        node_force = vec3(0.0)
        for c in range(block_start[k], block_start[k + 1]):
            node_force += load(element_force, row_place[c])
        force[node] = node_force
        total += diagonal[node] * ti.Matrix.identity(ti.f64, 3)
    blocks[k] = total


@kernel
def assemble(
    corner_count: ti.i32,
    elements: Integers,
    polar: Integers,
    rest_frame: Matrices,
    volume: ScalarTable,
    shape_gradient: Scalars,
    scaled_gradient: Scalars,
    lame: ScalarTable,
    lag: Scalars,
    position: Scalars,
    velocity: Scalars,
    rotation: Matrices,
    rotated_gradient: Scalars,
    element_force: Scalars,
    block_start: Integers,
    row_place: Integers,
    column_place: Integers,
    lame_ratio: Scalars,
    diagonal_block: Integers,
    diagonal: Scalars,
    force: Vectors,
    blocks: Matrices,
    progress: Integers,
):
    """Nodal forces f - lag K v and the matrix A = diagonal + K, K already times its factor in A.

    First each element: its rotation, forces and rotated gradients. f - lag K v is the force f for the positions
    x + lag v, since K has the rotations of this step. Then each block of A sums the stiffness of the elements that
    contain its two nodes, and each diagonal one their forces, in a fixed order. With H_a = sqrt(w mu factor) R g_a and
    M = sum H_a H_b^T, a block is sum (lambda / mu) H_a H_b^T + M^T + tr(M) I.

    Vectors stand at multiples of four numbers, which keeps them aligned: corner a of element e at
    4 (e corner_count + a), the next quadrature point 4 element_count corner_count further on.

    Each thread takes the next task until none is left; blocks wait for all elements. `progress` must be 0 at the start.
    """
    element_count, block_count = polar.shape[0], blocks.shape[0]
    point_stride = 4 * element_count * corner_count
    element_tasks = (element_count + ELEMENTS_A_TASK - 1) // ELEMENTS_A_TASK
    block_tasks = (block_count + BLOCKS_A_TASK - 1) // BLOCKS_A_TASK
    for worker in range(THREADS * CHUNK):
        if worker % CHUNK == 0:
            t = ti.atomic_add(progress[NEXT_TASK], 1)
            while t < element_tasks:
                for e in range(t * ELEMENTS_A_TASK, ti.min((t + 1) * ELEMENTS_A_TASK, element_count)):
                    strain_element(
                        e, corner_count, point_stride, elements, polar, rest_frame, volume, shape_gradient,
                        scaled_gradient, lame, lag, position, velocity, rotation, rotated_gradient, element_force,
                    )  # fmt: skip
                ti.atomic_add(progress[ELEMENTS_DONE], 1)
                t = ti.atomic_add(progress[NEXT_TASK], 1)
            while ti.atomic_max(progress[ELEMENTS_DONE], 0) < element_tasks:  # a load that the compiler may not move
                pass
            while t < element_tasks + block_tasks:
                first = (t - element_tasks) * BLOCKS_A_TASK
                for k in range(first, ti.min(first + BLOCKS_A_TASK, block_count)):
                    gather_block(
                        k, volume.shape[1], point_stride, rotated_gradient, element_force, block_start, row_place,
                        column_place, lame_ratio, diagonal_block, diagonal, force, blocks,
                    )  # fmt: skip
                t = ti.atomic_add(progress[NEXT_TASK], 1)
