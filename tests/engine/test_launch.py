"""Kernels take exactly the arrays that they are annotated with: a wrong one is an error, never misread memory."""

import numpy as np
import pytest

from taichisoft.kernels.launch import kernel
from taichisoft.kernels.runtime import Scalars, Vectors, ti


@kernel
def add_up(vectors: Vectors, factor: ti.f64, offset: ti.i32, result: Scalars):
    for i in range(result.shape[0]):
        result[i] = factor * vectors[i].sum() + offset


def test_a_kernel_computes_with_what_it_is_given() -> None:
    vectors, result = np.arange(12.0).reshape(4, 3), np.zeros(4)
    for factor in (0.5, 2):  # the first call compiles, later ones take the short way
        add_up(vectors, factor, 7, result)
        np.testing.assert_array_equal(result, factor * vectors.sum(axis=1) + 7)


def test_arrays_may_change_size_between_calls() -> None:
    for count in (3, 1, 5):
        result = np.zeros(count)
        add_up(np.ones((count, 3)), 1.0, 0, result)
        np.testing.assert_array_equal(result, 3.0)


@pytest.mark.parametrize(
    "vectors",
    [np.ones((4, 3), dtype=np.int64), np.ones((4, 3), dtype=np.float32), np.ones(12), np.ones((3, 4)).T],
    ids=["integers", "single precision", "one dimension", "not contiguous"],
)
def test_an_array_of_another_kind_is_refused(vectors: np.ndarray) -> None:
    with pytest.raises(TypeError, match="add_up, argument 0: must be a contiguous float64 array of 2 dimensions"):
        add_up(vectors, 1.0, 0, np.zeros(4))


def test_a_missing_argument_is_refused() -> None:
    with pytest.raises(ValueError, match="longer"):
        add_up(np.ones((4, 3)), 1.0, 0)
