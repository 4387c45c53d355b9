"""The compliance W = J A^-1 J^T of constraint rows by the forward half of the triangular solve.

Rows are in groups of eight, the columns of a panel: Y = L^-1 J^T, W = Y^T Y. Only supernodes reached in the elimination
tree from a group's nodes are visited and stored in Y.
"""

from taichisoft.contact.kernels.row_velocities import ACTUATORS, CONTACTS, MOMENTS, Rows
from taichisoft.mechanics.kernels.actuator_coordinates import Coordinates, Gradient
from taichisoft.mechanics.kernels.mode_motion import ModeShapes
from taichisoft.mechanics.kernels.sparse_columns import (
    FIRST_COLUMN,
    GROUP,
    NOWHERE,
    PANEL,
    WIDTH,
    EliminationTree,
    Factor,
    Fronts,
    SparseColumns,
    eliminate,
    mark_path,
)
from taichisoft.runtime.arithmetic import BEGUN_LATER, FINISHED, PATIENCE, SHIFT, Column, advance, opaque, reaches
from taichisoft.runtime.language import CHUNK, Scalars, func, ti, vec3
from taichisoft.runtime.launch import kernel


@func
def mark_unknowns(
    g: ti.i32, node: ti.i32, modes: ModeShapes, tree: EliminationTree, fronts: Fronts, columns: SparseColumns
):
    """Give room to the supernodes that a node leads to, or the amplitudes of its body."""
    first, count = node, 1
    if modes.start[node] >= 0:
        first, count = modes.first_node[2 * modes.body[node]], modes.threes[modes.body[node]]
    for j in range(count):
        mark_path(g, first + j, tree, fronts, columns)


@func
def give_places(
    rows: Rows,
    coordinates: Coordinates,
    modes: ModeShapes,
    tree: EliminationTree,
    fronts: Fronts,
    columns: SparseColumns,
):
    """Fill in `columns.place` and `columns.size` of each group; moments do not act on soft bodies."""
    contact_rows, row_count = 3 * rows.size[CONTACTS], 3 * (rows.size[CONTACTS] + rows.size[MOMENTS])
    columns.size[0] = 0
    for g in range((row_count + rows.size[ACTUATORS] + GROUP - 1) // GROUP):
        for s in range(tree.parent.shape[0]):
            columns.place[g, s] = NOWHERE
        for r in range(GROUP * g, ti.min(GROUP * (g + 1), contact_rows + rows.size[ACTUATORS])):
            if r < contact_rows:
                for slot in range(rows.node.shape[1]):
                    if rows.node[r // 3, slot] >= 0:
                        mark_unknowns(g, rows.node[r // 3, slot], modes, tree, fronts, columns)
            else:
                coordinate = rows.coordinate[r - contact_rows]
                for k in range(coordinates.entry_start[coordinate], coordinates.entry_start[coordinate + 1]):
                    mark_unknowns(g, coordinates.entry_node[k], modes, tree, fronts, columns)


@kernel
def lay_out_columns(
    rows: Rows,
    coordinates: Coordinates,
    modes: ModeShapes,
    tree: EliminationTree,
    fronts: Fronts,
    columns: SparseColumns,
):
    """Find the places and sizes of the columns, before `soft_compliance`."""
    ti.loop_config(serialize=True)
    for _ in range(1):  # without this loop Taichi would distribute the groups over threads
        give_places(rows, coordinates, modes, tree, fronts, columns)


@func
def first_entry(g: ti.i32, node: ti.i32, tree: EliminationTree, columns: SparseColumns) -> ti.i32:
    """Index of the first of a node's three entries in `columns.y`."""
    position = tree.position_of_node[node]
    return columns.place[g, tree.supernode_of_position[position]] + 3 * position


@func
def add_modes(
    g: ti.i32,
    column: ti.i32,
    node: ti.i32,
    force: vec3,
    modes: ModeShapes,
    tree: EliminationTree,
    columns: SparseColumns,
):
    """Add a force at a node of a reduced body to a column of J^T: the forces on its amplitudes."""
    b = modes.body[node]
    local, first, tiles = modes.axes[b].transpose() @ force, modes.start[node], modes.tiles[b]
    for j in range(modes.threes[b]):
        i = first_entry(g, modes.first_node[2 * b] + j, tree, columns)
        for d in ti.static(range(3)):
            tile, lane = first + (3 * j + d >> SHIFT), (3 * j + d) % GROUP
            share = local[0] * modes.shape[tile][lane]
            share += local[1] * modes.shape[tile + tiles][lane]
            share += local[2] * modes.shape[tile + 2 * tiles][lane]
            columns.y[i + d][column] = columns.y[i + d][column] + share


@func
def fill_group(
    g: ti.i32,
    rows: Rows,
    coordinates: Coordinates,
    gradient: Gradient,
    modes: ModeShapes,
    tree: EliminationTree,
    fronts: Fronts,
    columns: SparseColumns,
):
    """Fill in a group's columns of J^T on the supernodes that it reaches; the columns of moments are 0."""
    place, y = ti.static(columns.place, columns.y)
    contact_rows = 3 * rows.size[CONTACTS]
    for s in range(tree.parent.shape[0]):
        if place[g, s] != NOWHERE:
            first = place[g, s] + fronts.table[s, FIRST_COLUMN]
            for i in range(first, first + fronts.table[s, WIDTH]):
                y[i] = Column(0.0)
    for r in range(GROUP * g, ti.min(GROUP * (g + 1), contact_rows + rows.size[ACTUATORS])):
        column = r - GROUP * g
        if r < contact_rows:
            c = r // 3
            direction = vec3(rows.basis[c][r % 3, 0], rows.basis[c][r % 3, 1], rows.basis[c][r % 3, 2])
            for slot in range(rows.node.shape[1]):
                if rows.node[c, slot] >= 0:
                    node = rows.node[c, slot]
                    if modes.start[node] >= 0:
                        add_modes(g, column, node, rows.weight[c, slot] * direction, modes, tree, columns)
                    else:
                        i = first_entry(g, node, tree, columns)
                        for d in ti.static(range(3)):
                            y[i + d][column] = y[i + d][column] + rows.weight[c, slot] * direction[d]
        else:
            coordinate = rows.coordinate[r - contact_rows]
            for k in range(coordinates.entry_start[coordinate], coordinates.entry_start[coordinate + 1]):
                node = coordinates.entry_node[k]
                if modes.start[node] >= 0:
                    add_modes(g, column, node, gradient.soft[k], modes, tree, columns)
                else:
                    i = first_entry(g, node, tree, columns)
                    for d in ti.static(range(3)):
                        y[i + d][column] = gradient.soft[k][d]


@func
def multiply_groups(
    g: ti.i32, h: ti.i32, row_count: ti.i32, fronts: Fronts, columns: SparseColumns, w: Scalars, one: ti.i32
):
    """Compute the block of W = Y^T Y of two groups and its transpose; W is stored by rows."""
    front, place, y = ti.static(fronts.table, columns.place, columns.y)
    total = [Column(0.0) for _ in range(GROUP)]
    for s in range(place.shape[1]):
        if place[g, s] != NOWHERE and place[h, s] != NOWHERE:
            one_row = opaque(place[g, s] + front[s, FIRST_COLUMN], one)
            other_row = opaque(place[h, s] + front[s, FIRST_COLUMN], one)
            i = 0
            while i < front[s, WIDTH]:
                left, right = y[one_row + i], y[other_row + i]
                for a in ti.static(range(GROUP)):
                    total[a] += left[a] * right
                i = advance(i, 1, one)
    for a in ti.static(range(GROUP)):
        r = GROUP * g + a
        if r < row_count:
            for b in ti.static(range(GROUP)):
                q = GROUP * h + b
                if q < row_count:
                    w[r * row_count + q] = total[a][b]
                    w[q * row_count + r] = total[a][b]


@func
def add_begun(g: ti.i32, row_count: ti.i32, begun: Scalars, fronts: Fronts, columns: SparseColumns, velocity: Scalars):
    """Add Y^T L^-1 b, the effect of the right-hand side b, to the velocities of a group's rows."""
    front, y = ti.static(fronts.table, columns.y)
    total = Column(0.0)
    for s in range(columns.place.shape[1]):
        if columns.place[g, s] != NOWHERE:
            for i in range(front[s, FIRST_COLUMN], front[s, FIRST_COLUMN] + front[s, WIDTH]):
                total += y[columns.place[g, s] + i] * begun[i]
    for a in ti.static(range(GROUP)):
        if GROUP * g + a < row_count:
            velocity[GROUP * g + a] = velocity[GROUP * g + a] + total[a]


@func
def patience(group_count: ti.i32, fronts: Fronts) -> ti.i32:
    """Number of polls for the groups of other threads: a column of tiles of the factor takes nanoseconds."""
    columns_of_tiles = fronts.table[fronts.table.shape[0] - 1, PANEL]
    return PATIENCE + ti.cast(ti.min(0.25 * group_count * columns_of_tiles, 1e8), ti.i32)


@kernel
def soft_compliance(
    rows: Rows,
    coordinates: Coordinates,
    gradient: Gradient,
    modes: ModeShapes,
    tree: EliminationTree,
    fronts: Fronts,
    factor: Factor,
    columns: SparseColumns,
    begun: Scalars,
    w: Scalars,
    workers: ti.i32,
    one: ti.i32,
):
    """Compute Y = L^-1 J^T and W = Y^T Y, with the places of `lay_out_columns`, or on one thread its own.

    The effect of the right-hand side b, given as L^-1 b in `begun`, is added to the rows' velocities, `rows.free`.
    Neighbouring groups, which act on the same body, go to the same thread and share its cache.
    """
    for worker_ in range(workers * CHUNK):
        if worker_ % CHUNK == 0:
            row_count = 3 * (rows.size[CONTACTS] + rows.size[MOMENTS]) + rows.size[ACTUATORS]
            worker, group_count = worker_ // CHUNK, (row_count + GROUP - 1) // GROUP
            if workers == 1:
                give_places(rows, coordinates, modes, tree, fronts, columns)
            for g in range(worker * group_count // workers, (worker + 1) * group_count // workers):
                fill_group(g, rows, coordinates, gradient, modes, tree, fronts, columns)
                for s in range(tree.parent.shape[0]):
                    if columns.place[g, s] != NOWHERE:
                        eliminate(g, s, fronts, factor, tree, columns, one)
                add_begun(g, row_count, begun, fronts, columns, rows.free)
            ti.atomic_add(columns.progress[FINISHED], 1)
            if reaches(columns.progress, FINISHED, workers, patience(group_count, fronts)):
                share = ti.atomic_add(columns.progress[BEGUN_LATER], 1)
                while share < workers:
                    for pair in range(group_count * group_count):
                        g, h = pair // group_count, pair % group_count
                        if g >= h and (g + h) % workers == share:
                            multiply_groups(g, h, row_count, fronts, columns, w, one)
                    share = ti.atomic_add(columns.progress[BEGUN_LATER], 1)


# The same for small problems: it wakes no other thread.
soft_compliance_serially = soft_compliance.serial()
