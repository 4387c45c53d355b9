"""Sorting in a kernel gives numpy's order."""

import numpy as np
from conftest import examples
from hypothesis import given
from hypothesis import strategies as st

from taichisoft.runtime import kernel, ti
from taichisoft.runtime.arithmetic import sort_rows
from taichisoft.runtime.language import Integers, ScalarTable


@kernel
def sort(count: ti.i32, keys: ScalarTable, order: Integers, spare: Integers):
    ti.loop_config(serialize=True)
    for _ in range(1):
        sort_rows(count, keys, order, spare)


@examples(200)
@given(
    seed=st.integers(0, 10**6),
    count=st.integers(0, 300),
    columns=st.integers(1, 3),
    values=st.sampled_from([2, 20, 10**9]),
)
def test_rows_are_sorted_by_their_numbers_and_equal_ones_keep_their_order(
    seed: int, count: int, columns: int, values: int
) -> None:
    """Few values give many equal rows; what stands behind the rows is left alone."""
    keys = np.random.default_rng(seed).integers(-values, values, (count + 2, columns)).astype(float)
    order, spare = np.full(count + 2, -7, dtype=np.int32), np.zeros(count + 2, dtype=np.int32)
    sort(count, keys, order, spare)
    np.testing.assert_array_equal(order[:count], np.lexsort(keys[:count].T[::-1]))
    assert order[count:].tolist() == [-7, -7]
