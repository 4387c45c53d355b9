"""The normal cone of an edge, and the ball around it that the search for crossing edges trusts."""

from typing import Any

import numpy as np
import pytest
from conftest import examples
from hypothesis import given
from hypothesis import strategies as st

from taichisoft.contact.kernels.contacts import Surfaces
from taichisoft.contact.kernels.vertex_contacts import CONE_TOLERANCE, edge_pseudonormal, in_normal_cone, normal_cone
from taichisoft.runtime import kernel, ti
from taichisoft.runtime.language import Integers, Scalars, Vectors

TURNS = np.linspace(0.0, 2.0 * np.pi, 2000)  # [rad]


@kernel
def measure(
    surfaces: Surfaces,
    position: Vectors,
    direction: Vectors,
    leaves: Integers,
    from_axis: Scalars,
    allowed: Scalars,
):
    ti.loop_config(serialize=True)
    for i in range(direction.shape[0]):
        axis, spread = normal_cone(0, surfaces, position)
        from_axis[i] = (direction[i] - axis).norm()
        allowed[i] = spread
        leaves[i] = 0
        outward = edge_pseudonormal(0, surfaces, position)
        if direction[i].dot(outward) > 0.0:
            leaves[i] = in_normal_cone(0, direction[i], surfaces, position)


def two_triangles(edge_triangles: np.ndarray) -> Surfaces:
    """Triangles 0, 1, 2 and 0, 1, 3 and their common edge; what a cone does not need is empty."""
    nothing: dict[str, Any] = dict.fromkeys(Surfaces._fields, np.zeros(0, dtype=np.int32))
    nothing |= dict.fromkeys(("triangle_edges", "pairs"), np.zeros((0, 0), dtype=np.int32))
    edges, triangles = np.array([[0, 1]], dtype=np.int32), np.array([[1, 0, 2], [0, 1, 3]], dtype=np.int32)
    return Surfaces(**nothing | {"edges": edges, "triangles": triangles, "edge_triangles": edge_triangles})


@pytest.mark.parametrize("triangle_count", [1, 2])
@examples(200)
@given(fold=st.floats(-3.1, 3.1), slant=st.floats(-2.0, 2.0), scale=st.floats(0.1, 100.0))
def test_no_direction_in_the_cone_lies_outside_its_ball(
    triangle_count: int, fold: float, slant: float, scale: float
) -> None:
    """Along x an edge of one triangle, or of two that turn by `fold` [rad], convex or concave; all directions
    across it, and the one midway between the triangles' normals, which is the last to leave the cone of a concave
    edge: when half the fold exceeds what the cone tolerates. Tolerance: round-off. The ball of an edge of two
    triangles is no larger than it need be for 0.1 rad on either side, and flat ones lie in a small one."""
    corners = [[0, 0, 0], [1, 0, 0], [slant, -1, 0], [slant, np.cos(fold), -np.sin(fold)]]
    edge_triangles = np.array([[0, 1 if triangle_count == 2 else -1]], dtype=np.int32)
    turns = np.append(TURNS, 0.5 * (np.pi - fold))
    direction = np.column_stack([np.zeros_like(turns), np.cos(turns), np.sin(turns)])
    leaves, from_axis, allowed = np.zeros(len(turns), dtype=np.int32), np.zeros(len(turns)), np.zeros(len(turns))
    measure(
        two_triangles(edge_triangles),
        scale * np.array(corners, dtype=float),
        direction,
        leaves,
        from_axis,
        allowed,
    )
    assert leaves.any() or (triangle_count == 2 and fold < 1e-9 - 2.0 * np.arcsin(CONE_TOLERANCE))
    assert (from_axis <= allowed + 1e-12)[leaves == 1].all()
    if triangle_count == 2 and fold > 0.0:
        assert allowed[0] <= 2.0 * np.sin(0.25 * fold) + 0.11
        assert from_axis[leaves == 1].max() >= allowed[0] - 0.11
