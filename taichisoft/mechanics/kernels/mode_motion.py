"""Modes: from motions and forces of nodes to amplitudes, and back.

A reduced body moves in the frame of its mesh, which the base carries along: x = c + T (X + Phi q), with T the frame's
axes. The modes are orthonormal in the mass, so that of all amplitudes q = Phi^T M T^T (x - c - T X) are nearest to x.
"""

from typing import NamedTuple

from taichisoft.mechanics.kernels.domain_deformation import HOOKE, Domains, Movement, deformation_and_rate
from taichisoft.mechanics.kernels.hooke_domains import corotated_stress
from taichisoft.mechanics.kernels.rubber_domains import respond_by_stretches
from taichisoft.runtime.arithmetic import SHIFT, TILE, Column, Columns, advance, opaque
from taichisoft.runtime.language import Integers, Matrices, Scalars, Vectors, func, mat3, ti, vec3
from taichisoft.runtime.launch import kernel

# The elastic forces of all integration domains on some nodes.


class DomainsOfNodes(NamedTuple):
    """Which domains have a node.

    Attributes:
        start: where the entries of each node begin, shape (node_count + 1,).
        entry: number among the entries of all domains, shape (entry_count,).
        domain: of each entry of all domains, shape (entry_count,).
    """

    start: Integers
    entry: Integers
    domain: Integers


@kernel
def sample_forces(node: Integers, around: DomainsOfNodes, domains: Domains, movement: Movement, force: Vectors):
    """Forces f - (h + b) K v on nodes [mN], shape (count, 3); a domain counts anew for each of its nodes."""
    ti.loop_config(serialize=True)
    for n in range(node.shape[0]):
        total = vec3(0.0)
        for k in range(around.start[node[n]], around.start[node[n] + 1]):
            c = around.entry[k]
            d = around.domain[c]
            deformation, rate = deformation_and_rate(d, domains, movement)
            stress = ti.Matrix.zero(ti.f64, 3, 3)
            if domains.law[d] == HOOKE:
                _rotation, stress = corotated_stress(d, deformation, rate, domains)
            else:
                stress, _left, _right, _hessian, _same, _swapped = respond_by_stretches(d, deformation, rate, domains)
            total -= stress @ domains.gradient[c]
        force[n] = total


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


class NodeBlocks(NamedTuple):
    """Modes of eight nodes at a time, by which all of a body moves without sums across a vector.

    The bodies take turns block by block, so that those which are copies read the same modes from the cache.

    Attributes:
        start: where the modes of each body begin in `shape`, shape (body_count,).
        shape: x, y and z of eight nodes in the first mode, then in the next; padded with zeros; shared by copies.
        first: first block of each body, and their number, shape (body_count + 1,).
        rest: rest positions in the frame of the mesh [mm], x, y and z of each block.
        mass: [kg], one column for each block; padded with zeros.
        displacement: in the frame of the body [mm], as `rest`.
    """

    start: Integers
    shape: Columns
    first: Integers
    rest: Columns
    mass: Columns
    displacement: Columns


class Amplitudes(NamedTuple):
    """Amplitudes of the reduced bodies in a step, those of each body in columns of eight.

    Attributes:
        start: of each body, shape (body_count + 1,).
        position: amplitudes of the positions, shape (column_count, 8).
        velocity: of the velocities, likewise.
        total: work space, likewise.
        scalars: the same memory, number by number.
        sums, other_sums: work space, shape (8 column_count, 8).
        moment: Phi^T M along x, y and z of each body's frame, three times as many columns.
        drag: Rayleigh's factor a of each body [1/s], shape (body_count,).
        gravity: acceleration of gravity [mm/s^2], shape (1, 3).
    """

    start: Integers
    position: Columns
    velocity: Columns
    total: Columns
    scalars: Scalars
    sums: Columns
    other_sums: Columns
    moment: Columns
    drag: Scalars
    gravity: Vectors


@func
def block_count(b: ti.i32, blocks: NodeBlocks) -> ti.i32:
    """Number of blocks of a body."""
    return blocks.first[b + 1] - blocks.first[b]


@func
def most_blocks(blocks: NodeBlocks) -> ti.i32:
    """Number of blocks of the body that has most."""
    most = 0
    for b in range(blocks.start.shape[0]):
        most = ti.max(most, block_count(b, blocks))
    return most


@func
def gather(b: ti.i32, block: ti.i32, modes: ModeShapes, vectors: ti.template()):
    """x, y and z of vectors at the nodes of a block, beyond the end of the body those of its last node."""
    first, last = modes.first_node[2 * b] + TILE * block, modes.first_node[2 * b + 1] - 1
    x, y, z = Column(0.0), Column(0.0), Column(0.0)
    for a in ti.static(range(TILE)):
        vector = vectors[ti.min(first + a, last)]
        x[a], y[a], z[a] = vector[0], vector[1], vector[2]
    return x, y, z


@func
def turn(axes: mat3, x: Column, y: Column, z: Column):
    """x, y and z of axes @ vectors."""
    return (
        axes[0, 0] * x + axes[0, 1] * y + axes[0, 2] * z,
        axes[1, 0] * x + axes[1, 1] * y + axes[1, 2] * z,
        axes[2, 0] * x + axes[2, 1] * y + axes[2, 2] * z,
    )


@func
def project(
    b: ti.i32,
    block: ti.i32,
    x: Column,
    y: Column,
    z: Column,
    modes: ModeShapes,
    blocks: NodeBlocks,
    start: ti.i32,
    sums: Columns,
    one: ti.i32,
):
    """Add Phi^T of vectors at a block's nodes, in the frame of its body, to sums over the eight places of blocks."""
    count = 3 * modes.threes[b]
    place, first = opaque(blocks.start[b] + 3 * count * block, one), opaque(TILE * start, one)
    k = 0
    while k < count:
        own = blocks.shape[place] * x
        own += blocks.shape[opaque(place + 1, one)] * y
        own += blocks.shape[opaque(place + 2, one)] * z
        target = opaque(first + k, one)
        sums[target] = sums[target] + own
        place, k = advance(place, 3, one), advance(k, 1, one)


@func
def expand(b: ti.i32, block: ti.i32, modes: ModeShapes, blocks: NodeBlocks, amplitudes: Amplitudes, one: ti.i32):
    """x, y and z of Phi times the amplitudes in `total` at the nodes of a block, in the frame of its body."""
    count, first = 3 * modes.threes[b], TILE * amplitudes.start[b]
    place = opaque(blocks.start[b] + 3 * count * block, one)
    x, y, z = [Column(0.0) for _ in range(3)], [Column(0.0) for _ in range(3)], [Column(0.0) for _ in range(3)]
    k = 0
    while k < count:
        for a in ti.static(range(3)):
            value = amplitudes.scalars[first + k + a]
            x[a] += value * blocks.shape[opaque(place + 3 * a, one)]
            y[a] += value * blocks.shape[opaque(place + 3 * a + 1, one)]
            z[a] += value * blocks.shape[opaque(place + 3 * a + 2, one)]
        place, k = advance(place, 9, one), advance(k, 3, one)
    return x[0] + x[1] + x[2], y[0] + y[1] + y[2], z[0] + z[1] + z[2]


@func
def scatter(b: ti.i32, block: ti.i32, modes: ModeShapes, x: Column, y: Column, z: Column, vectors: ti.template()):
    """Write vectors of the nodes of a block, given in the frame of its body."""
    first, last = modes.first_node[2 * b] + TILE * block, modes.first_node[2 * b + 1]
    along_x, along_y, along_z = turn(modes.axes[b], x, y, z)
    for a in ti.static(range(TILE)):
        if first + a < last:
            vectors[first + a] = vec3(along_x[a], along_y[a], along_z[a])


@func
def clear(first: ti.i32, last: ti.i32, columns: Columns):
    """Set columns to 0."""
    for t in range(first, last):
        columns[t] = Column(0.0)


@kernel
def find_reference(
    time_step: ti.f64,
    inertia: ti.f64,
    modes: ModeShapes,
    blocks: NodeBlocks,
    amplitudes: Amplitudes,
    position: Vectors,
    velocity: Vectors,
    one: ti.i32,
):
    """The amplitudes q and w nearest to displacements u and velocities, and instead of the latter those nearest to them
    that lead to positions by modes: (Phi q - u) / h + Phi w; w times `inertia`, 0 in overdamped dynamics."""
    ti.loop_config(serialize=True)
    for _ in range(1):
        bodies, most = modes.tiles.shape[0], most_blocks(blocks)
        clear(0, amplitudes.sums.shape[0], amplitudes.sums)
        clear(0, amplitudes.sums.shape[0], amplitudes.other_sums)
        for block in range(most):
            for b in range(bodies):
                if block < block_count(b, blocks):
                    place, inverse = blocks.first[b] + block, modes.axes[b].transpose()
                    mass, start, origin = blocks.mass[place], amplitudes.start[b], modes.origin[b]
                    x, y, z = gather(b, block, modes, position)
                    x, y, z = turn(inverse, x - origin[0], y - origin[1], z - origin[2])
                    x -= blocks.rest[3 * place]
                    y -= blocks.rest[3 * place + 1]
                    z -= blocks.rest[3 * place + 2]
                    blocks.displacement[3 * place] = x
                    blocks.displacement[3 * place + 1] = y
                    blocks.displacement[3 * place + 2] = z
                    project(b, block, mass * x, mass * y, mass * z, modes, blocks, start, amplitudes.sums, one)
                    x, y, z = gather(b, block, modes, velocity)
                    x, y, z = turn(inverse, mass * x, mass * y, mass * z)
                    project(b, block, x, y, z, modes, blocks, start, amplitudes.other_sums, one)
        for b in range(bodies):
            start = amplitudes.start[b]
            for k in range(3 * modes.threes[b]):
                t, a = start + (k >> SHIFT), k % TILE
                amplitudes.position[t][a] = amplitudes.sums[TILE * start + k].sum()
                amplitudes.velocity[t][a] = inertia * amplitudes.other_sums[TILE * start + k].sum()
            for t in range(start, amplitudes.start[b + 1]):
                amplitudes.total[t] = amplitudes.position[t] / time_step + amplitudes.velocity[t]
        for block in range(most):
            for b in range(bodies):
                if block < block_count(b, blocks):
                    place = 3 * (blocks.first[b] + block)
                    x, y, z = expand(b, block, modes, blocks, amplitudes, one)
                    x -= blocks.displacement[place] / time_step
                    y -= blocks.displacement[place + 1] / time_step
                    z -= blocks.displacement[place + 2] / time_step
                    scatter(b, block, modes, x, y, z, velocity)


@kernel
def project_impulses(
    time_step: ti.f64,
    modes: ModeShapes,
    blocks: NodeBlocks,
    impulse: Vectors,
    elastic: Columns,
    amplitudes: Amplitudes,
    unknown: Vectors,
    one: ti.i32,
):
    """Impulses on the unknowns by impulses on nodes, and in a step by elastic forces, weight and drag."""
    ti.loop_config(serialize=True)
    for _ in range(1):
        bodies = modes.tiles.shape[0]
        clear(0, amplitudes.sums.shape[0], amplitudes.sums)
        for block in range(most_blocks(blocks)):
            for b in range(bodies):
                if block < block_count(b, blocks):
                    x, y, z = gather(b, block, modes, impulse)
                    x, y, z = turn(modes.axes[b].transpose(), x, y, z)
                    project(b, block, x, y, z, modes, blocks, amplitudes.start[b], amplitudes.sums, one)
        for b in range(bodies):
            start, tiles = amplitudes.start[b], modes.tiles[b]
            weight = modes.axes[b].transpose() @ amplitudes.gravity[0]
            for t in range(tiles):
                force = elastic[start + t] - amplitudes.drag[b] * amplitudes.velocity[start + t]
                for d in ti.static(range(3)):
                    force += weight[d] * amplitudes.moment[3 * start + d * tiles + t]
                amplitudes.total[start + t] = time_step * force
            for j in range(modes.threes[b]):
                for d in ti.static(range(3)):
                    k = 3 * j + d
                    own = amplitudes.scalars[TILE * start + k] + amplitudes.sums[TILE * start + k].sum()
                    unknown[modes.first_node[2 * b] + j][d] = own


@kernel
def expand_velocities(
    modes: ModeShapes, blocks: NodeBlocks, unknown: Vectors, amplitudes: Amplitudes, velocity: Vectors, one: ti.i32
):
    """Velocities of the nodes by rates of the amplitudes, the unknowns."""
    ti.loop_config(serialize=True)
    for _ in range(1):
        bodies = modes.tiles.shape[0]
        for b in range(bodies):
            for j in range(modes.threes[b]):
                for d in ti.static(range(3)):
                    k = 3 * j + d
                    amplitudes.scalars[TILE * amplitudes.start[b] + k] = unknown[modes.first_node[2 * b] + j][d]
        for block in range(most_blocks(blocks)):
            for b in range(bodies):
                if block < block_count(b, blocks):
                    x, y, z = expand(b, block, modes, blocks, amplitudes, one)
                    scatter(b, block, modes, x, y, z, velocity)
