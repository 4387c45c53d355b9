"""gmsh: a session that leaves nothing behind, and fingers meshed in it."""

import os
import re
import subprocess
import sys
import tempfile
import threading
from pathlib import Path

import numpy as np
import pytest
from fingers import read_finger

from taichisoft import VolumeMesh, read_volume_mesh
from taichisoft.errors import MeshError
from taichisoft.scene import data_folder
from taichisoft_meshing import pneunet_finger as finger_solid
from taichisoft_meshing.finger_dimensions import ElementSizes, FingerParameters
from taichisoft_meshing.gmsh_session import GmshFailure, gmsh_session
from taichisoft_meshing.pneunet_finger import mesh_finger
from taichisoft_meshing.wall_quality import radius_ratios


@pytest.fixture(autouse=True)
def logs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


def test_gmshs_own_failure_names_the_file_with_its_log(logs: Path) -> None:
    import gmsh

    with pytest.raises(MeshError) as refused, gmsh_session("this box") as session:
        session.model.occ.addBox(0, 0, 0, 1, 1, 1)
        session.model.occ.synchronize()
        session.model.mesh.generate(1)
        session.model.occ.cut([(3, 1)], [(3, 7)])
    message = str(refused.value)
    assert message.startswith("gmsh cannot mesh this box: Unknown OpenCASCADE entity of dimension 3 with tag 7; ")
    named = re.search(r"gmsh's log is (\S+)$", message)
    assert named is not None
    log = Path(named[1]).read_text()
    assert "Meshing 1D" in log
    assert "Error" in log
    assert list(logs.iterdir()) == [Path(named[1])]
    assert not gmsh.isInitialized()


def test_refusal_inside_a_session_names_the_log() -> None:
    with pytest.raises(MeshError, match=r"^gmsh cannot mesh this box: nothing came out; "), gmsh_session("this box"):
        raise GmshFailure("nothing\ncame out")


def test_other_errors_pass_and_leave_no_log(logs: Path) -> None:
    import gmsh

    for other in (MeshError("length = 0"), TypeError("a slip of the pen")):
        with pytest.raises(type(other), match=str(other)), gmsh_session("this box"):
            raise other
        assert not gmsh.isInitialized()
    assert list(logs.iterdir()) == []


def test_a_log_that_cannot_be_written_hides_no_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", "/nowhere")
    refused = pytest.raises(MeshError, match="this box: it failed; gmsh's log cannot be written: No such file")
    with refused, gmsh_session("this box"):
        raise GmshFailure("it failed")


def test_gmsh_in_use_by_the_caller_is_left_alone() -> None:
    import gmsh

    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        with pytest.raises(MeshError, match="gmsh is already in use in this process"), gmsh_session("this box"):
            pass
        assert gmsh.isInitialized()
    finally:
        gmsh.finalize()


BROKEN_PIPE = """
import os, threading
from taichisoft_meshing.gmsh_session import gmsh_session

def mesh():
    with gmsh_session("nothing"):
        pass

{how}
reading, writing = os.pipe()
os.close(reading)
try:
    os.write(writing, b"nobody reads this")
except BrokenPipeError:
    print("an error, as ever")
"""


@pytest.mark.skipif(os.name != "posix", reason="signals")
@pytest.mark.parametrize("how", ["mesh()", "thread = threading.Thread(target=mesh); thread.start(); thread.join()"])
def test_a_broken_pipe_does_not_end_the_process_after_meshing(how: str) -> None:
    """The pipe stands for that of a video's encoder or of a web page, in a run that meshed its finger first."""
    process = subprocess.run([sys.executable, "-c", BROKEN_PIPE.format(how=how)], capture_output=True, text=True)
    assert (process.returncode, process.stdout) == (0, "an error, as ever\n"), process.stderr


# The finger that gmsh makes is the same every time; tests/meshing/test_finger.py has the volumes and skins of any.

# Versions of gmsh differ in the meshes that they make.
SHIPPED_WITH = "4.15.2"


def even(size: float) -> ElementSizes:
    return ElementSizes(largest=size, smallest=size)


@pytest.fixture(scope="module")
def tutorial() -> VolumeMesh:
    return mesh_finger(FingerParameters())


def test_the_cavity_lies_where_the_tutorial_has_it(tutorial: VolumeMesh) -> None:
    wall = tutorial.nodes[np.unique(tutorial.surface_groups["cavity"])]
    np.testing.assert_allclose(wall.min(axis=0), [-99, 8.5, -7.5], atol=1e-9)
    np.testing.assert_allclose(wall.max(axis=0), [-16, 22, 7.5], atol=1e-9)


def test_no_element_is_nearly_flat(tutorial: VolumeMesh) -> None:
    """Slivers invert first in a large bend. 0.2 is what this size gives; a size of 12 mm would give 0.1."""
    ratios = radius_ratios(tutorial.nodes, tutorial.elements)
    assert ratios.min() > 0.2
    assert np.median(ratios) > 0.6


def test_the_same_parameters_give_the_same_mesh(tutorial: VolumeMesh) -> None:
    """Node for node, also after another mesh was made and from another thread."""
    other = mesh_finger(FingerParameters(mesh=ElementSizes(largest=14.0, smallest=6.0)))
    assert len(other.nodes) != len(tutorial.nodes)
    made: list[VolumeMesh] = []
    thread = threading.Thread(target=lambda: made.append(mesh_finger(FingerParameters())))
    thread.start()
    thread.join()
    np.testing.assert_array_equal(made[0].nodes, tutorial.nodes)
    np.testing.assert_array_equal(made[0].elements, tutorial.elements)


@pytest.mark.parametrize(("name", "size"), [("tutorial-coarse", 10.0), ("tutorial-medium", 5.0)])
def test_the_shipped_meshes_are_even_ones_of_the_shipped_finger(name: str, size: float) -> None:
    """`taichisoft mesh tutorial --set mesh.largest=10 --set mesh.smallest=10 -o FILE.msh`, and 5."""
    import gmsh

    if gmsh.__version__ != SHIPPED_WITH:
        pytest.skip(f"the shipped meshes are by gmsh {SHIPPED_WITH}; {gmsh.__version__} may mesh otherwise")
    finger = read_finger(data_folder() / "fingers" / "tutorial.toml")
    made = mesh_finger(finger.model_copy(update={"mesh": even(size)}))
    shipped = read_volume_mesh(data_folder() / "meshes" / f"{name}.msh")
    np.testing.assert_array_equal(made.elements, shipped.elements)
    np.testing.assert_array_equal(made.nodes, shipped.nodes)
    for groups in ("surface_groups", "element_groups"):
        assert list(getattr(made, groups)) == list(getattr(shipped, groups))
        for group, members in getattr(shipped, groups).items():
            np.testing.assert_array_equal(members, getattr(made, groups)[group])


def test_a_smaller_size_at_the_cavity_refines_there(tutorial: VolumeMesh) -> None:
    finer = mesh_finger(FingerParameters(mesh=ElementSizes(largest=18.0, smallest=5.0)))
    assert len(finer.surface_groups["cavity"]) > 1.5 * len(tutorial.surface_groups["cavity"])
    assert len(finer.surface_groups["base"]) <= 1.5 * len(tutorial.surface_groups["base"])


def test_a_solid_of_another_volume_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """OpenCASCADE may leave out a slot without a word; here the slots are hidden from it."""
    monkeypatch.setattr(finger_solid, "slot_boxes", lambda finger: [])
    with pytest.raises(MeshError, match=r"OpenCASCADE gave a solid of 56112\.5 mm\^3 instead of 51162\.5"):
        mesh_finger(FingerParameters())


def test_a_mesh_of_another_volume_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(finger_solid, "slot_boxes", lambda finger: [])
    monkeypatch.setattr(finger_solid, "VOLUME_TOLERANCE", 1.0)
    with pytest.raises(
        MeshError, match=r"^finger.toml .*: silicone has 56112\.5 mm\^3 in the mesh instead of 51162\.5"
    ):
        mesh_finger(FingerParameters(), "finger.toml")
