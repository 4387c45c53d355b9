"""Vertices of contact surfaces that follow their bodies."""

from typing import NamedTuple

from taichisoft.kernels.launch import kernel
from taichisoft.kernels.runtime import SOFT, Integers, IntegerTable, Matrices, ScalarTable, Vectors, ti, vec3


class Carriers(NamedTuple):
    """What each vertex follows."""

    owner: Integers
    local: Vectors
    nodes: IntegerTable
    weights: ScalarTable


@kernel
def move_vertices(
    owner: Integers,
    local: Vectors,
    nodes: IntegerTable,
    weights: ScalarTable,
    node_position: Vectors,
    rigid_position: Vectors,
    rigid_rotation: Matrices,
    position: Vectors,
):
    """Vertices of soft bodies (owner SOFT) follow their nodes, those of rigid bodies their pose."""
    ti.loop_config(serialize=True)
    for v in range(owner.shape[0]):
        if owner[v] == SOFT:
            moved = vec3(0.0)
            for k in range(nodes.shape[1]):
                moved += weights[v, k] * node_position[nodes[v, k]]
            position[v] = moved
        elif owner[v] >= 0:
            position[v] = rigid_rotation[owner[v]] @ local[v] + rigid_position[owner[v]]
