"""The rotation of a deformation in closed form is the nearest one, for every deformation."""

import numpy as np
import pytest
from conftest import examples
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from taichisoft.mechanics.kernels.hooke_domains import polar_rotation
from taichisoft.runtime import kernel
from taichisoft.runtime.language import Matrices

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


def turned(stretch: np.ndarray, seed: int) -> np.ndarray:
    """Deformations with these singular values, in random axes, turned at random."""
    generator = np.random.default_rng(seed)
    before, after = (Rotation.random(len(stretch), rng=generator).as_matrix() for _ in range(2))
    return before @ (stretch[:, :, None] * after)


@examples(50)
@given(seed=st.integers(0, 10**6), strain=st.floats(0.0, 3.0), size=st.sampled_from([1e-20, 1.0, 1e20]))
def test_it_is_the_rotation_of_the_singular_value_decomposition(seed: int, strain: float, size: float) -> None:
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
    deformation = turned(np.tile(np.array(stretch, dtype=float), (COUNT, 1)), 5)
    found = rotations(deformation)
    np.testing.assert_allclose(np.einsum("nij,nij->n", found, deformation), sum(stretch), atol=1e-12)
    np.testing.assert_allclose(found @ np.swapaxes(found, 1, 2), np.tile(np.eye(3), (COUNT, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(found), 1.0, atol=1e-12)


def test_it_turns_with_the_deformation() -> None:
    """Objective: R(Q F) = Q R(F) and R(F Q) = R(F) Q for every rotation Q, to round-off."""
    deformation = turned(np.random.default_rng(2).uniform(0.3, 3.0, (COUNT, 3)), 3)
    turn = Rotation.random(COUNT, rng=np.random.default_rng(4)).as_matrix()
    found = rotations(deformation)
    np.testing.assert_allclose(rotations(turn @ deformation), turn @ found, atol=1e-13)
    np.testing.assert_allclose(rotations(deformation @ turn), found @ turn, atol=1e-13)
