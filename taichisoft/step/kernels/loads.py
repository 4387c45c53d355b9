"""Loads on the nodes of soft bodies: constant forces, springs of anchors, pressures in cavities, tensions of cables."""

from typing import NamedTuple

from taichisoft.mechanics.kernels.actuator_coordinates import Coordinates, Gradient
from taichisoft.mechanics.kernels.domain_deformation import Domains
from taichisoft.runtime.language import Integers, IntegerTable, Matrices, Scalars, ScalarTable, Vectors, ti, vec3
from taichisoft.runtime.launch import kernel

# Signs of a diverged step: leaps of nodes, and inverted elements.

# Integration points of a quadratic element.
POINTS = 4


class Points(NamedTuple):
    """Points of all bodies of a kind, before and after a step.

    Attributes:
        before: positions before the step [mm], shape (point_count, 3).
        velocity: velocities before the step [mm/s], shape (point_count, 3).
        after: positions after the step [mm], shape (point_count, 3).
        body_start: first point of each body, then the number of points, shape (body_count + 1,).
        largest: largest leap of a point of each body [mm], shape (body_count,).
    """

    before: Vectors
    velocity: Vectors
    after: Vectors
    body_start: Integers
    largest: Scalars


class InvertedElements(NamedTuple):
    """Elements of all soft bodies, and the number of inverted ones.

    Attributes:
        elements: corners, shape (element_count, 4).
        first_point: first of the POINTS integration domains of a quadratic element; -1 for others, which are checked by
            their corners, shape (element_count,).
        body_start: first element of each body, then the number of elements, shape (body_count + 1,).
        count: number of inverted elements of each body, shape (body_count,).
    """

    elements: IntegerTable
    first_point: Integers
    body_start: Integers
    count: Integers


@kernel
def largest_leaps(time_step: ti.f64, points: Points):
    """Fill in `largest`: move of a point, or its distance from the position by its velocity, whichever is less."""
    ti.loop_config(serialize=True)
    for body in range(points.largest.shape[0]):
        most = 0.0
        for i in range(points.body_start[body], points.body_start[body + 1]):
            move = points.after[i] - points.before[i]
            surprise = move - time_step * points.velocity[i]
            for d in ti.static(range(3)):
                most = ti.max(most, ti.min(ti.abs(move[d]), ti.abs(surprise[d])))
        points.largest[body] = most


@kernel
def count_inverted(inverted: InvertedElements, domains: Domains, position: Vectors):
    """Count the elements of each body without positive volume, at their corners or at an integration point."""
    ti.loop_config(serialize=True)
    for body in range(inverted.count.shape[0]):
        count = 0
        for e in range(inverted.body_start[body], inverted.body_start[body + 1]):
            origin = position[inverted.elements[e, 0]]
            first, second = position[inverted.elements[e, 1]] - origin, position[inverted.elements[e, 2]] - origin
            least = first.cross(second).dot(position[inverted.elements[e, 3]] - origin)
            if inverted.first_point[e] >= 0:
                for d in range(inverted.first_point[e], inverted.first_point[e] + POINTS):
                    deformation = ti.Matrix.zero(ti.f64, 3, 3)
                    for c in range(domains.start[d], domains.start[d + 1]):
                        deformation += (position[domains.node[c]] - origin).outer_product(domains.gradient[c])
                    least = ti.min(least, deformation.determinant())
            if least <= 0.0:
                count += 1
        inverted.count[body] = count


# What loads leave of the change of momentum of soft bodies in a step, and its torque.


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


class Anchors(NamedTuple):
    """Springs that hold nodes at frames.

    Attributes:
        node: the anchored nodes, shape (anchor_count,).
        frame: number of the frame that each moves with, shape (anchor_count,).
        stiffness: stiffness along x, y and z [mN/mm], shape (node_count, 3).
        lag: time by which positions are extrapolated along the velocities [s]: h from the start of a step, 0 from its
            end, plus b with damping; 0 in overdamped dynamics; shape (node_count,).
        position: rest positions of the springs, before the frames move them [mm], shape (anchor_count, 3).
    """

    node: Integers
    frame: Integers
    stiffness: Vectors
    lag: Scalars
    position: Vectors


class ConstantForces(NamedTuple):
    """Constant forces on nodes.

    Attributes:
        node: the nodes, shape (force_count,).
        force: force on each [mN], shape (force_count, 3).
    """

    node: Integers
    force: Vectors


class Frames(NamedTuple):
    """Where the frames are that anchors move with: what was at x at rest is at turn @ x + shift.

    Attributes:
        turn: rotation matrices, shape (frame_count, 3, 3).
        shift: shifts [mm], shape (frame_count, 3).
    """

    turn: Matrices
    shift: Vectors


class Nodes(NamedTuple):
    """Loads, positions and velocities of all nodes.

    Attributes:
        loaded: nodes on which anything may act; of reduced bodies, whose weight and drag act on their amplitudes, those
            with anchors and actuators, shape (loaded_count,).
        mass: masses [kg], 0 of reduced bodies, shape (node_count,).
        drag: coefficients of Rayleigh damping by mass [kg/s], 0 of reduced bodies, shape (node_count,).
        gravity: acceleration of gravity [mm/s^2], shape (1, 3).
        position: positions [mm], shape (node_count, 3).
        velocity: velocities [mm/s], shape (node_count, 3).
        elastic: forces of the elements [mN], shape (node_count, 3).
        impulse: impulses of all forces in a step [mN s], shape (node_count, 3).
    """

    loaded: Integers
    mass: Scalars
    drag: Scalars
    gravity: Vectors
    position: Vectors
    velocity: Vectors
    elastic: Vectors
    impulse: Vectors


@kernel
def sum_impulses(
    time_step: ti.f64,
    nodes: Nodes,
    forces: ConstantForces,
    anchors: Anchors,
    frames: Frames,
    coordinates: Coordinates,
    gradient: Gradient,
    effort: Scalars,
):
    """Sum the impulses on the nodes in a step: weight, drag, elements, constant forces, anchors and actuators.

    The force of an anchor is -k (x + lag v - target), with the anchor's position moved with its frame as the target. An
    effort, a pressure [kPa] or a tension [mN], acts along the gradient of its coordinate.
    """
    force = ti.static(nodes.impulse)
    ti.loop_config(serialize=True)
    for k in range(nodes.loaded.shape[0]):
        i = nodes.loaded[k]
        force[i] = nodes.mass[i] * nodes.gravity[0] - nodes.drag[i] * nodes.velocity[i] + nodes.elastic[i]
    ti.loop_config(serialize=True)
    for k in range(forces.node.shape[0]):
        force[forces.node[k]] += forces.force[k]
    ti.loop_config(serialize=True)
    for k in range(anchors.node.shape[0]):
        i = anchors.node[k]
        target = frames.turn[anchors.frame[k]] @ anchors.position[k] + frames.shift[anchors.frame[k]]
        away = nodes.position[i] - target + anchors.lag[i] * nodes.velocity[i]
        force[i] = force[i] - anchors.stiffness[i] * away  # in place Taichi would make it an atomic operation
    ti.loop_config(serialize=True)
    for coordinate in range(effort.shape[0]):
        if effort[coordinate] != 0.0:
            for k in range(coordinates.entry_start[coordinate], coordinates.entry_start[coordinate + 1]):
                i = coordinates.entry_node[k]
                force[i] = force[i] + effort[coordinate] * gradient.soft[k]
    ti.loop_config(serialize=True)
    for k in range(nodes.loaded.shape[0]):
        i = nodes.loaded[k]
        force[i] = time_step * force[i]
