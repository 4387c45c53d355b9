"""Modes: from motions and forces of nodes to amplitudes, and back.

A reduced body moves in the frame of its mesh, which the base carries along: x = c + T (X + Phi q), with T the frame's
axes. The modes are orthonormal in the mass, so that of all amplitudes q = Phi^T M T^T (x - c - T X) are nearest to x.
"""

from typing import NamedTuple

from taichisoft.runtime.launch import func, kernel
from taichisoft.runtime.taichi_start import Integers, Matrices, Scalars, Vectors, ti, vec3
from taichisoft.runtime.tiles import SHIFT, TILE, Column, Columns, advance, opaque


class ModeShapes(NamedTuple):
    """Modes of the reduced bodies; the unknowns of a body are threes of amplitudes in the places of its first nodes.

    Attributes:
        start: where the modes of a node begin in `shape`, -1 for nodes that are unknowns themselves, (node_count,).
        body: number among the reduced bodies of each node, shape (node_count,).
        shape: eight modes at a time of a node along x, then y, then z; padded with zeros; bodies that are copies share
            them.
        tiles: columns of eight modes of each body, shape (body_count,).
        first_node: of each body, where its amplitudes have their places, and the end, shape (body_count, 2), flat.
        threes: of amplitudes of each body, shape (body_count,).
        axes: of each body's frame as columns, shape (body_count, 3, 3).
        origin: of each body's frame [mm], shape (body_count, 3).
    """

    start: Integers
    body: Integers
    shape: Columns
    tiles: Integers
    first_node: Integers
    threes: Integers
    axes: Matrices
    origin: Vectors


class Amplitudes(NamedTuple):
    """Amplitudes of the reduced bodies in a step, those of each body in columns of eight.

    Attributes:
        start: of each body, shape (body_count + 1,).
        position: amplitudes of the positions, shape (column_count, 8).
        velocity: of the velocities, likewise.
        total: work space, likewise.
        moment: Phi^T M along x, y and z of each body's frame, three times as many columns.
        drag: Rayleigh's factor a of each body [1/s], shape (body_count,).
        gravity: acceleration of gravity [mm/s^2], shape (1, 3).
    """

    start: Integers
    position: Columns
    velocity: Columns
    total: Columns
    moment: Columns
    drag: Scalars
    gravity: Vectors


class FrameMotion(NamedTuple):
    """Motion of the nodes in the frames of their bodies.

    Attributes:
        rest: rest positions in the frame of the mesh [mm], shape (node_count, 3).
        mass: [kg], shape (node_count,).
        displacement: [mm], shape (node_count, 3).
    """

    rest: Vectors
    mass: Scalars
    displacement: Vectors


@func
def project(b: ti.i32, i: ti.i32, vector: vec3, modes: ModeShapes, start: ti.i32, total: Columns, one: ti.i32):
    """Add Phi^T of a vector at a node, in the frame of its body, to amplitudes."""
    tiles, t = modes.tiles[b], 0
    along_x = opaque(modes.start[i], one)
    along_y, along_z, first = opaque(along_x + tiles, one), opaque(along_x + 2 * tiles, one), opaque(start, one)
    while t < tiles:
        total[first + t] = (
            total[first + t]
            + vector[0] * modes.shape[along_x + t]
            + vector[1] * modes.shape[along_y + t]
            + vector[2] * modes.shape[along_z + t]
        )
        t = advance(t, 1, one)


@func
def expand(b: ti.i32, i: ti.i32, modes: ModeShapes, start: ti.i32, amplitude: Columns, one: ti.i32) -> vec3:
    """Phi times amplitudes at a node, in the frame of its body."""
    tiles, t = modes.tiles[b], 0
    along_x = opaque(modes.start[i], one)
    along_y, along_z, first = opaque(along_x + tiles, one), opaque(along_x + 2 * tiles, one), opaque(start, one)
    x, y, z = Column(0.0), Column(0.0), Column(0.0)
    while t < tiles:
        values = amplitude[first + t]
        x += modes.shape[along_x + t] * values
        y += modes.shape[along_y + t] * values
        z += modes.shape[along_z + t] * values
        t = advance(t, 1, one)
    return vec3(x.sum(), y.sum(), z.sum())


@kernel
def find_amplitudes(
    modes: ModeShapes, nodes: FrameMotion, position: Vectors, velocity: Vectors, amplitudes: Amplitudes, one: ti.i32
):
    """The amplitudes nearest to positions and velocities, and the displacements in the bodies' frames."""
    ti.loop_config(serialize=True)
    for b in range(modes.tiles.shape[0]):
        start, inverse = amplitudes.start[b], modes.axes[b].transpose()
        for t in range(start, amplitudes.start[b + 1]):
            amplitudes.position[t] = Column(0.0)
            amplitudes.velocity[t] = Column(0.0)
        for i in range(modes.first_node[2 * b], modes.first_node[2 * b + 1]):
            displacement = inverse @ (position[i] - modes.origin[b]) - nodes.rest[i]
            nodes.displacement[i] = displacement
            project(b, i, nodes.mass[i] * displacement, modes, start, amplitudes.position, one)
            project(b, i, nodes.mass[i] * (inverse @ velocity[i]), modes, start, amplitudes.velocity, one)


@kernel
def find_reference(
    time_step: ti.f64,
    inertia: ti.f64,
    modes: ModeShapes,
    nodes: FrameMotion,
    amplitudes: Amplitudes,
    velocity: Vectors,
    one: ti.i32,
):
    """The velocities nearest to the present ones that lead to positions by modes: (Phi q - u) / h + Phi w, with the
    amplitudes q and w of displacements u and velocities, the latter times `inertia`, 0 in overdamped dynamics."""
    ti.loop_config(serialize=True)
    for b in range(modes.tiles.shape[0]):
        start = amplitudes.start[b]
        for t in range(start, amplitudes.start[b + 1]):
            amplitudes.velocity[t] = inertia * amplitudes.velocity[t]
            amplitudes.total[t] = amplitudes.position[t] / time_step + amplitudes.velocity[t]
        for i in range(modes.first_node[2 * b], modes.first_node[2 * b + 1]):
            local = expand(b, i, modes, start, amplitudes.total, one) - nodes.displacement[i] / time_step
            velocity[i] = modes.axes[b] @ local


@kernel
def project_impulses(
    time_step: ti.f64,
    modes: ModeShapes,
    loaded: Integers,
    impulse: Vectors,
    elastic: Columns,
    amplitudes: Amplitudes,
    unknown: Vectors,
    one: ti.i32,
):
    """Impulses on the unknowns by impulses on nodes, and in a step by elastic forces, weight and drag."""
    ti.loop_config(serialize=True)
    for b in range(modes.tiles.shape[0]):
        start, tiles, weight = amplitudes.start[b], modes.tiles[b], modes.axes[b].transpose() @ amplitudes.gravity[0]
        for t in range(tiles):
            force = elastic[start + t] - amplitudes.drag[b] * amplitudes.velocity[start + t]
            for d in ti.static(range(3)):
                force += weight[d] * amplitudes.moment[3 * start + d * tiles + t]
            amplitudes.total[start + t] = time_step * force
    ti.loop_config(serialize=True)
    for n in range(loaded.shape[0]):
        i = loaded[n]
        if modes.start[i] >= 0:
            b = modes.body[i]
            inverse = modes.axes[b].transpose()
            project(b, i, inverse @ impulse[i], modes, amplitudes.start[b], amplitudes.total, one)
    ti.loop_config(serialize=True)
    for b in range(modes.tiles.shape[0]):
        start = amplitudes.start[b]
        for j in range(modes.threes[b]):
            for d in ti.static(range(3)):
                k = 3 * j + d
                unknown[modes.first_node[2 * b] + j][d] = amplitudes.total[start + (k >> SHIFT)][k % TILE]


@kernel
def expand_velocities(modes: ModeShapes, unknown: Vectors, amplitudes: Amplitudes, velocity: Vectors, one: ti.i32):
    """Velocities of the nodes by rates of the amplitudes, the unknowns."""
    ti.loop_config(serialize=True)
    for b in range(modes.tiles.shape[0]):
        start = amplitudes.start[b]
        for t in range(start, amplitudes.start[b + 1]):
            amplitudes.total[t] = Column(0.0)
        for j in range(modes.threes[b]):
            for d in ti.static(range(3)):
                k = 3 * j + d
                amplitudes.total[start + (k >> SHIFT)][k % TILE] = unknown[modes.first_node[2 * b] + j][d]
        for i in range(modes.first_node[2 * b], modes.first_node[2 * b + 1]):
            velocity[i] = modes.axes[b] @ expand(b, i, modes, start, amplitudes.total, one)
