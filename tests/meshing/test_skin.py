"""Naming the surfaces of a hollow body."""

import numpy as np
import pytest

from taichisoft.errors import MeshError
from taichisoft_meshing.skin import name_surfaces


def test_a_body_without_a_cavity_is_refused() -> None:
    nodes = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
    with pytest.raises(MeshError, match="the body has 1 outer skins and 0 cavities; one of each is needed"):
        name_surfaces(nodes, np.array([[0, 1, 2, 3]]))


def test_a_body_in_two_pieces_is_refused() -> None:
    nodes = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
    with pytest.raises(MeshError, match="2 outer skins"):
        name_surfaces(np.vstack([nodes, nodes + 5]), np.array([[0, 1, 2, 3], [4, 5, 6, 7]]))
