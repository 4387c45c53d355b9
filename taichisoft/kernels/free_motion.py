"""What moves the bodies besides contact: momentum balance of the nodes, motion of the rigid bodies."""

from taichisoft.kernels.launch import kernel
from taichisoft.kernels.runtime import Integers, Matrices, ScalarBlocks, Scalars, ScalarTable, Vectors, mat3, ti, vec3


@kernel
def add_anchors_and_pressures(
    base: Vectors,
    base_turn: Matrices,
    anchored: Integers,
    stiffness: Scalars,
    lag: Scalars,
    rest_position: Vectors,
    position: Vectors,
    velocity: Vectors,
    pressure: Scalars,
    cavity_start: Integers,
    cavity_node: Integers,
    cavity_gradient: Vectors,
    force: Vectors,
):
    """Add -k (x + lag v - target) of the anchored nodes and p dV/dx to the forces.

    The targets are rest positions turned and moved with the base (`base`: pivot, translation).
    """
    ti.loop_config(serialize=True)
    for k in range(anchored.shape[0]):
        i = anchored[k]
        target = base_turn[0] @ (rest_position[i] - base[0]) + base[0] + base[1]
        force[i] -= stiffness[i] * (position[i] - target + lag[i] * velocity[i])
    ti.loop_config(serialize=True)
    for cavity in range(pressure.shape[0]):
        if pressure[cavity] != 0.0:
            for k in range(cavity_start[cavity], cavity_start[cavity + 1]):
                force[cavity_node[k]] += pressure[cavity] * cavity_gradient[k]


@ti.func
def skew(v: vec3) -> mat3:
    """Matrix of the cross product with v."""
    return ti.Matrix([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


@kernel
def rigid_motion(
    time_step: ti.f64,
    gravity: Vectors,
    mass: Scalars,
    inertia: Matrices,
    inverse_inertia: Matrices,
    quaternion: ScalarTable,
    linear: Vectors,
    angular: Vectors,
    rotation: Matrices,
    velocity: ScalarTable,
    inverse_mass: ScalarBlocks,
):
    """Rotation matrices, velocities after a step without contact, and inverse masses in world axes.

    The gyroscopic torque is taken implicitly, one Newton step in the body frame, since the explicit one makes
    slender bodies spin up (Catto 2015, Physics for Game Programmers: Numerical Methods).
    """
    ti.loop_config(serialize=True)
    for b in range(mass.shape[0]):
        w, x, y, z = quaternion[b, 0], quaternion[b, 1], quaternion[b, 2], quaternion[b, 3]
        to_world = ti.Matrix(
            [
                [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
                [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
                [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
            ]
        )
        rotation[b] = to_world
        local = to_world.transpose() @ angular[b]
        momentum = inertia[b] @ local
        jacobian = inertia[b] + time_step * (skew(local) @ inertia[b] - skew(momentum))
        turning = to_world @ (local - jacobian.inverse() @ (time_step * local.cross(momentum)))
        falling = linear[b] + time_step * gravity[0]
        turned_inverse = to_world @ inverse_inertia[b] @ to_world.transpose()
        for i in ti.static(range(3)):
            velocity[b, i] = falling[i]
            velocity[b, 3 + i] = turning[i]
            inverse_mass[b, i, i] = 1.0 / mass[b]
            for j in ti.static(range(3)):
                inverse_mass[b, 3 + i, 3 + j] = turned_inverse[i, j]


@kernel
def push_rigid(
    inverse_mass: ScalarBlocks, impulse: ScalarTable, velocity: ScalarTable, linear: Vectors, angular: Vectors
):
    """Velocities after the impulses, from those without."""
    ti.loop_config(serialize=True)
    for b in range(linear.shape[0]):
        total = ti.Vector.zero(ti.f64, 6)
        for i in ti.static(range(6)):
            total[i] = velocity[b, i]
            for j in range(6):
                total[i] += inverse_mass[b, i, j] * impulse[b, j]
        linear[b] = vec3(total[0], total[1], total[2])
        angular[b] = vec3(total[3], total[4], total[5])


@kernel
def move_rigid(time_step: ti.f64, linear: Vectors, angular: Vectors, position: Vectors, quaternion: ScalarTable):
    """Poses after a step with the velocities: the exponential map, normalised."""
    ti.loop_config(serialize=True)
    for b in range(position.shape[0]):
        turning = angular[b]
        position[b] = position[b] + time_step * linear[b]
        half = 0.5 * time_step * turning.norm()
        sine_part = 1.0
        if half > 1e-8:
            sine_part = ti.sin(half) / half
        v = 0.5 * sine_part * time_step * turning
        scalar = ti.cos(half)
        w, u = quaternion[b, 0], vec3(quaternion[b, 1], quaternion[b, 2], quaternion[b, 3])
        turned = scalar * u + w * v + v.cross(u)
        real = scalar * w - v.dot(u)
        scale = 1.0 / ti.sqrt(real * real + turned.norm_sqr())
        quaternion[b, 0] = scale * real
        for i in ti.static(range(3)):
            quaternion[b, 1 + i] = scale * turned[i]
