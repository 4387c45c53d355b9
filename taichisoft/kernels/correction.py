"""A^-1 J^T lambda from what the compliance has left: with Y = L^-1 J^T it is L^-T (Y lambda), half a solve."""

from taichisoft.kernels.cholesky import FIRST_COLUMN, WIDTH, Factor, Fronts
from taichisoft.kernels.compliance import GROUP, NOWHERE, SparseColumns
from taichisoft.kernels.launch import Kernel, func, kernel
from taichisoft.kernels.runtime import CHUNK, THREADS, Scalars, ti
from taichisoft.kernels.tiles import Column
from taichisoft.kernels.triangular_solve import FIRST, LAST, WORK, Solution, hand_out, solve_backward


@func
def combine(
    s: ti.i32, row_count: ti.i32, impulse: Scalars, columns: SparseColumns, fronts: Fronts, solution: Solution
) -> ti.i32:
    """The part of a supernode in Y lambda; whether any row reaches it."""
    y, x, table = ti.static(columns.y, solution.x, fronts.table)
    first, width = table[s, FIRST_COLUMN], table[s, WIDTH]
    reached = 0
    for i in range(first, first + width):
        x[i] = 0.0
    for g in range((row_count + GROUP - 1) // GROUP):
        place = columns.place[g, s]
        if place != NOWHERE:
            reached = 1
            share = Column(0.0)
            for a in ti.static(range(GROUP)):
                if GROUP * g + a < row_count:
                    share[a] = impulse[GROUP * g + a]
            for i in range(first, first + width):
                x[i] = x[i] + (y[place + i] * share).sum()
    return reached


def make_correct(workers: int) -> Kernel:
    """The kernel on a number of threads; one does not wake any other."""

    @kernel
    def correct(
        row_count: ti.i32,
        impulse: Scalars,
        columns: SparseColumns,
        fronts: Fronts,
        factor: Factor,
        solution: Solution,
        one: ti.i32,
    ):
        """Fill `solution.found` with the change of velocity by impulses in the rows, trees dealt out to threads."""
        ti.loop_config(serialize=workers == 1)
        for worker in range(workers * CHUNK):
            if worker % CHUNK == 0:
                tree = ti.static(solution.trees)
                t = worker // CHUNK
                while t < tree.shape[0]:
                    reached = 0
                    for s in range(tree[t, FIRST], tree[t, LAST]):
                        reached += combine(s, row_count, impulse, columns, fronts, solution)
                    if reached > 0:
                        for back in range(tree[t, LAST] - tree[t, FIRST]):
                            s = tree[t, LAST] - 1 - back
                            solve_backward(s, fronts, factor, solution, tree[t, WORK], one)
                    hand_out(t, fronts, solution)
                    t += workers

    return correct


correct, correct_serially = make_correct(THREADS), make_correct(1)
