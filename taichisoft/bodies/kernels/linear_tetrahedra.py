"""Linear tetrahedra under corotated Hooke's law: rotations, nodal forces, and the system matrix by gathering.

With g_a the gradient of corner a's shape function at rest, R the element's rotation and w its volume, the force on
corner a is
    f_a = -w R (lambda tr(e) I + 2 mu e) g_a,   e = sym(sum_b u_b g_b^T),   u_b = R^T x_b - X_b,
and, R being frozen in the step (Mueller and Gross 2004, Interactive Virtual Materials), with G_a = R g_a,
    K_ab = w (lambda G_a G_b^T + mu G_b G_a^T + mu (G_a . G_b) I).
The gradients of the four corners add up to zero, and so do the forces: the fourth follows from three.
"""

from typing import NamedTuple

from taichisoft.bodies.kernels.hooke_blocks import BlockParts, HookeEntries, gathered_force, gathered_stiffness, vec4
from taichisoft.bodies.kernels.polar_rotation import polar_rotation
from taichisoft.runtime.language import (
    CHUNK,
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
from taichisoft.runtime.waiting import BEGUN, BEGUN_LATER, FINISHED, PATIENCE, reaches

# Elements and blocks of a task.
ELEMENTS_A_TASK = 128
BLOCKS_A_TASK = 256


class Elements(NamedTuple):
    """Linear tetrahedra of all soft bodies at rest; corner a of element e is entry 4 e + a.

    Attributes:
        nodes: of the corners, shape (element_count, 4).
        polar: whether the rotation is that of the polar decomposition, else that of two edges, shape (element_count,).
        rest_frame: frame of the first two edges, shape (element_count, 3, 3).
        gradient: of the last three corners' shape functions [1/mm], shape (element_count, 3, 3).
        force_modulus: w lambda and w mu [mN mm], shape (element_count, 2).
        root: sqrt(w mu factor), with the factor of K in A, shape (element_count,).
        lag: s + b [s], 0 in overdamped dynamics, shape (element_count,).
    """

    nodes: IntegerTable
    polar: Integers
    rest_frame: Matrices
    gradient: VectorTable
    force_modulus: ScalarTable
    root: Scalars
    lag: Scalars


class Deformation(NamedTuple):
    """Positions and velocities of the nodes, and the elements' rotations.

    Attributes:
        position: of the nodes [mm], shape (node_count, 3).
        velocity: of the nodes [mm/s], shape (node_count, 3).
        rotation: of each element, shape (element_count, 3, 3).
    """

    position: Vectors
    velocity: Vectors
    rotation: Matrices


class SystemMatrix(NamedTuple):
    """Forces and matrix of a step.

    Attributes:
        force: f - (h + b) K v on each node [mN], shape (node_count, 3).
        blocks: of A, shape (block_count, 3, 3).
        diagonal: what is added on its diagonal: masses with their damping, and anchors [kg], shape (node_count, 3).
        progress: counters of `waiting`, 0 at the start.
    """

    force: Vectors
    blocks: Matrices
    diagonal: Vectors
    progress: Integers


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
def strain_element(e: ti.i32, elements: Elements, deformation: Deformation, entries: HookeEntries):
    """An element's rotation, its forces on its corners, and its turned gradients."""
    n0 = elements.nodes[e, 0]
    x0, v0, lag = deformation.position[n0], deformation.velocity[n0], elements.lag[e]
    present, lagged = ti.Matrix.zero(ti.f64, 3, 3), ti.Matrix.zero(ti.f64, 3, 3)
    for a in ti.static(range(3)):
        n, g = elements.nodes[e, a + 1], elements.gradient[e, a]
        edge = deformation.position[n] - x0
        present += edge.outer_product(g)
        lagged += (edge + lag * (deformation.velocity[n] - v0)).outer_product(g)
    r = ti.Matrix.identity(ti.f64, 3)
    if elements.polar[e] != 0:
        r = polar_rotation(present)
    else:
        n1, n2 = elements.nodes[e, 1], elements.nodes[e, 2]
        frame = edge_frame(deformation.position[n1] - x0, deformation.position[n2] - x0)
        r = frame @ elements.rest_frame[e].transpose()
    deformation.rotation[e] = r
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
def fill_block(b: ti.i32, entries: HookeEntries, parts: BlockParts, system: SystemMatrix):
    """A block of the matrix from the elements that contain its two nodes, and on the diagonal the node's force."""
    total = gathered_stiffness(b, entries, parts)
    node = parts.node[b]
    if node >= 0:
        system.force[node] = gathered_force(b, entries, parts)
        for d in ti.static(range(3)):
            total[d, d] += system.diagonal[node][d]
    system.blocks[b] = total


@kernel
def assemble(
    elements: Elements,
    deformation: Deformation,
    entries: HookeEntries,
    parts: BlockParts,
    system: SystemMatrix,
    workers: ti.i32,
):
    """Nodal forces f - lag K v and the matrix A = diagonal + K, K already times its factor in A.

    First each element: its rotation, forces and turned gradients. f - lag K v is the force f for the positions
    x + lag v, since K has the rotations of this step. Then each block of A sums the stiffness of the elements that
    contain its two nodes, and each diagonal one their forces, in a fixed order.

    Each thread takes the next task until none is left; blocks wait for all elements.
    """
    element_count, block_count = elements.polar.shape[0], system.blocks.shape[0]
    element_tasks = (element_count + ELEMENTS_A_TASK - 1) // ELEMENTS_A_TASK
    block_tasks = (block_count + BLOCKS_A_TASK - 1) // BLOCKS_A_TASK
    for worker in range(workers * CHUNK):
        if worker % CHUNK == 0:
            t = ti.atomic_add(system.progress[BEGUN], 1)
            while t < element_tasks:
                for e in range(t * ELEMENTS_A_TASK, ti.min((t + 1) * ELEMENTS_A_TASK, element_count)):
                    strain_element(e, elements, deformation, entries)
                ti.atomic_add(system.progress[FINISHED], 1)
                t = ti.atomic_add(system.progress[BEGUN], 1)
            if reaches(system.progress, FINISHED, element_tasks, PATIENCE):
                t = ti.atomic_add(system.progress[BEGUN_LATER], 1)
                while t < block_tasks:
                    for b in range(t * BLOCKS_A_TASK, ti.min((t + 1) * BLOCKS_A_TASK, block_count)):
                        fill_block(b, entries, parts, system)
                    t = ti.atomic_add(system.progress[BEGUN_LATER], 1)
