"""Corotational linear elasticity: rotations, nodal forces, and the system matrix by gathering.

An element has any number of nodes and quadrature points. With g_a the gradient of node a's shape function at
rest, R the element's rotation and w the volume of a quadrature point, the force on node a is
    f_a = -sum_q w R (lambda tr(e) I + 2 mu e) g_a,   e = sym(sum_b u_b g_b^T),   u_b = R^T x_b - X_b,
and, R being frozen in the step (Mueller and Gross 2004, Interactive Virtual Materials), with G_a = R g_a,
    K_ab = sum_q w (lambda G_a G_b^T + mu G_b G_a^T + mu (G_a . G_b) I).
"""

from taichisoft.kernels.launch import kernel
from taichisoft.kernels.runtime import (
    Integers,
    IntegerTable,
    Matrices,
    Scalars,
    ScalarTable,
    VectorBlocks,
    Vectors,
    VectorTable,
    mat3,
    ti,
    vec3,
)


@ti.func
def edge_frame(along: vec3, across: vec3) -> mat3:
    """Orthonormal frame: first column along one edge, third normal to the plane of both."""
    first = along.normalized()
    third = first.cross(across).normalized()
    second = third.cross(first)
    return ti.Matrix.cols([first, second, third])


@ti.func
def rotation_of_vector(w: vec3) -> mat3:
    """Rotation by the angle |w| about w (Rodrigues' formula)."""
    angle = w.norm()
    half = 0.5 * angle
    cosine_part = 0.5  # (1 - cos a) / a^2
    sine_part = 1.0  # sin a / a
    if angle > 1e-8:
        sine_part = ti.sin(angle) / angle
        cosine_part = 0.5 * (ti.sin(half) / half) ** 2
    skew = ti.Matrix([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])
    return ti.Matrix.identity(ti.f64, 3) + sine_part * skew + cosine_part * (skew @ skew)


@ti.func
def polar_rotation(deformation: mat3, start: mat3) -> mat3:
    """Rotation nearest to a deformation gradient, also an inverted one (Mueller et al. 2016, A Robust Method to
    Extract the Rotational Part of Deformations); stops when the correction is below 1e-14 rad."""
    rotation = start
    remaining = 100
    while remaining > 0:
        torque = vec3(0.0)
        stretch = 0.0
        for axis in ti.static(range(3)):
            r = vec3(rotation[0, axis], rotation[1, axis], rotation[2, axis])
            f = vec3(deformation[0, axis], deformation[1, axis], deformation[2, axis])
            torque += r.cross(f)
            stretch += r.dot(f)
        correction = torque / (ti.abs(stretch) + 1e-9)
        rotation = rotation_of_vector(correction) @ rotation
        remaining -= 1
        if correction.norm() < 1e-14:
            remaining = 0
    return rotation


@ti.func
def stress(gradient: mat3, lame_lambda: ti.f64, lame_mu: ti.f64) -> mat3:
    """Isotropic Hooke's law for a displacement gradient."""
    return lame_lambda * gradient.trace() * ti.Matrix.identity(ti.f64, 3) + lame_mu * (gradient + gradient.transpose())


@kernel
def assemble(
    elements: IntegerTable,
    polar: Integers,
    rest_position: Vectors,
    shape_gradient: VectorBlocks,
    volume: ScalarTable,
    lame: ScalarTable,
    velocity_factor: Scalars,
    position: Vectors,
    velocity: Vectors,
    rotation: Matrices,
    rotated_gradient: VectorBlocks,
    element_force: VectorTable,
    start: Integers,
    node_element: Integers,
    node_corner: Integers,
    force: Vectors,
    block_start: Integers,
    block_element: Integers,
    row_corner: Integers,
    column_corner: Integers,
    stiffness_factor: Scalars,
    diagonal_block: Integers,
    diagonal: Scalars,
    blocks: Matrices,
):
    """Nodal forces f - velocity_factor K v and the matrix A = diagonal + stiffness_factor K.

    First each element: its rotation and its forces. Then each node sums the forces of
    its elements, and each block of A the stiffness of the elements that contain its two nodes, in a fixed order.
    """
    node_count = elements.shape[1]
    for e in range(elements.shape[0]):
        n0, n1, n2 = elements[e, 0], elements[e, 1], elements[e, 2]
        x0, rest0 = position[n0], rest_position[n0]
        r = edge_frame(position[n1] - x0, position[n2] - x0)
        r = r @ edge_frame(rest_position[n1] - rest0, rest_position[n2] - rest0).transpose()
        if polar[e] != 0:
            deformation = ti.Matrix.zero(ti.f64, 3, 3)
            for q in range(volume.shape[1]):
                for b in range(node_count):
                    deformation += volume[e, q] * position[elements[e, b]].outer_product(shape_gradient[e, q, b])
            r = polar_rotation(deformation, r)
        rotation[e] = r
        for a in range(node_count):
            element_force[e, a] = vec3(0.0)
        for q in range(volume.shape[1]):
            strain = ti.Matrix.zero(ti.f64, 3, 3)
            strain_rate = ti.Matrix.zero(ti.f64, 3, 3)
            for b in range(node_count):
                n = elements[e, b]
                g = shape_gradient[e, q, b]
                rotated = r @ g
                rotated_gradient[e, q, b] = rotated
                displacement = r.transpose() @ (position[n] - x0) - (rest_position[n] - rest0)
                strain += displacement.outer_product(g)
                strain_rate += velocity[n].outer_product(rotated)
            elastic = r @ stress(strain, lame[e, 0], lame[e, 1]) @ r.transpose()
            total = elastic + velocity_factor[e] * stress(strain_rate, lame[e, 0], lame[e, 1])
            for a in range(node_count):
                pull = volume[e, q] * (total @ rotated_gradient[e, q, a])
                element_force[e, a] = element_force[e, a] - pull
    for i in range(start.shape[0] - 1):
        total = vec3(0.0)
        for k in range(start[i], start[i + 1]):
            total += element_force[node_element[k], node_corner[k]]
        force[i] = total
    for k in range(blocks.shape[0]):
        total = ti.Matrix.zero(ti.f64, 3, 3)
        for c in range(block_start[k], block_start[k + 1]):
            e = block_element[c]
            a = row_corner[c]
            b = column_corner[c]
            for q in range(volume.shape[1]):
                ga = rotated_gradient[e, q, a]
                gb = rotated_gradient[e, q, b]
                w = stiffness_factor[e] * volume[e, q]
                total += (w * lame[e, 0]) * ga.outer_product(gb) + (w * lame[e, 1]) * gb.outer_product(ga)
                shear = w * lame[e, 1] * ga.dot(gb)
                for d in ti.static(range(3)):
                    total[d, d] += shear
        node = diagonal_block[k]
        if node >= 0:
            for d in ti.static(range(3)):
                total[d, d] += diagonal[node]
        blocks[k] = total
