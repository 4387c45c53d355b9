"""Loads on the nodes of soft bodies: the anchors' springs, the pressures in cavities and the tensions of cables."""

from typing import NamedTuple

from taichisoft.kernels.actuators import Coordinates, Gradient
from taichisoft.kernels.launch import kernel
from taichisoft.kernels.runtime import Integers, Matrices, Scalars, Vectors, ti


class Anchors(NamedTuple):
    """Springs that hold nodes at the base.

    Attributes:
        node: the anchored nodes, shape (anchor_count,).
        stiffness: along x, y and z [mN/mm], shape (node_count, 3).
        lag: h + b [s], 0 in first order dynamics, shape (node_count,).
        position: where they are held before the base moves them [mm], shape (anchor_count, 3).
    """

    node: Integers
    stiffness: Vectors
    lag: Scalars
    position: Vectors


class Base(NamedTuple):
    """Where the base is.

    Attributes:
        place: pivot and translation [mm], shape (2, 3).
        turn: rotation about the pivot, shape (1, 3, 3).
    """

    place: Vectors
    turn: Matrices


@kernel
def add_anchors_and_actuators(
    anchors: Anchors,
    base: Base,
    position: Vectors,
    velocity: Vectors,
    coordinates: Coordinates,
    gradient: Gradient,
    effort: Scalars,
    force: Vectors,
):
    """Add -k (x + lag v - target) of the anchored nodes, and the efforts times their gradients, to the forces.

    The targets are the anchors' positions turned and moved with the base. An effort is a pressure [kPa] or a tension
    [mN].
    """
    ti.loop_config(serialize=True)
    for k in range(anchors.node.shape[0]):
        i = anchors.node[k]
        target = base.turn[0] @ (anchors.position[k] - base.place[0]) + base.place[0] + base.place[1]
        force[i] -= anchors.stiffness[i] * (position[i] - target + anchors.lag[i] * velocity[i])
    ti.loop_config(serialize=True)
    for coordinate in range(effort.shape[0]):
        if effort[coordinate] != 0.0:
            for k in range(coordinates.entry_start[coordinate], coordinates.entry_start[coordinate + 1]):
                force[coordinates.entry_node[k]] += effort[coordinate] * gradient.soft[k]
