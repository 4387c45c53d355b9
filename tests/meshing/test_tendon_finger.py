"""The geometry kind `tendon_finger`: what is refused, and that the mesh is the drawing."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import examples
from hypothesis import assume, given
from hypothesis import strategies as st

from taichisoft import VolumeMesh, read_volume_mesh
from taichisoft.errors import MeshError
from taichisoft.mesh import boundary_triangles, tetrahedron_volumes
from taichisoft.scene import data_folder
from taichisoft_meshing.geometry_file import read_tables
from taichisoft_meshing.tendon_finger import TendonFinger, TendonFingerTable

SHIPPED_WITH = "4.15.2"
FILE = data_folder() / "fingers" / "tendon.toml"


def finger(**tables: Any) -> TendonFinger:
    return TendonFinger(tables, Path("finger.toml"))


@pytest.fixture(scope="module")
def mesh() -> VolumeMesh:
    return finger().mesh()


def volume(mesh: VolumeMesh, elements: np.ndarray) -> float:
    return float(tetrahedron_volumes(mesh.nodes, mesh.elements[elements]).sum())


def test_the_defaults_are_the_shipped_finger() -> None:
    kind, tables = read_tables(FILE)
    assert kind == "tendon_finger"
    assert TendonFinger(tables, FILE).table == TendonFingerTable()


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"body": {"length": -1.0}}, "body.length = -1.0: input should be greater than 0"),
        ({"body": {"lenght": 1.0}}, "body.lenght: unknown key; did you mean 'length'?"),
        ({"body": {"tip_height": 23.0}}, "body.tip_height = 23: must be at most 22 (body.height)"),
        ({"body": {"tip_width": 21.0}}, "body.tip_width = 21: must be at most 20 (body.width)"),
        ({"body": {"tip_bevel": 6.5}}, "body.tip_bevel = 6.5: must be at most 6.45 (to leave a face at the tip)"),
        ({"body": {"base_length": 86.0}}, "body.base_length = 86: must be at most 85.9 (to end before the tip's bevel"),
        ({"notches": {"bottom": 9.5}}, "notches.bottom = 9.5: must be at most 9 (notches.width)"),
        ({"notches": {"pitch": 9.0}}, "notches.pitch = 9: must be at least 9.1 (beyond notches.width)"),
        ({"notches": {"first": 18.0}}, "notches.first = 18: must be at least 18.6 (to leave body.base_length uncut)"),
        (
            {"notches": {"count": 4}},
            "notches.count = 4: the last notch would end 91.5 mm from the base; must end before the tip, at most at 85",
        ),
        ({"notches": {"hinge": 15.2}}, "notches.hinge = 15.2: must be at most 15.15 (to leave a notch below it)"),
        ({"mesh": {"smallest": 8.0}}, "mesh.smallest = 8: must be at most 7 (mesh.largest)"),
        ({"mesh": {"largest": 0.1, "smallest": 0.1}}, "mesh.largest = 0.1: must be at least 0.3"),
    ],
)
def test_what_does_not_fit_is_named_with_what_would_be_valid(tables: dict[str, Any], message: str) -> None:
    with pytest.raises(MeshError) as refused:
        finger(**tables)
    assert str(refused.value).startswith(f"finger.toml: {message}")


def test_the_volume_of_a_plain_beam_is_that_of_a_frustum() -> None:
    """Simpson's rule over the length is exact: the cross-section is a product of two linear functions."""
    body = {"length": 90.0, "height": 22.0, "tip_height": 13.0, "width": 20.0, "tip_width": 14.0, "tip_bevel": 0.0}
    plain = finger(body=body, notches={"count": 0}).table
    assert plain.volume == pytest.approx(90.0 / 6.0 * (22.0 * 20.0 + 4.0 * 17.5 * 17.0 + 13.0 * 14.0), rel=1e-12)


def test_the_groups_are_the_skin_the_base_and_what_is_held(mesh: VolumeMesh) -> None:
    """The held block is a frustum of 14 mm; elements end at its end, so that its volume is exact."""
    assert len(mesh.surface_groups["outer"]) == len(boundary_triangles(mesh.elements))
    assert (mesh.nodes[mesh.surface_groups["base"], 0] == 0.0).all()
    end_height, end_width = 22.0 - 9.0 * 14.0 / 90.0, 20.0 - 6.0 * 14.0 / 90.0
    middle = (22.0 + end_height) * (20.0 + end_width)  # four times that in the middle
    held = 14.0 / 6.0 * (22.0 * 20.0 + middle + end_height * end_width)
    assert volume(mesh, mesh.element_groups["base_block"]) == pytest.approx(held, rel=1e-6)
    assert len(mesh.element_groups["silicone"]) == len(mesh.elements)


def test_hinges_are_meshed_finer_and_a_size_scales_both(mesh: VolumeMesh) -> None:
    middle = mesh.nodes[mesh.elements].mean(axis=1)
    volumes = tetrahedron_volumes(mesh.nodes, mesh.elements)
    in_hinge = (np.abs(middle[:, 0] + 45.0) < 1.5) & (middle[:, 1] > 13.5)
    in_phalanx = np.abs(middle[:, 0] + 55.5) < 3.0
    assert np.median(volumes[in_hinge]) < 0.5 * np.median(volumes[in_phalanx])
    assert len(finger().mesh(5.0).nodes) > 1.5 * len(mesh.nodes)


def test_the_same_dimensions_give_the_same_mesh(mesh: VolumeMesh) -> None:
    again = finger().mesh()
    np.testing.assert_array_equal(again.nodes, mesh.nodes)
    np.testing.assert_array_equal(again.elements, mesh.elements)


def test_shipped_mesh_is_the_shipped_fingers_coarse_mesh() -> None:
    """`taichisoft mesh tendon --preset coarse -o FILE.msh`."""
    import gmsh

    if gmsh.__version__ != SHIPPED_WITH:
        pytest.skip(f"the shipped mesh is by gmsh {SHIPPED_WITH}; {gmsh.__version__} may mesh otherwise")
    made = finger().mesh(finger().presets["coarse"])
    shipped = read_volume_mesh(data_folder() / "meshes" / "tendon-coarse.msh")
    np.testing.assert_array_equal(made.nodes, shipped.nodes)
    np.testing.assert_array_equal(made.elements, shipped.elements)
    np.testing.assert_array_equal(made.element_groups["base_block"], shipped.element_groups["base_block"])


def lengths(low: float, high: float) -> st.SearchStrategy[float]:
    return st.integers(round(10 * low), round(10 * high)).map(lambda tenths: tenths / 10)


@examples(30)
@given(
    body=st.fixed_dictionaries(
        {
            "length": lengths(60, 120),
            "height": lengths(15, 30),
            "tip_height": lengths(8, 30),
            "width": lengths(10, 30),
            "tip_width": lengths(8, 30),
            "tip_bevel": lengths(0, 4),
        }
    ),
    notches=st.fixed_dictionaries(
        {"count": st.integers(0, 5), "pitch": lengths(8, 30), "width": lengths(3, 15), "hinge": lengths(2, 8)}
    ),
)
def test_accepted_finger_is_meshed_with_its_drawn_volume(body: dict[str, Any], notches: dict[str, Any]) -> None:
    """`mesh` compares the volumes, to 1e-6."""
    try:
        made = finger(body=body, notches=notches, mesh={"largest": 8.0, "smallest": 4.0})
    except MeshError:
        assume(False)
    assert volume(made.mesh(), slice(None)) == pytest.approx(made.table.volume, rel=1e-6)
