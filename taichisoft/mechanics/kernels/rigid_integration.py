"""Motion of the rigid bodies: without contact, by impulses, and along a step."""

from typing import NamedTuple

from taichisoft.runtime.arithmetic import rotation_of_vector
from taichisoft.runtime.language import Matrices, ScalarBlocks, Scalars, ScalarTable, Vectors, func, mat3, ti, vec3
from taichisoft.runtime.launch import kernel

# For the gyroscopic torque by Newton's method, and for the axes that turn with half of what is found: errors of these
# shrink by h |w| / 2 in each.
MOST_ITERATIONS = 16


class RigidBodies(NamedTuple):
    """What the rigid bodies are.

    Attributes:
        mass: [kg], shape (rigid_count,).
        inertia, inverse_inertia: in the body frames [kg mm^2] and [1/(kg mm^2)], shape (rigid_count, 3, 3).
        gravity: [mm/s^2], shape (1, 3).
    """

    mass: Scalars
    inertia: Matrices
    inverse_inertia: Matrices
    gravity: Vectors


class RigidState(NamedTuple):
    """How the rigid bodies move in a step.

    Attributes:
        position: centres of mass before the step [mm], shape (rigid_count, 3).
        quaternion: (w, x, y, z) before the step, shape (rigid_count, 4).
        linear, angular: velocities before the step, then after it [mm/s] and [rad/s], shape (rigid_count, 3).
        rotation: body axes in the world at the start, shape (rigid_count, 3, 3).
        free: linear [mm/s] and angular velocity [rad/s] after the step without contacts, shape (rigid_count, 6).
        inverse_mass: inverse mass [1/kg] and inertia [1/(kg mm^2)] in world axes, shape (rigid_count, 6, 6).
        impulse: of the contacts, linear [mN s] and angular [mN mm s], shape (rigid_count, 6).
    """

    position: Vectors
    quaternion: ScalarTable
    linear: Vectors
    angular: Vectors
    rotation: Matrices
    free: ScalarTable
    inverse_mass: ScalarBlocks
    impulse: ScalarTable


@func
def skew(v: vec3) -> mat3:
    """Matrix of the cross product with v."""
    return ti.Matrix([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


@kernel
def solve_free_motion(time_step: ti.f64, bodies: RigidBodies, rigid: RigidState):
    """Rotation matrices, velocities after a step without contact, and inverse masses in world axes.

    The gyroscopic torque is taken implicitly, one Newton step in the body frame, since the explicit one makes
    slender bodies spin up (Catto 2015, Physics for Game Programmers: Numerical Methods).
    """
    ti.loop_config(serialize=True)
    for b in range(bodies.mass.shape[0]):
        w, x, y, z = (
            rigid.quaternion[b, 0],
            rigid.quaternion[b, 1],
            rigid.quaternion[b, 2],
            rigid.quaternion[b, 3],
        )
        to_world = ti.Matrix(
            [
                [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
                [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
                [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
            ]
        )
        rigid.rotation[b] = to_world
        local = to_world.transpose() @ rigid.angular[b]
        inertia = bodies.inertia[b]
        momentum = inertia @ local
        jacobian = inertia + time_step * (skew(local) @ inertia - skew(momentum))
        turning = to_world @ (local - jacobian.inverse() @ (time_step * local.cross(momentum)))
        falling = rigid.linear[b] + time_step * bodies.gravity[0]
        turned_inverse = to_world @ bodies.inverse_inertia[b] @ to_world.transpose()
        for i in ti.static(range(3)):
            rigid.free[b, i] = falling[i]
            rigid.free[b, 3 + i] = turning[i]
            rigid.inverse_mass[b, i, i] = 1.0 / bodies.mass[b]
            for j in ti.static(range(3)):
                rigid.inverse_mass[b, 3 + i, 3 + j] = turned_inverse[i, j]


@kernel
def solve_free_turning(time_step: ti.f64, theta: ti.f64, bodies: RigidBodies, rigid: RigidState):
    """Free angular velocities with the gyroscopic torque at (1 - theta) w0 + theta w, in world axes at the step's end.

    `solve_free_motion` is of first order: it makes one Newton step, and leaves w in the axes of the start. With theta
    0.5 the torque does no work, and the axes are where the step will turn them, along (1 - theta) w0 + theta w.
    """
    ti.loop_config(serialize=True)
    for b in range(bodies.mass.shape[0]):
        to_world, inertia = rigid.rotation[b], bodies.inertia[b]
        before = to_world.transpose() @ rigid.angular[b]
        after, between, free = before, before, rigid.angular[b]
        for _ in range(MOST_ITERATIONS):
            momentum = inertia @ between
            missing = inertia @ (after - before) + time_step * between.cross(momentum)
            jacobian = inertia + theta * time_step * (skew(between) @ inertia - skew(momentum))
            after -= jacobian.inverse() @ missing
            between = (1.0 - theta) * before + theta * after
            turn = time_step * ((1.0 - theta) * rigid.angular[b] + theta * free)
            free = rotation_of_vector(turn) @ (to_world @ after)
        for i in ti.static(range(3)):
            rigid.free[b, 3 + i] = free[i]


@kernel
def apply_impulses(rigid: RigidState):
    """Velocities after the impulses, from those without."""
    ti.loop_config(serialize=True)
    for b in range(rigid.linear.shape[0]):
        total = ti.Vector.zero(ti.f64, 6)
        for i in ti.static(range(6)):
            total[i] = rigid.free[b, i]
            for j in range(6):
                total[i] += rigid.inverse_mass[b, i, j] * rigid.impulse[b, j]
        rigid.linear[b] = vec3(total[0], total[1], total[2])
        rigid.angular[b] = vec3(total[3], total[4], total[5])


@kernel
def integrate(time_step: ti.f64, rigid: RigidState):
    """Poses after a step with the velocities: the exponential map, normalised."""
    ti.loop_config(serialize=True)
    for b in range(rigid.position.shape[0]):
        turning = rigid.angular[b]
        rigid.position[b] = rigid.position[b] + time_step * rigid.linear[b]
        half = 0.5 * time_step * turning.norm()
        sine_part = 1.0
        if half > 1e-8:
            sine_part = ti.sin(half) / half
        v = 0.5 * sine_part * time_step * turning
        scalar = ti.cos(half)
        w, u = rigid.quaternion[b, 0], vec3(rigid.quaternion[b, 1], rigid.quaternion[b, 2], rigid.quaternion[b, 3])
        turned = scalar * u + w * v + v.cross(u)
        real = scalar * w - v.dot(u)
        scale = 1.0 / ti.sqrt(real * real + turned.norm_sqr())
        rigid.quaternion[b, 0] = scale * real
        for i in ti.static(range(3)):
            rigid.quaternion[b, 1 + i] = scale * turned[i]
