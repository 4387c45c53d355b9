"""Rotations of angles and vectors, those of deformations, and eigenvectors of symmetric matrices."""

import numpy as np
import pytest
from conftest import examples
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from taichisoft.base import quaternion_from_matrix
from taichisoft.base.rotations import degrees_from_rotation, rotation_from_degrees, rotation_from_vector
from taichisoft.mechanics.kernels.hooke_domains import polar_rotation
from taichisoft.runtime import kernel, ti
from taichisoft.runtime.arithmetic import positive_part, symmetric_eigen
from taichisoft.runtime.language import Matrices, Vectors

# Rotation matrices agree with SciPy's for any angles, and where two axes coincide.

ANGLES = st.tuples(*[st.floats(-720.0, 720.0) | st.sampled_from([0.0, 90.0, -90.0, 180.0])] * 3)


@given(ANGLES)
def test_angles_and_quaternions_give_scipys_rotation(angles: tuple[float, float, float]) -> None:
    matrix = rotation_from_degrees(angles)
    assert matrix == pytest.approx(Rotation.from_euler("xyz", angles, degrees=True).as_matrix(), abs=1e-14)
    assert rotation_from_degrees(tuple(degrees_from_rotation(matrix))) == pytest.approx(matrix, abs=2e-7)
    w, *vector = quaternion_from_matrix(matrix)
    assert Rotation.from_quat([*vector, w]).as_matrix() == pytest.approx(matrix, abs=1e-14)


@given(ANGLES)
def test_vectors_give_scipys_rotation(vector: tuple[float, float, float]) -> None:
    expected = Rotation.from_rotvec(vector).as_matrix()
    assert rotation_from_vector(np.array(vector)) == pytest.approx(expected, abs=1e-12)


# The rotation of a deformation in closed form is the nearest one, for every deformation.

COUNT = 200


@kernel
def find_rotations(deformation: Matrices, rotation: Matrices):
    for i in range(deformation.shape[0]):
        rotation[i] = polar_rotation(deformation[i])


def rotations(deformation: np.ndarray) -> np.ndarray:
    found = np.empty_like(deformation)
    find_rotations(np.ascontiguousarray(deformation), found)
    return found


def nearest_by_svd(deformation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The nearest rotations, and the singular values of which the last has the sign of the determinant."""
    left, stretch, right = np.linalg.svd(deformation)
    sign = np.sign(np.linalg.det(left @ right))
    left[:, :, 2] *= sign[:, None]
    stretch[:, 2] *= sign
    return left @ right, stretch


def turned_stretches(stretch: np.ndarray, seed: int) -> np.ndarray:
    """Deformations with these singular values, in random axes, turned_stretches at random."""
    generator = np.random.default_rng(seed)
    before, after = (Rotation.random(len(stretch), rng=generator).as_matrix() for _ in range(2))
    return before @ (stretch[:, :, None] * after)


@examples(50)
@given(seed=st.integers(0, 10**6), strain=st.floats(0.0, 3.0), size=st.sampled_from([1e-20, 1.0, 1e20]))
def test_polar_rotation_agrees_with_svd(seed: int, strain: float, size: float) -> None:
    """Strains of up to 300 %, so that many elements are inverted. The nearest rotation is as uncertain as round-off
    over s2 + s3: tolerance 1e-13 of s1 over it. It is orthogonal to 1e-12, whatever the deformation."""
    random = np.random.default_rng(seed).uniform(-1, 1, (COUNT, 3, 3))
    deformation = np.eye(3) + strain * random
    found, (expected, stretch) = rotations(size * deformation), nearest_by_svd(deformation)
    certainty = (stretch[:, 1] + stretch[:, 2]) / stretch[:, 0]
    assert (np.abs(found - expected).max(axis=(1, 2)) * certainty).max() < 1e-13
    assert np.abs(found @ np.swapaxes(found, 1, 2) - np.eye(3)).max() < 1e-12
    assert (np.linalg.det(found) > 0.0).all()


@pytest.mark.parametrize(
    "stretch",
    [(1, 1, 0), (1, 0.5, -0.2), (1, 1, -1), (1, 0.3, -0.3), (1, 1e-9, 0), (1, 0, 0), (1, 1e-5, -1e-5), (0, 0, 0)],
    ids=["flat", "inverted", "mirrored", "two that cancel", "needle", "line", "nearly a line", "point"],
)
def test_a_flat_or_inverted_element_has_a_rotation_too(stretch: tuple[float, float, float]) -> None:
    """None is nearer: tr(R^T F) is the largest that there is, s1 + s2 + s3, also where several rotations reach it."""
    deformation = turned_stretches(np.tile(np.array(stretch, dtype=float), (COUNT, 1)), 5)
    found = rotations(deformation)
    np.testing.assert_allclose(np.einsum("nij,nij->n", found, deformation), sum(stretch), atol=1e-12)
    np.testing.assert_allclose(found @ np.swapaxes(found, 1, 2), np.tile(np.eye(3), (COUNT, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(found), 1.0, atol=1e-12)


def test_it_turns_with_the_deformation() -> None:
    """Objective: R(Q F) = Q R(F) and R(F Q) = R(F) Q for every rotation Q, to round-off."""
    deformation = turned_stretches(np.random.default_rng(2).uniform(0.3, 3.0, (COUNT, 3)), 3)
    turn = Rotation.random(COUNT, rng=np.random.default_rng(4)).as_matrix()
    found = rotations(deformation)
    np.testing.assert_allclose(rotations(turn @ deformation), turn @ found, atol=1e-13)
    np.testing.assert_allclose(rotations(deformation @ turn), found @ turn, atol=1e-13)


# Eigenvalues of symmetric matrices, against numpy's, also where they are equal, nearly equal, or far apart in size.


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
    """1 + noise of up to 8 units in the last place, also in one or two entries alone."""
    random, count = np.random.default_rng(5), 200_000
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
    """Matrices of 1 and noise of 1 to 8 units in the last place: eigenvectors are a rotation."""
    random, count = np.random.default_rng(0), 400_000
    noise = random.integers(-16, 17, (count, 1, 1)) * np.eye(3) + random.integers(-16, 17, (count, 3, 3)) / 4.0
    noise = 2.0**-53 * (np.triu(noise) + np.triu(noise, 1).transpose(0, 2, 1))
    axes = np.zeros((count, 3, 3))
    decompose(sign * np.eye(3) + noise, np.zeros((count, 3)), axes, np.zeros((count, 3, 3)))
    assert np.abs(axes.transpose(0, 2, 1) @ axes - np.eye(3)).max() < 1e-14
