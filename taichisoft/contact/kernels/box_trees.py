"""Trees of boxes over the triangles of every surface: update of the boxes, and search for boxes nearby."""

from typing import NamedTuple

from taichisoft.contact.kernels.contacts import Contacts, MovedSurfaces, PoseArrays, Trees
from taichisoft.mechanics.kernels.rigid_integration import RigidState
from taichisoft.runtime.arithmetic import rotation_of_vector
from taichisoft.runtime.language import Integers, IntegerTable, Scalars, ScalarTable, Vectors, func, ti, vec3
from taichisoft.runtime.launch import kernel

# Approach of the bodies within a step, and the positions of their surfaces ahead.

# Larger than any distance of two bodies; stands for infinity in kernels.
FAR = 1e30


class NodeMotion(NamedTuple):
    """Soft bodies at the start of a step.

    Attributes:
        body_start: first node of each body, then the number of nodes, shape (soft_count + 1,).
        position: of the nodes [mm], shape (node_count, 3).
        velocity: of the nodes [mm/s], shape (node_count, 3).
    """

    body_start: Integers
    position: Vectors
    velocity: Vectors


class BodyPairs(NamedTuple):
    """Approach and reach of each two bodies in a step; tables are of shape (body_count, body_count).

    Attributes:
        may_touch, may_pass_through: see `ContactSurfaces`, 0 or 1.
        least_reach: lower bound of `reach` [mm].
        rigid_radius: radius of the bounding ball around the centre of mass of a rigid body [mm], shape (rigid_count,).
        centre, radius: bounding ball of the velocities of each body's points [mm/s], shapes (body_count, 3) and
            (body_count,).
        bend: bound of the distance of a rigid body's points from where straight ways lead in the step [mm], shape
            (body_count,).
        approach: upper bound of the approach of two bodies in the step [mm].
        reach: largest distance of contacts to search for [mm], negative if the bodies cannot touch.
        nearest: distance of the closest contact found [mm], FAR without a contact.
        count: pairs of bodies that could pass through each other (FAST), contacts found too close (TOO_CLOSE), (2,).
    """

    may_touch: IntegerTable
    may_pass_through: IntegerTable
    least_reach: ScalarTable
    rigid_radius: Scalars
    centre: Vectors
    radius: Scalars
    bend: Scalars
    approach: ScalarTable
    reach: ScalarTable
    nearest: ScalarTable
    count: Integers


# Entries of `BodyPairs.count`.
FAST, TOO_CLOSE = range(2)


@func
def bound_approach(time_step: ti.f64, soft: NodeMotion, rigid: RigidState, pairs: BodyPairs):
    """Fill in the balls of velocities, the bends, and the approach of each two bodies."""
    soft_count, rigid_count = soft.body_start.shape[0] - 1, rigid.position.shape[0]
    for body in range(soft_count):
        low = soft.velocity[soft.body_start[body]]
        high = low
        for node in range(soft.body_start[body], soft.body_start[body + 1]):
            low = ti.min(low, soft.velocity[node])
            high = ti.max(high, soft.velocity[node])
        pairs.centre[body] = 0.5 * (low + high)
        pairs.radius[body] = 0.5 * (high - low).norm()
        pairs.bend[body] = 0.0
    for body in range(rigid_count):
        pairs.centre[soft_count + body] = rigid.linear[body]
        pairs.bend[soft_count + body] = time_step**2 * rigid.angular[body].norm_sqr() * pairs.rigid_radius[body]
        pairs.radius[soft_count + body] = rigid.angular[body].norm() * pairs.rigid_radius[body]
    for first in range(pairs.radius.shape[0]):
        for second in range(pairs.radius.shape[0]):
            apart = (pairs.centre[first] - pairs.centre[second]).norm()
            pairs.approach[first, second] = time_step * (apart + pairs.radius[first] + pairs.radius[second])


@kernel
def measure_approach(time_step: ti.f64, soft: NodeMotion, rigid: RigidState, pairs: BodyPairs):
    """Fill in the approach of each two bodies with these velocities."""
    ti.loop_config(serialize=True)
    for _ in range(1):
        bound_approach(time_step, soft, rigid, pairs)


@kernel
def look_ahead(
    time_step: ti.f64, contact_distance: ti.f64, falls: ti.f64, soft: NodeMotion, rigid: RigidState, pairs: BodyPairs
):
    """Fill in the approach of each two bodies, their reach if none can pass through another, and `count[FAST]`.

    The velocities of a soft body are bounded by the ball around their bounding box. `falls` is the distance that
    gravity adds to the motion in a step [mm].
    """
    ti.loop_config(serialize=True)
    for _ in range(1):
        bound_approach(time_step, soft, rigid, pairs)
        pairs.count[FAST] = 0
        for first in range(pairs.radius.shape[0]):
            for second in range(pairs.radius.shape[0]):
                pairs.reach[first, second] = -1.0
                if pairs.may_touch[first, second] != 0:
                    reach = contact_distance + falls + pairs.bend[first] + pairs.bend[second]
                    pairs.reach[first, second] = ti.max(reach, pairs.least_reach[first, second])
                may_pass = pairs.may_pass_through[first, second] != 0
                if may_pass and pairs.approach[first, second] > contact_distance:
                    pairs.count[FAST] = pairs.count[FAST] + 1


@kernel
def move_bodies(passed: ti.f64, soft: NodeMotion, rigid: RigidState, poses: PoseArrays):
    """Move the bodies from the start of the step by a time `passed` [s] at constant velocities."""
    ti.loop_config(serialize=True)
    for node in range(soft.position.shape[0]):
        poses.node_position[node] = soft.position[node] + passed * soft.velocity[node]
    ti.loop_config(serialize=True)
    for body in range(rigid.position.shape[0]):
        poses.rigid_position[body] = rigid.position[body] + passed * rigid.linear[body]
        poses.rigid_rotation[body] = rotation_of_vector(passed * rigid.angular[body]) @ rigid.rotation[body]


@kernel
def measure_nearest(contacts: Contacts, contact_distance: ti.f64, tolerance: ScalarTable, pairs: BodyPairs):
    """Fill in the least distance of each two bodies by the contacts found, and count the contacts that are too close.

    A contact is too close if it is nearer than the contact distance less the tolerance of its bodies [mm].
    """
    ti.loop_config(serialize=True)
    for _ in range(1):
        for first in range(pairs.nearest.shape[0]):
            for second in range(pairs.nearest.shape[1]):
                pairs.nearest[first, second] = FAR
        pairs.count[TOO_CLOSE] = 0
        for c in range(contacts.count[0]):
            first, second = contacts.bodies[c, 0], contacts.bodies[c, 1]
            nearest = ti.min(pairs.nearest[first, second], contacts.distance[c])
            pairs.nearest[first, second] = nearest
            pairs.nearest[second, first] = nearest
            if contacts.distance[c] < contact_distance - tolerance[first, second]:
                pairs.count[TOO_CLOSE] = pairs.count[TOO_CLOSE] + 1


@kernel
def refit(surfaces: Integers, trees: Trees, moved: MovedSurfaces):
    """Update the boxes of `surfaces`: a leaf's box contains its corners, an inner node's box its children."""
    ti.loop_config(serialize=True)
    for k in range(surfaces.shape[0]):
        first, behind = trees.root[surfaces[k]], trees.root[surfaces[k] + 1]
        for backwards in range(behind - first):
            node = behind - 1 - backwards  # children come after their parents
            if trees.escape[node] == node + 1:
                low = moved.position[trees.corner[trees.corner_start[node]]]
                high = low
                for c in range(trees.corner_start[node] + 1, trees.corner_start[node + 1]):
                    p = moved.position[trees.corner[c]]
                    low = ti.min(low, p)
                    high = ti.max(high, p)
                moved.lower[node] = low
                moved.upper[node] = high
            else:
                second = trees.escape[node + 1]
                moved.lower[node] = ti.min(moved.lower[node + 1], moved.lower[second])
                moved.upper[node] = ti.max(moved.upper[node + 1], moved.upper[second])


@func
def meets(node: ti.i32, low: vec3, high: vec3, moved: MovedSurfaces) -> ti.i32:
    """Whether a node's box intersects the box from `low` to `high` [mm]."""
    return (moved.lower[node] <= high).all() and (moved.upper[node] >= low).all()


@func
def meets_beam(node: ti.i32, start: vec3, axis: vec3, radius: ti.f64, moved: MovedSurfaces) -> ti.i32:
    """Whether the ball around a node's box is within `radius` [mm] of the line through `start` along `axis`."""
    away = 0.5 * (moved.lower[node] + moved.upper[node]) - start
    across = away - away.dot(axis) * axis
    largest = radius + 0.5 * (moved.upper[node] - moved.lower[node]).norm()
    return across.norm_sqr() <= largest * largest


@func
def squared_distance(node: ti.i32, p: vec3, moved: MovedSurfaces) -> ti.f64:
    """Squared distance of a point from a node's box [mm^2]."""
    return ti.max(moved.lower[node] - p, p - moved.upper[node], 0.0).norm_sqr()


@func
def find_leaves(surface: ti.i32, low: vec3, high: vec3, trees: Trees, moved: MovedSurfaces, leaves: Integers) -> ti.i32:
    """Write the leaves of a surface that intersect the box from `low` to `high` to `leaves`; returns their number."""
    count = 0
    node = trees.root[surface]
    behind = trees.root[surface + 1]
    while node < behind:
        if meets(node, low, high, moved):
            if trees.escape[node] == node + 1:
                leaves[count] = node
                count += 1
            node += 1
        else:
            node = trees.escape[node]
    return count
