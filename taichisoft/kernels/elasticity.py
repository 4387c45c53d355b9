"""Corotational linear elasticity: rotations, nodal forces, and the system matrix by gathering.

An element has any number of nodes and quadrature points. With g_a the gradient of node a's shape function at
rest, R the element's rotation and w the volume of a quadrature point, the force on node a is
    f_a = -sum_q w R (lambda tr(e) I + 2 mu e) g_a,   e = sym(sum_b u_b g_b^T),   u_b = R^T x_b - X_b,
and, R being frozen in the step (Mueller and Gross 2004, Interactive Virtual Materials), with G_a = R g_a,
    K_ab = sum_q w (lambda G_a G_b^T + mu G_b G_a^T + mu (G_a . G_b) I).
"""

from typing import NamedTuple

from taichisoft.kernels.launch import func, kernel
from taichisoft.kernels.polar_rotation import polar_rotation
from taichisoft.kernels.runtime import CHUNK, THREADS, Integers, Matrices, Scalars, ScalarTable, Vectors, mat3, ti, vec3

# What a thread does in one go.
ELEMENTS_A_TASK = 128
BLOCKS_A_TASK = 256
# What `progress` counts.
NEXT_TASK, ELEMENTS_DONE = range(2)


class Elements(NamedTuple):
    """Elements of all soft bodies at rest.

    Vectors stand at multiples of four numbers, which keeps them aligned: corner a of element e at
    4 (e nodes_per_element + a), the next quadrature point 4 element_count nodes_per_element further on.

    Attributes:
        nodes: node indices of all elements one after the other, shape (element_count * nodes_per_element,).
        polar: whether the rotation is that of the polar decomposition, else that of two edges, shape (element_count,).
        rest_frame: frame of the first two edges, shape (element_count, 3, 3).
        volume: that of each quadrature point [mm^3], shape (element_count, point_count).
        gradient: gradients of the shape functions [1/mm].
        scaled_gradient: the same times sqrt(w mu factor), with the factor of K in A.
        lame: Lame's lambda and mu [kPa], shape (element_count, 2).
        lag: h + b [s], 0 in first order dynamics, shape (element_count,).
    """

    nodes: Integers
    polar: Integers
    rest_frame: Matrices
    volume: ScalarTable
    gradient: Scalars
    scaled_gradient: Scalars
    lame: ScalarTable
    lag: Scalars


class Deformation(NamedTuple):
    """Elements of a step, at the same places as in `Elements`.

    Attributes:
        position: of the nodes [mm], shape (3 node_count,).
        velocity: of the nodes [mm/s], shape (3 node_count,).
        rotation: of each element, shape (element_count, 3, 3).
        rotated_gradient: R times the scaled gradients.
        element_force: forces of each element on its corners [mN].
    """

    position: Scalars
    velocity: Scalars
    rotation: Matrices
    rotated_gradient: Scalars
    element_force: Scalars


class BlockParts(NamedTuple):
    """Where the parts of each block of the system matrix stand.

    Attributes:
        start: where each block's parts begin in the lists that follow, shape (block_count + 1,).
        row_place, column_place: places of the gradients of the block's two nodes in an element.
        lame_ratio: lambda / mu of that element.
        diagonal_node: node of a block on the diagonal, -1 for others, shape (block_count,).
        diagonal: what is added on the diagonal: masses with their damping, and anchors [kg], shape (node_count, 3).
    """

    start: Integers
    row_place: Integers
    column_place: Integers
    lame_ratio: Scalars
    diagonal_node: Integers
    diagonal: Vectors


class SystemMatrix(NamedTuple):
    """Forces and matrix of a step.

    Attributes:
        force: f - (h + b) K v on each node [mN], shape (node_count, 3).
        blocks: of A, shape (block_count, 3, 3).
        progress: counters, 0 at the start.
    """

    force: Vectors
    blocks: Matrices
    progress: Integers


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


@func
def strain_element(e: ti.i32, nodes_per_element: ti.i32, elements: Elements, deformation: Deformation):
    """An element's rotation, its forces on its corners, and its rotated gradients."""
    point_stride = 4 * elements.polar.shape[0] * nodes_per_element
    first_corner = e * nodes_per_element
    n0 = 3 * elements.nodes[first_corner]
    x0, v0 = load(deformation.position, n0), load(deformation.velocity, n0)
    r = ti.Matrix.identity(ti.f64, 3)
    if elements.polar[e] != 0:
        total = ti.Matrix.zero(ti.f64, 3, 3)
        for q in range(elements.volume.shape[1]):
            for a in range(1, nodes_per_element):
                g = load(elements.gradient, q * point_stride + 4 * (first_corner + a))
                x = load(deformation.position, 3 * elements.nodes[first_corner + a])
                total += elements.volume[e, q] * (x - x0).outer_product(g)
        r = polar_rotation(total)
    else:
        n1, n2 = 3 * elements.nodes[first_corner + 1], 3 * elements.nodes[first_corner + 2]
        frame = edge_frame(load(deformation.position, n1) - x0, load(deformation.position, n2) - x0)
        r = frame @ elements.rest_frame[e].transpose()
    deformation.rotation[e] = r
    for a in range(nodes_per_element):
        store(deformation.element_force, 4 * (first_corner + a), vec3(0.0))
    for q in range(elements.volume.shape[1]):
        first = q * point_stride + 4 * first_corner
        gradient = ti.Matrix.zero(ti.f64, 3, 3)
        for a in range(1, nodes_per_element):
            n = 3 * elements.nodes[first_corner + a]
            lagged = load(deformation.position, n) - x0 + elements.lag[e] * (load(deformation.velocity, n) - v0)
            gradient += lagged.outer_product(load(elements.gradient, first + 4 * a))
        strain = r.transpose() @ gradient - ti.Matrix.identity(ti.f64, 3)
        pull = -elements.volume[e, q] * (r @ stress(strain, elements.lame[e, 0], elements.lame[e, 1]))
        for a in range(nodes_per_element):
            place = first + 4 * a
            store(deformation.rotated_gradient, place, r @ load(elements.scaled_gradient, place))
            here = 4 * (first_corner + a)
            pulled = load(deformation.element_force, here) + pull @ load(elements.gradient, place)
            store(deformation.element_force, here, pulled)


@func
def gather_block(
    k: ti.i32,
    point_count: ti.i32,
    point_stride: ti.i32,
    parts: BlockParts,
    deformation: Deformation,
    system: SystemMatrix,
):
    """A block of the matrix from the elements that contain its two nodes, and on the diagonal the node's force."""
    shear = ti.Matrix.zero(ti.f64, 3, 3)
    total = ti.Matrix.zero(ti.f64, 3, 3)
    for c in range(parts.start[k], parts.start[k + 1]):
        for q in range(point_count):
            row = load(deformation.rotated_gradient, q * point_stride + parts.row_place[c])
            column = load(deformation.rotated_gradient, q * point_stride + parts.column_place[c])
            product = row.outer_product(column)
            shear += product
            total += parts.lame_ratio[c] * product
    total += shear.transpose() + shear.trace() * ti.Matrix.identity(ti.f64, 3)
    node = parts.diagonal_node[k]
    if node >= 0:
        node_force = vec3(0.0)
        for c in range(parts.start[k], parts.start[k + 1]):
            node_force += load(deformation.element_force, parts.row_place[c])
        system.force[node] = node_force
        for d in ti.static(range(3)):
            total[d, d] += parts.diagonal[node][d]
    system.blocks[k] = total


@kernel
def assemble(
    nodes_per_element: ti.i32, elements: Elements, deformation: Deformation, parts: BlockParts, system: SystemMatrix
):
    """Nodal forces f - lag K v and the matrix A = diagonal + K, K already times its factor in A.

    First each element: its rotation, forces and rotated gradients. f - lag K v is the force f for the positions
    x + lag v, since K has the rotations of this step. Then each block of A sums the stiffness of the elements that
    contain its two nodes, and each diagonal one their forces, in a fixed order. With H_a = sqrt(w mu factor) R g_a and
    M = sum H_a H_b^T, a block is sum (lambda / mu) H_a H_b^T + M^T + tr(M) I.

    Each thread takes the next task until none is left; blocks wait for all elements.
    """
    element_count, block_count = elements.polar.shape[0], system.blocks.shape[0]
    point_stride = 4 * element_count * nodes_per_element
    element_tasks = (element_count + ELEMENTS_A_TASK - 1) // ELEMENTS_A_TASK
    block_tasks = (block_count + BLOCKS_A_TASK - 1) // BLOCKS_A_TASK
    for worker in range(THREADS * CHUNK):
        if worker % CHUNK == 0:
            t = ti.atomic_add(system.progress[NEXT_TASK], 1)
            while t < element_tasks:
                for e in range(t * ELEMENTS_A_TASK, ti.min((t + 1) * ELEMENTS_A_TASK, element_count)):
                    strain_element(e, nodes_per_element, elements, deformation)
                ti.atomic_add(system.progress[ELEMENTS_DONE], 1)
                t = ti.atomic_add(system.progress[NEXT_TASK], 1)
            while ti.atomic_max(system.progress[ELEMENTS_DONE], 0) < element_tasks:  # a load that nothing may move
                pass
            while t < element_tasks + block_tasks:
                first = (t - element_tasks) * BLOCKS_A_TASK
                for k in range(first, ti.min(first + BLOCKS_A_TASK, block_count)):
                    gather_block(k, elements.volume.shape[1], point_stride, parts, deformation, system)
                t = ti.atomic_add(system.progress[NEXT_TASK], 1)
