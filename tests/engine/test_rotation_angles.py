"""Rotation matrices agree with SciPy's for any angles, and where two axes coincide."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from taichisoft.base import quaternion_from_matrix
from taichisoft.base.rotations import degrees_from_rotation, rotation_from_degrees, rotation_from_vector

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
