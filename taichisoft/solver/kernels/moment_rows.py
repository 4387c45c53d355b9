"""Rows of moments: resistance of two rigid bodies in contact to spinning and rolling on each other.

A contact has three such rows: the relative angular velocities about its normal and its two tangents. Their impulses l
obey Coulomb's law with lengths as coefficients (Leine and Glocker 2003, A set-valued force law for spatial
Coulomb-Contensou friction; Acary and Bourrier 2021, Coulomb friction with rolling resistance as a cone complementarity
problem): |l_n| <= b_s p and |l_t| <= b_r p, where p is the contact's normal impulse; in case of equality l opposes the
rotation.
"""

from taichisoft.actuators.kernels.coordinate_gradients import Coordinates, Gradient
from taichisoft.bodies.kernels.rigid_integration import RigidState
from taichisoft.runtime.language import Scalars, func, ti, vec3
from taichisoft.runtime.launch import kernel
from taichisoft.solver.kernels.row_velocities import ACTUATORS, CONTACTS, MOMENTS, Rows


@func
def axis(m: ti.i32, i: ti.i32, side: ti.i32, rows: Rows) -> vec3:
    """Signed axis about which row i of moment m acts on the body on this side."""
    c, sign = rows.moment_contact[m], 2.0 * side - 1.0
    return sign * vec3(rows.basis[c][i, 0], rows.basis[c][i, 1], rows.basis[c][i, 2])


@func
def turned_by(body: ti.i32, moment: vec3, rigid: RigidState) -> vec3:
    """Change of a body's angular velocity [rad/s] by an angular impulse [mN s mm]."""
    change = vec3(0.0)
    for i, j in ti.static(ti.ndrange(3, 3)):
        change[i] += rigid.inverse_mass[body, 3 + i, 3 + j] * moment[j]
    return change


@kernel
def free_moment_velocity(rows: Rows, rigid: RigidState):
    """Fill in `rows.free` of the moments: angular velocities of the second body relative to the first [rad/s]."""
    ti.loop_config(serialize=True)
    for m in range(rows.size[MOMENTS]):
        for i in range(3):
            total = 0.0
            for side in range(2):
                body = rows.rigid[rows.moment_contact[m], side]
                if body >= 0:
                    direction = axis(m, i, side, rows)
                    for d in ti.static(range(3)):
                        total += direction[d] * rigid.free[body, 3 + d]
            rows.free[3 * rows.size[CONTACTS] + rows.size[ACTUATORS] + 3 * m + i] = total


@kernel
def add_moment_compliance(
    row_count: ti.i32, rows: Rows, coordinates: Coordinates, gradient: Gradient, rigid: RigidState, w: Scalars
):
    """Add the coupling of the moments with themselves, with contacts and with actuators to W, stored by rows."""
    ti.loop_config(serialize=True)
    for m in range(rows.size[MOMENTS]):
        first_actuator = 3 * rows.size[CONTACTS]
        first = first_actuator + rows.size[ACTUATORS]
        for i in range(3):
            r = first + 3 * m + i
            for side in range(2):
                body = rows.rigid[rows.moment_contact[m], side]
                if body >= 0:
                    change = turned_by(body, axis(m, i, side, rows), rigid)
                    for q in range(first_actuator):
                        for other in range(2):
                            if rows.rigid[q // 3, other] == body:
                                gain = 0.0
                                for d in ti.static(range(3)):
                                    gain += change[d] * rows.rigid_jacobian[q, other, 3 + d]
                                w[r * row_count + q] = w[r * row_count + q] + gain
                                w[q * row_count + r] = w[q * row_count + r] + gain
                    for a in range(rows.size[ACTUATORS]):
                        q, coordinate = first_actuator + a, rows.coordinate[a]
                        for k in range(coordinates.rigid_start[coordinate], coordinates.rigid_start[coordinate + 1]):
                            if coordinates.rigid_body[k] == body:
                                gain = 0.0
                                for d in ti.static(range(3)):
                                    gain += change[d] * gradient.rigid[k, 3 + d]
                                w[r * row_count + q] = w[r * row_count + q] + gain
                                w[q * row_count + r] = w[q * row_count + r] + gain
                    for n in range(rows.size[MOMENTS]):
                        for other in range(2):
                            if rows.rigid[rows.moment_contact[n], other] == body:
                                for j in range(3):
                                    q = first + 3 * n + j
                                    gain = change.dot(axis(n, j, other, rows))
                                    w[r * row_count + q] = w[r * row_count + q] + gain


@kernel
def apply_moments(rows: Rows, impulse: Scalars, rigid: RigidState):
    """Add the impulses of the moments to the impulses on the rigid bodies."""
    ti.loop_config(serialize=True)
    for m in range(rows.size[MOMENTS]):
        for i in range(3):
            own = impulse[3 * rows.size[CONTACTS] + rows.size[ACTUATORS] + 3 * m + i]
            for side in range(2):
                body = rows.rigid[rows.moment_contact[m], side]
                if body >= 0:
                    direction = axis(m, i, side, rows)
                    for d in ti.static(range(3)):
                        rigid.impulse[body, 3 + d] = rigid.impulse[body, 3 + d] + own * direction[d]
