"""Eigenvalues of symmetric matrices, against numpy's, also where they are equal, nearly equal, or far apart in size."""

import numpy as np
import pytest
from conftest import examples
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from taichisoft.runtime import kernel, ti
from taichisoft.runtime.arithmetic import positive_part, symmetric_eigen
from taichisoft.runtime.language import Matrices, Vectors


@kernel
def decompose(matrices: Matrices, values: Vectors, vectors: Matrices, positive: Matrices):
    """Of all matrices."""
    ti.loop_config(serialize=True)
    for i in range(matrices.shape[0]):
        values[i], vectors[i] = symmetric_eigen(matrices[i])
        positive[i] = positive_part(matrices[i])


def check(matrix: np.ndarray) -> None:
    """Against the definition, and against numpy's eigenvalues, to round-off of the matrix."""
    matrix = np.ascontiguousarray(0.5 * (matrix + matrix.T))
    values, vectors, positive = np.zeros((1, 3)), np.zeros((1, 3, 3)), np.zeros((1, 3, 3))
    decompose(matrix[None], values, vectors, positive)
    room = 1e-14 * np.abs(matrix).max()
    np.testing.assert_allclose(vectors[0].T @ vectors[0], np.eye(3), atol=1e-14)
    assert np.linalg.det(vectors[0]) == pytest.approx(1.0)
    np.testing.assert_allclose(vectors[0] * values[0] @ vectors[0].T, matrix, atol=room)
    known, axes = np.linalg.eigh(matrix)
    np.testing.assert_allclose(np.sort(values[0]), known, atol=room)
    np.testing.assert_allclose(positive[0], axes * np.maximum(known, 0.0) @ axes.T, atol=room)


@examples(300)
@given(
    size=st.floats(-12, 6),
    spread=st.tuples(st.floats(-1, 1), st.floats(-16, 0), st.floats(-1, 1), st.floats(-16, 0)),
    turn=st.tuples(*[st.floats(-180, 180)] * 3),
)
def test_the_parts_make_up_the_matrix(
    size: float, spread: tuple[float, float, float, float], turn: tuple[float, float, float]
) -> None:
    """Eigenvalues 1, and two that differ from it by anything from round-off to twice itself."""
    first, second = 1.0 + 2.0 * spread[0] * 10.0 ** spread[1], 1.0 + 2.0 * spread[2] * 10.0 ** spread[3]
    axes = Rotation.from_euler("xyz", turn, degrees=True).as_matrix()
    check(10.0**size * (axes * [1.0, first, second] @ axes.T))


@pytest.mark.parametrize(
    "diagonal", [(0, 0, 0), (1, 1, 1), (1, 1, 2), (1, 2, 2), (2, 1, 1), (-1, -1, 2), (-1, 0, 1), (0, 0, -3), (5, 0, 0)]
)
def test_of_diagonal_matrices(diagonal: tuple[float, float, float]) -> None:
    check(np.diag(diagonal).astype(float))
    check(np.diag(diagonal) + 1e-9 * np.array([[0.0, 1.0, 2.0], [1.0, 0.0, -1.0], [2.0, -1.0, 0.0]]))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_of_matrices_that_are_isotropic_but_for_round_off(sign: float) -> None:
    """Half a million of each sign, 1 + noise of up to 8 units in the last place, also in one or two entries alone."""
    random, count = np.random.default_rng(5), 500_000
    noise = random.integers(-8, 9, (count, 3, 3)) * (random.random((count, 3, 3)) < 0.5) * np.finfo(float).eps
    matrices = sign * np.eye(3) + np.triu(noise) + np.triu(noise, 1).transpose(0, 2, 1)
    values, vectors, positive = np.zeros((count, 3)), np.zeros((count, 3, 3)), np.zeros((count, 3, 3))
    decompose(matrices, values, vectors, positive)
    transposed = vectors.transpose(0, 2, 1)
    np.testing.assert_allclose(transposed @ vectors, np.broadcast_to(np.eye(3), vectors.shape), atol=1e-14)
    np.testing.assert_allclose(vectors * values[:, None] @ transposed, matrices, atol=1e-14)
    np.testing.assert_allclose(positive, matrices if sign > 0.0 else 0.0 * matrices, atol=1e-14)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_noise_on_an_isotropic_matrix_leaves_axes(sign: float) -> None:
    """A million matrices of 1 and noise of 1 to 8 units in the last place: eigenvectors are a rotation."""
    random = np.random.default_rng(0)
    noise = random.integers(-16, 17, (10**6, 1, 1)) * np.eye(3) + random.integers(-16, 17, (10**6, 3, 3)) / 4.0
    noise = 2.0**-53 * (np.triu(noise) + np.triu(noise, 1).transpose(0, 2, 1))
    axes = np.zeros((10**6, 3, 3))
    decompose(sign * np.eye(3) + noise, np.zeros((10**6, 3)), axes, np.zeros((10**6, 3, 3)))
    assert np.abs(axes.transpose(0, 2, 1) @ axes - np.eye(3)).max() < 1e-14
