"""Loads on the nodes of soft bodies: constant forces, springs of anchors, pressures in cavities, tensions of cables."""

from typing import NamedTuple

from taichisoft.actuators.kernels.coordinate_gradients import Coordinates, Gradient
from taichisoft.runtime.language import Integers, Matrices, Scalars, Vectors, ti
from taichisoft.runtime.launch import kernel


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
