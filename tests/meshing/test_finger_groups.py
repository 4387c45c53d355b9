"""Groups of a finger's mesh, which scenes select by name: they hold what a box would."""

import numpy as np
import pytest
from fingers import finger_from_dict

from taichisoft import VolumeMesh
from taichisoft.errors import MeshError
from taichisoft.mechanics import select_nodes
from taichisoft.mechanics.selection import select_elements
from taichisoft.scene.soft_body import NodeSelection, Selection
from taichisoft_meshing.finger_dimensions import ElementSizes, FingerParameters
from taichisoft_meshing.pneunet_finger import mesh_finger

BASE = NodeSelection(box=((-10.0, 0.0, -20.0), (0.0, 30.0, 20.0)))
STIFF_LAYER = Selection(box=((-100.0, 22.5, -8.0), (-19.0, 28.0, 8.0)))


@pytest.fixture(
    scope="module", params=[ElementSizes(), ElementSizes(largest=10.0, smallest=10.0)], ids=["graded", "even"]
)
def mesh(request: pytest.FixtureRequest) -> VolumeMesh:
    return mesh_finger(FingerParameters(mesh=request.param))


def test_the_stiff_layer_is_what_the_tutorials_box_selects(mesh: VolumeMesh) -> None:
    by_group = select_elements(mesh, Selection(group="stiff_layer"), "regions.0")
    assert np.array_equal(by_group, select_elements(mesh, STIFF_LAYER, "regions.0"))


def test_the_base_block_holds_no_node_that_the_tutorials_box_does_not(mesh: VolumeMesh) -> None:
    by_group = select_nodes(mesh, NodeSelection(group="base_block"), "anchors.0")
    assert set(by_group) <= set(select_nodes(mesh, BASE, "anchors.0"))
    assert set(select_nodes(mesh, NodeSelection(group="base"), "anchors.0")) <= set(by_group)


def test_a_graded_mesh_ends_at_the_base_block() -> None:
    mesh = mesh_finger(FingerParameters())
    by_group = select_nodes(mesh, NodeSelection(group="base_block"), "anchors.0")
    assert np.array_equal(by_group, select_nodes(mesh, BASE, "anchors.0"))
    held = mesh.elements[mesh.element_groups["base_block"]]
    edges = mesh.nodes[held[:, 1:]] - mesh.nodes[held[:, :1]]
    assert np.linalg.det(edges).sum() / 6 == pytest.approx(10 * 30 * 20, rel=1e-9)


def test_a_finger_without_stiff_layer_has_no_such_group() -> None:
    assert set(mesh_finger(finger_from_dict({"stiff_layer": {"thickness": 0.0}})).element_groups) == {
        "silicone",
        "base_block",
    }


def test_a_layer_thinner_than_the_elements_is_refused() -> None:
    thin = finger_from_dict({"stiff_layer": {"thickness": 0.01, "start": 20.0, "end": 20.5}})
    with pytest.raises(MeshError) as refused:
        mesh_finger(thin, "finger.toml")
    assert str(refused.value) == (
        "finger.toml: stiff_layer.thickness = 0.01: no element has its middle in the layer; must be larger, or 0 for "
        "none, or mesh.largest = 18 smaller"
    )
