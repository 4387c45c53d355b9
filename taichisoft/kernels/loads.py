"""Loads on the nodes of soft bodies: the anchors' springs and the pressures in the cavities."""

from typing import NamedTuple

from taichisoft.kernels.cavities import CavitySurfaces
from taichisoft.kernels.launch import kernel
from taichisoft.kernels.runtime import Integers, Matrices, Scalars, Vectors, ti


class Anchors(NamedTuple):
    """Springs that hold nodes at the base.

    Attributes:
        node: the anchored nodes, shape (anchor_count,).
        stiffness: [mN/mm], shape (node_count,).
        lag: h + b [s], 0 in first order dynamics, shape (node_count,).
        position: where they are held before the base moves them [mm], shape (anchor_count, 3).
    """

    node: Integers
    stiffness: Scalars
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
def add_anchors_and_pressures(
    anchors: Anchors,
    base: Base,
    position: Vectors,
    velocity: Vectors,
    cavities: CavitySurfaces,
    cavity_gradient: Vectors,
    pressure: Scalars,
    force: Vectors,
):
    """Add -k (x + lag v - target) of the anchored nodes and p dV/dx to the forces.

    The targets are the anchors' positions turned and moved with the base.
    """
    ti.loop_config(serialize=True)
    for k in range(anchors.node.shape[0]):
        i = anchors.node[k]
        target = base.turn[0] @ (anchors.position[k] - base.place[0]) + base.place[0] + base.place[1]
        force[i] -= anchors.stiffness[i] * (position[i] - target + anchors.lag[i] * velocity[i])
    ti.loop_config(serialize=True)
    for cavity in range(pressure.shape[0]):
        if pressure[cavity] != 0.0:
            for k in range(cavities.entry_start[cavity], cavities.entry_start[cavity + 1]):
                force[cavities.entry_node[k]] += pressure[cavity] * cavity_gradient[k]
