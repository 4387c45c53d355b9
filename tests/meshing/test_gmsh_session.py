"""A session of gmsh: failures are told in one line, and gmsh is closed again."""

import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from taichisoft.errors import MeshError
from taichisoft_meshing.gmsh_session import GmshFailure, gmsh_session


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


def test_a_result_that_is_refused_inside_the_session_names_the_log_too() -> None:
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
