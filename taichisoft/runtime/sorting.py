"""Sorting within a kernel."""

from taichisoft.runtime.language import Integers, ScalarTable, func, ti


@func
def sort_rows(count: ti.i32, keys: ScalarTable, order: Integers, spare: Integers):
    """Fill `order` with the first `count` rows of `keys` by their first number, then by the next ones.

    Rows that are equal keep their order (merge sort); `spare` is work space of the same size.
    """
    for i in range(count):
        order[i] = i
    run = 1  # rows that are in order, side by side
    while run < count:
        for i in range(count):
            spare[i] = order[i]
        for pair in range((count + 2 * run - 1) // (2 * run)):
            start = 2 * run * pair
            merge(start, ti.min(start + run, count), ti.min(start + 2 * run, count), keys, spare, order)
        run *= 2


@func
def merge(start: ti.i32, middle: ti.i32, end: ti.i32, keys: ScalarTable, runs: Integers, order: Integers):
    """Merge the two runs from `start` to `middle` and from there to `end`."""
    left, right = start, middle
    for k in range(start, end):
        from_right = left == middle
        if left < middle and right < end:  # nested: behind `and` Taichi would call the function in any case
            from_right = comes_before(runs[right], runs[left], keys)
        if from_right:
            order[k] = runs[right]
            right += 1
        else:
            order[k] = runs[left]
            left += 1


@func
def comes_before(row: ti.i32, other: ti.i32, keys: ScalarTable) -> ti.u1:
    """Whether a row stands before another one."""
    before, column = False, 0
    while column < keys.shape[1]:
        if keys[row, column] != keys[other, column]:
            before = keys[row, column] < keys[other, column]
            column = keys.shape[1]
        column += 1
    return before
