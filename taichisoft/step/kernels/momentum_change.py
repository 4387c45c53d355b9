"""What loads leave of the change of momentum of soft bodies in a step, and its torque."""

from typing import NamedTuple

from taichisoft.runtime.language import Integers, Scalars, ScalarTable, Vectors, ti, vec3
from taichisoft.runtime.launch import kernel


class HeldBodies(NamedTuple):
    """Soft bodies with anchors, and loads and motion of all nodes in a step.

    Attributes:
        nodes: first and last + 1 node of each body, one after the other, shape (2 body_count,).
        mass: masses [kg], shape (node_count,).
        drag: force that resists the velocity, over the mass [1/s], shape (node_count,).
        constant: constant forces [mN], shape (node_count, 3).
        gravity: acceleration of gravity [mm/s^2], shape (1, 3).
        impulse: impulses of contacts [mN s], shape (node_count, 3).
        before, after: velocities before the step and after it [mm/s], shape (node_count, 3).
        place: positions at its end [mm], shape (node_count, 3).
        wrench: force [mN], and torque about the origin [mN mm], shape (body_count, 6).
    """

    nodes: Integers
    mass: Scalars
    drag: Scalars
    constant: Vectors
    gravity: Vectors
    impulse: Vectors
    before: Vectors
    after: Vectors
    place: Vectors
    wrench: ScalarTable


@kernel
def sum_wrenches(time_step: ti.f64, inertia: ti.f64, bodies: HeldBodies):
    """Sum what the loads leave of the change of momentum, m (v - v0) / h times `inertia` (0 without), of each body."""
    ti.loop_config(serialize=True)
    for b in range(bodies.wrench.shape[0]):
        force, torque = vec3(0.0), vec3(0.0)
        for i in range(bodies.nodes[2 * b], bodies.nodes[2 * b + 1]):
            rate = inertia / time_step * (bodies.after[i] - bodies.before[i]) + bodies.drag[i] * bodies.after[i]
            own = bodies.constant[i] + bodies.impulse[i] / time_step + bodies.mass[i] * (bodies.gravity[0] - rate)
            force += own
            torque += bodies.place[i].cross(own)
        for k in ti.static(range(3)):
            bodies.wrench[b, k] = force[k]
            bodies.wrench[b, 3 + k] = torque[k]
