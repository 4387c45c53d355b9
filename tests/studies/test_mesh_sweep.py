"""`taichisoft mesh sweep`: every variant a mesh, in processes of their own; what fails stops nothing else."""

import csv
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from conftest import PATIENCE, Command
from studies import made_apart

from taichisoft import load_plugin
from taichisoft.errors import MeshError
from taichisoft.running import locked_folder
from taichisoft_meshing.mesh_job import MeshJob
from taichisoft_studies.errors import StudyError
from taichisoft_studies.mesh_variants import MeshRun, Variant, plan
from taichisoft_studies.study_file import MOST, Sweep, check_study, varied

pytestmark = pytest.mark.usefixtures("taichisoft_plugins")

PLUGIN = Path(__file__).parents[1] / "meshing" / "block_kind.py"
JOB = MeshJob("block", {"stretch": 1.0}, Path("block.toml"), {})


def variants_of(job: MeshJob, texts: list[str]) -> list[Variant]:
    """The variants of options --vary."""
    return plan(job, check_study(Sweep, {"scene": "block", "vary": varied(texts)}, "mesh sweep").vary)


def sweep_process(file: Path | str, output: Path, *arguments: str) -> subprocess.Popen[str]:
    options = ["-o", str(output), "--plugin", str(PLUGIN), *arguments]
    return subprocess.Popen(
        [sys.executable, "-m", "taichisoft", "mesh", "sweep", str(file), *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


@pytest.fixture
def block(tmp_path: Path) -> Path:
    path = tmp_path / "block.toml"
    path.write_text('kind = "block"\nsolid = true\n')
    return path


def test_variants_are_all_combinations() -> None:
    variants = variants_of(JOB, ["stretch=1,2.5", "quality.radius_ratio=0.1,0.2"])
    assert [variant.name for variant in variants] == [
        "stretch-1_quality.radius_ratio-0.1",
        "stretch-1_quality.radius_ratio-0.2",
        "stretch-2.5_quality.radius_ratio-0.1",
        "stretch-2.5_quality.radius_ratio-0.2",
    ]
    assert variants[2].job.tables == {"stretch": 2.5, "quality": {"radius_ratio": 0.1}}
    assert JOB.tables == {"stretch": 1.0}


def test_variants_take_any_toml() -> None:
    tables = [variant.job.tables["stretch"] for variant in variants_of(JOB, ['stretch=[1, 2], [3, 4] ,"a,b"'])]
    assert tables == [[1, 2], [3, 4], "a,b"]
    assert [variant.job.tables["stretch"] for variant in variants_of(JOB, ["stretch=true,round"])] == [True, "round"]


@pytest.mark.parametrize(
    ("texts", "problem"),
    [
        (["stretch"], "--vary stretch: must look like body.width=20,22,25"),
        (["stretch="], "--vary stretch=: must look like"),
        (["stretch=1,,2"], "--vary stretch=1,,2: must look like"),
        (["=1,2"], "--vary =1,2: must look like"),
        (["stretch=1,2,1"], "vary.stretch: the value 1 is given twice"),
        (["stretch=1,2", "stretch=3"], "--vary stretch: is given twice; put its values into one list"),
        (["stretch.x=1"], "stretch is not a table: it has no 'x'"),
        (["stretch=" + ",".join(map(str, range(MOST + 1)))], "values are more than the 10000"),
        (["stretch=1:2:1000000000"], "vary: 1000000000 combinations are more than the 10000"),
        (["stretch=1:2"], "vary.stretch: a range needs count"),
        (["stretch=1:x:3"], "--vary stretch=1:x:3: a range must look like 0.2:1.0:5"),
        (["stretch=5:1:3"], "vary.stretch: low (5) must be below high (1)"),
        (["stretch=1:nan:3"], "vary.stretch.high = nan: "),
        (["stretch=1:2:0"], "vary.stretch.count = 0: "),
        (["stretch=a/b,a:b"], "--vary: two variants would both be called 'stretch-a_b'"),
    ],
)
def test_wrong_variants_are_refused(texts: list[str], problem: str) -> None:
    with pytest.raises((MeshError, StudyError)) as refused:
        variants_of(JOB, texts)
    assert problem in str(refused.value)


def test_failed_variants_stop_no_others(block: Path, tmp_path: Path) -> None:
    """Two are not valid, one misses a limit; the kind is a plug-in's."""
    output = tmp_path / "out"
    process = sweep_process(
        block, output, "--vary", "stretch=1.5,0", "--vary", "quality.radius_ratio=0.3,0.99", "--jobs", "2"
    )
    shown, error = process.communicate(timeout=PATIENCE)
    assert process.returncode == 1, error
    assert error == f"taichisoft: {output}: 3 of 4 variants failed\n"
    name = "stretch-1.5_quality.radius_ratio-0.3"
    assert sorted(file.name for file in output.iterdir()) == [name, "summary.csv"]
    with (output / "summary.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["stretch"] for row in rows] == ["1.5", "1.5", "0", "0"]
    assert [float(row["silicone_mm3"] or 0) for row in rows] == [187500, 0, 0, 0]
    assert [row["folder"] for row in rows] == [name, "", "", ""]
    assert rows[1]["problem"].startswith(f"{block}: the smallest radius ratio, 0.6609, is below quality.radius_ratio")
    assert rows[2]["problem"] == f"{block}: stretch = 0: must be positive"
    assert f"failed: {block}: stretch = 0: must be positive" in shown
    assert (output / name / f"{name}.msh").is_file()


def mesh_run(folder: Path, block: Path, time_limit: float = PATIENCE, **tables: Any) -> MeshRun:
    job = MeshJob("block", {"solid": True, **tables}, block, {})
    return MeshRun("block", str(folder), job, False, (str(PLUGIN),), time_limit)


def test_lost_process_is_a_failed_variant(block: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    (died,) = made_apart([mesh_run(out, block, end=7)])
    assert died["problem"] == f"{block}: process lost: exit code 7"
    (hung,) = made_apart([mesh_run(out, block, after=600, time_limit=1.0)])
    assert hung["problem"] == f"{block}: timeout: not done within 1 s"
    assert not out.exists() or not list(out.iterdir())


def test_existing_mesh_is_kept(block: Path, tmp_path: Path) -> None:
    load_plugin(PLUGIN)
    first, second, other = (mesh_run(tmp_path, block, stretch=s).make() for s in (1.5, 1.5, 2.0))
    assert first["figures"].pop("seconds") >= 0.0
    assert second == first
    assert other["figures"]["silicone_mm3"] == 250000
    assert "seconds" in other["figures"]


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_ctrl_c_keeps_complete_meshes(block: Path, tmp_path: Path) -> None:
    """A terminal sends the signal to the whole group of processes."""
    output = tmp_path / "out"
    process = sweep_process(block, output, "--vary", "after=0,300", "--jobs", "2")
    complete = output / "after-0" / "mesh.json"
    while not complete.exists() and process.poll() is None:
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGINT)
    _, error = process.communicate(timeout=PATIENCE)
    assert process.returncode == 130
    assert "Traceback" not in error
    assert [file.name for file in output.iterdir()] == ["after-0"]
    assert len(list((output / "after-0").iterdir())) == 6
    wait_for_the_end_of_group(process.pid)


def wait_for_the_end_of_group(leader: int) -> None:
    """Returns when no process of the group is left; a test that waits for ever has failed."""
    with pytest.raises(ProcessLookupError):
        while True:
            os.killpg(leader, 0)
            time.sleep(0.05)


def test_locked_folder_is_refused(block: Path, tmp_path: Path, command: Command) -> None:
    """Two, perhaps on two machines, would mix the files of different meshes of the same name."""
    output = tmp_path / "out"
    with locked_folder(output):
        _, _, error = command("mesh", "sweep", block, "-o", output, "--plugin", PLUGIN, "--vary", "stretch=1")
        assert error.startswith(f"taichisoft: --output {output}: a run is going on there (process {os.getpid()} on ")
    assert not output.exists()


def test_wrong_jobs_are_refused(tmp_path: Path, command: Command) -> None:
    words = ["mesh", "sweep", "block.toml", "-o", tmp_path / "out", "--vary", "stretch=1", "--jobs", "0"]
    assert command(*words) == (2, "", "taichisoft: --jobs 0: must be at least 1\n")
    assert not (tmp_path / "out").exists()
