"""Sweeps: what runs there are, that each is made once, and that kills and the order of ending change nothing."""

import errno
import json
import os
import re
import socket
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from interrupted_sweep import interrupted_sweep
from studies import Here, made_apart, sweep_of

from taichisoft import load_plugin
from taichisoft.errors import MeshError, PluginError, SceneError
from taichisoft.pytest_fixtures import TINY_GRIPPER
from taichisoft_studies import study_file
from taichisoft_studies.errors import StudyError
from taichisoft_studies.least_squares import Calibration
from taichisoft_studies.optimiser import Optimisation
from taichisoft_studies.results_table import WALL_CLOCK, read_table, result_row, write_table
from taichisoft_studies.run_job import COMPLETED, ERROR, PRUNED, REASONS, read_record, reason, run_hash
from taichisoft_studies.study_file import (
    Range,
    Sample,
    Study,
    Sweep,
    check_study,
    combinations,
    read_tables,
    scene_with,
    varied,
)
from taichisoft_studies.sweep_runs import make_missing, sweep_jobs
from taichisoft_studies.workers import UNSURE

pytestmark = pytest.mark.usefixtures("taichisoft_plugins")


@pytest.mark.parametrize("method", ["lhs", "sobol", "random"])
def test_samples_lie_in_ranges_and_repeat(method: Any) -> None:
    values = {"a": Range(low=1.0, high=100.0, log=True), "b": Range(low=1, high=3, integer=True), "c": ("x", "y")}
    sample = Sample(method=method, count=64)
    rows = combinations(values, sample, seed=3)
    assert rows == combinations(values, sample, seed=3) != combinations(values, sample, seed=4)
    assert all(1.0 <= row["a"] <= 100.0 for row in rows)
    assert {row["b"] for row in rows} == {1, 2, 3}
    assert {row["c"] for row in rows} == {"x", "y"}


@given(st.integers(1, 50), st.integers(0, 1000))
def test_hypercube_has_a_value_in_each_stratum(count: int, seed: int) -> None:
    rows = combinations({"a": Range(low=0.0, high=1.0)}, Sample(count=count), seed)
    assert sorted(min(int(row["a"] * count + 1e-9), count - 1) for row in rows) == list(range(count))


def test_grid_varies_the_last_key_fastest() -> None:
    rows = combinations({"a": (1, 2), "b": Range(low=0.2, high=1.0, count=3)}, None, 1)
    assert [(row["a"], row["b"]) for row in rows] == [(1, 0.2), (1, 0.6), (1, 1.0), (2, 0.2), (2, 0.6), (2, 1.0)]


@pytest.mark.parametrize(
    ("vary", "count"),
    [
        ({"a": Range(low=0.0, high=1.0, count=10**9)}, 10**9),
        ({"a": Range(low=0.0, high=1.0, count=10**5), "b": Range(low=0.0, high=1.0, count=10**4)}, 10**9),
        ({"a": Range(low=0, high=10**9 - 1, count=10**12, integer=True)}, 10**9),
    ],
)
def test_too_many_runs_are_refused_early(vary: dict[str, Any], count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """The list of them would take 8 GB."""
    monkeypatch.setattr(study_file, "grid", None)
    with pytest.raises(StudyError, match=f"^vary: {count} combinations are more than the 10000 that a sweep may have$"):
        combinations(vary, None, 1)


def test_whole_range_has_each_number_once() -> None:
    expected = [{"a": value} for value in range(-2, 4)]
    assert combinations({"a": Range(low=-2, high=3, count=10**15, integer=True)}, None, 1) == expected
    assert combinations({"a": Range(low=-2, high=3, count=6, integer=True)}, None, 1) == expected


def test_options_give_values() -> None:
    assert varied(["a=[1, 2],3", "b=0.2:1.0:5", 'c="x:y",z']) == {
        "a": [[1, 2], 3],
        "b": {"low": 0.2, "high": 1.0, "count": 5},
        "c": ["x:y", "z"],
    }


PRESSURE = "controller.settings.pressure"
BASES: dict[type[Study], dict[str, Any]] = {
    Study: {},
    Sweep: {"vary": {"a": [1]}},
    Optimisation: {
        "variables": {PRESSURE: {"low": 0.0, "high": 10.0}},
        "objectives": {"steps": {"minimise": "steps"}},
    },
    Calibration: {
        "parameters": {"a": {"start": 2.0, "low": 1.0, "high": 3.0}},
        "experiments": [{"curves": [{"column": "a", "quantity": "time"}]}],
    },
}


@pytest.mark.parametrize(
    ("kind", "tables", "problem"),
    [
        (Study, {"cluster": {"slurm": {}}}, "cluster.slurm: unknown key"),
        (Study, {"cluster": {"dashboard": "127.0.0.1:0"}}, "cluster.dashboard: unknown key"),
        (Sweep, {"seeed": 2}, "seeed: unknown key; did you mean 'seed'?"),
        (Sweep, {"vary": {}}, "vary has no key; name what varies"),
        (Sweep, {"vary": {"a": {"low": 2, "high": 1}}}, "vary.a: low (2) must be below high (1)"),
        (Sweep, {"vary": {"a": {"low": 1, "high": 2}}}, "vary.a: a range needs count, unless there is a table [sample"),
        (Sweep, {"vary": {"a": {"low": 1, "high": 2, "cuont": 3}}}, "vary.a.cuont: unknown key; did you mean 'count'?"),
        (Sweep, {"vary": {"a": [1, 1]}}, "vary.a: the value 1 is given twice"),
        (Optimisation, {"objectives": {}}, "objectives has no key"),
        (Optimisation, {"objectives": {"a": {}}}, "objectives.a: exactly one of maximise, minimise is needed"),
        (
            Optimisation,
            {"sampler": "cmaes", "constraints": {"a": "b <= 1"}},
            "sampler = 'cmaes' knows one objective and no constraints",
        ),
        (
            Optimisation,
            {"start": {"controller.settings.presure": 1}},
            f"start.controller.settings.presure is not a variable; did you mean '{PRESSURE}'?",
        ),
        (Optimisation, {"scenes": {"a b": {}}}, "scenes.a b: expressions need a name of letters and digits"),
        (Optimisation, {"scenes": {"a": {}}, "pruning": {"every": 1.0}}, "pruning watches a single run"),
        (Optimisation, {"scenes": {"a": {"scen": "b"}}}, "scenes.a.scen"),
        (Optimisation, {"sampler": "annealing"}, "sampler = 'annealing'"),
        (
            Optimisation,
            {"variables": {PRESSURE: {"low": 0, "high": 1, "count": 3}}},
            f"variables.{PRESSURE}.count has no effect",
        ),
        (
            Calibration,
            {"parameters": {"a": {"start": 5.0, "low": 10.0, "high": 20.0}}},
            "parameters.a: start (5) must lie between low (10)",
        ),
        (Calibration, {"experiments": []}, "experiments = []: at least 1 is needed"),
    ],
)
def test_wrong_study_names_its_key(kind: type[Study], tables: dict[str, Any], problem: str) -> None:
    with pytest.raises(StudyError) as refused:
        check_study(kind, {"scene": "gripper", **BASES[kind], **tables}, "study")
    assert str(refused.value).startswith(f"study: {problem}")


def test_keys_may_be_tables_or_dotted(tmp_path: Path) -> None:
    path = tmp_path / "study.toml"
    path.write_text(
        'scene = "gripper"\n[vary]\nbody.width = [1]\n"contact.friction" = {low = 0.1, high = 1, count = 2}'
    )
    assert set(read_tables(path)["vary"]) == {"body.width", "contact.friction"}


def test_geometry_keys_reach_every_body() -> None:
    scene = scene_with(
        "gripper",
        {
            "soft_bodies.finger1.mesh": {"file": "tutorial.toml", "size": 14.0},
            "body.width": 22,
            "contact.friction": 0.3,
        },
        None,
    )
    assert scene.contact.friction == 0.3
    assert [body.mesh.request for body in scene.soft_bodies.values()] == [
        {"size": 14.0, "set": {"body": {"width": 22}}}
    ] * 3
    with pytest.raises(StudyError, match="no soft body of gripper is meshed from a geometry file"):
        scene_with("gripper", {"body.width": 22}, None)
    with pytest.raises(SceneError, match=r"contact.frction: unknown key; did you mean 'friction'"):
        scene_with("gripper", {"contact.frction": 0.3}, None)


def test_sizes_of_step_files_vary(tmp_path: Path) -> None:
    """The size that a scene asks for gives way to a varied one; nothing else of its table does."""
    (tmp_path / "finger.step").write_text("")
    mesh = '{ file = "finger.step", size = 9.0, set = { close_inlets = true, mesh = { wall_ratio = 1.5 } } }'
    body = "density = 1e-6, young_modulus = 100.0, poisson_ratio = 0.3"
    (tmp_path / "scene.toml").write_text(f"soft_bodies = {{ finger = {{ mesh = {mesh}, {body} }} }}")
    for values, asked, sizes in (
        ({"mesh.largest": 6.0}, {}, {"largest": 6.0, "wall_ratio": 1.5}),
        ({"finger:mesh.curvature": 24}, {"size": 9.0}, {"curvature": 24, "wall_ratio": 1.5}),
    ):
        request = scene_with(str(tmp_path / "scene.toml"), values, None).soft_bodies["finger"].mesh.request
        assert request == {**asked, "set": {"close_inlets": True, "mesh": sizes}}


def test_unknown_dimension_is_refused_first(tmp_path: Path) -> None:
    mesh = "soft_bodies.finger.mesh={file='tutorial.toml', size=14}"
    study = sweep_of(tmp_path, scene="finger-inflated", controller=None, set=[mesh], vary={"body.widht": [20, 22]})
    with pytest.raises(MeshError, match=r"body.widht: unknown key; did you mean 'width'"):
        sweep_jobs(study, tmp_path)


def test_hash_counts_contents_of_files(tmp_path: Path) -> None:
    first, second = tmp_path / "a" / "pad.msh", tmp_path / "b" / "other.msh"
    for path in (first, second):
        path.parent.mkdir()
        path.write_bytes((TINY_GRIPPER.parent / "pad.msh").read_bytes())
    hashes = [
        run_hash(scene_with(str(TINY_GRIPPER), {"soft_bodies.left.mesh": str(one)}, None), None, 1, ())
        for one in (first, second)
    ]
    assert hashes[0] == hashes[1]
    second.write_bytes(second.read_bytes() + b"\n")
    changed = scene_with(str(TINY_GRIPPER), {"soft_bodies.left.mesh": str(second)}, None)
    assert run_hash(changed, None, 1, ()) != hashes[0]
    assert len({run_hash(changed, duration, seed, ()) for duration in (None, 1.0) for seed in (1, 2)}) == 4


def test_runs_are_made_once(tmp_path: Path) -> None:
    """One value is fine, one is no number for the controller; both have ended."""
    study = sweep_of(tmp_path, vary={"controller.settings.pressure": [1.0, "high"]})
    jobs, workers = sweep_jobs(study, tmp_path), Here()
    records = make_missing(jobs, workers)
    assert [record["status"] for record in records] == ["completed", "scene refused"]
    assert read_record(jobs[1].place) == records[1]
    assert "high" in records[1]["message"]
    assert len(workers.made) == 2
    assert make_missing(jobs, workers) == records
    assert len(workers.made) == 2
    more = sweep_jobs(sweep_of(tmp_path, vary={"controller.settings.pressure": [1.0, 2.0]}), tmp_path)
    make_missing(more, workers)
    assert workers.made[2:] == [more[1].name]


FULL = """
import errno
from pathlib import Path
from taichisoft import Control, Controller, hookimpl

class Full(Controller):
    def __init__(self, disk: str):
        if (Path(disk) / "full").exists():
            raise OSError(errno.ENOSPC, "No space left on device", "somewhere")
    def control(self, observation):
        return Control()

@hookimpl
def taichisoft_controllers():
    return {"full": Full}
"""


def test_run_on_a_full_disk_is_repeated(tmp_path: Path) -> None:
    """And only such a one: a run that has completed, or whose controller failed, has ended."""
    path, disk = tmp_path / "plugin_of_full.py", tmp_path / "full"
    path.write_text(FULL)
    values = {"controller.settings.disk": [str(tmp_path), "nowhere"]}
    study = sweep_of(tmp_path, controller="full", plugins=[str(path)], vary=values)
    jobs, workers = sweep_jobs(study, tmp_path), Here()
    disk.touch()
    records = make_missing(jobs, workers)
    assert [record["status"] for record in records] == ["error", "completed"]
    assert "No space left on device" in records[0]["message"]
    disk.unlink()
    records = make_missing(jobs, workers)
    assert [record["status"] for record in records] == ["completed"] * 2
    make_missing(jobs, workers)
    assert workers.made[2:] == [jobs[0].name]


def test_unwritable_folder_is_one_line(tmp_path: Path, capfd: Any) -> None:
    """A disk may be so full that not even the record of a run can be written: the study ends, to be started again."""
    study = sweep_of(tmp_path, vary={"controller.settings.pressure": [1.0]})
    (job,) = sweep_jobs(study, tmp_path)
    Path(job.folder).write_text("a file where the folder should be")
    with pytest.raises(StudyError, match=rf"^run {job.name}: .*: cannot be written: "):
        made_apart([job])
    assert capfd.readouterr().err == ""


def caused(error: Exception, cause: Exception) -> Exception:
    error.__cause__ = cause
    return error


@pytest.mark.parametrize(
    ("error", "status"),
    [
        (OSError(errno.ENOSPC, "No space left on device"), "error"),
        (MemoryError(), "error"),
        (ZeroDivisionError(), "error"),
        (caused(MeshError("a.msh: cannot be written"), OSError(errno.EDQUOT, "Disk quota exceeded")), "error"),
        (caused(SceneError("mesh"), caused(MeshError("a.msh"), OSError(errno.EIO, "Input/output error"))), "error"),
        (caused(PluginError("failed"), MemoryError()), "error"),
        (caused(MeshError("a.toml: its process"), ChildProcessError("ended by SIGKILL")), "error"),
        (caused(MeshError("a.msh: no such file"), FileNotFoundError(errno.ENOENT, "No such file")), "mesh refused"),
        (caused(SceneError("mesh"), MeshError("a.msh: an element is inverted")), "mesh refused"),
        (MeshError("a.msh: an element is inverted"), "mesh refused"),
    ],
)
def test_shortage_of_the_machine_is_an_error(error: Exception, status: str) -> None:
    assert reason(error) == status


def test_every_status_is_documented() -> None:
    document = (Path(__file__).parents[2] / "docs" / "studies.md").read_text(encoding="utf-8")
    table, _, _ = document[document.index("| status |") :].partition("\n\n")
    listed = set(re.findall(r"`([a-z -]+)`", table))
    assert {name for _, name in REASONS} | {COMPLETED, PRUNED, ERROR, *UNSURE} <= listed


def test_run_without_an_output_is_repeated(tmp_path: Path) -> None:
    study = sweep_of(tmp_path, vary={"controller.settings.pressure": [1.0]})
    (job,) = sweep_jobs(study, tmp_path)
    (recorded,) = sweep_jobs(study.model_copy(update={"outputs": ("recording",)}), tmp_path)
    assert job.name == recorded.name
    workers = Here()
    for one in (job, recorded, job):
        make_missing([one], workers)
    assert len(workers.made) == 2
    assert (job.place / "recording.h5").is_file()


def test_abandoned_runs_are_removed(tmp_path: Path) -> None:
    """Two machines may make the same run at the same time; the folder of each is its own."""
    study = sweep_of(tmp_path, vary={"controller.settings.pressure": [1.0]})
    (job,) = sweep_jobs(study, tmp_path)
    here = socket.gethostname()
    others = {f"{here}-{os.getppid()}": True, "elsewhere-1": True, f"{here}-{2**22 + 1}": False, "elsewhere-2": False}
    for owner in others:
        (Path(job.folder) / f".{job.name}.{owner}.partial").mkdir(parents=True)
    long_ago = time.time() - job.time_limit - 3600.0
    os.utime(Path(job.folder) / f".{job.name}.elsewhere-2.partial", (long_ago, long_ago))
    make_missing([job], Here())
    left = {path.name for path in Path(job.folder).iterdir()}
    assert left == {job.name, *(f".{job.name}.{owner}.partial" for owner, stays in others.items() if stays)}


def test_table_has_no_time_of_the_machine(tmp_path: Path) -> None:
    study = sweep_of(tmp_path, repeats=2)
    records = make_missing(sweep_jobs(study, tmp_path), Here())
    write_table([result_row(record, f"runs/{record['run']}") for record in records], tmp_path)
    table = read_table(tmp_path)
    assert table["controller.settings.pressure"].tolist() == [1.0, 1.0, 2.0, 2.0]
    assert table["seed"].tolist() == [1, 2, 1, 2]
    assert table["metrics.final_pressures_kPa.left.cavity"].tolist() == [1.0, 1.0, 2.0, 2.0]
    assert not [column for column in table if column.removeprefix("metrics.") in WALL_CLOCK]
    assert all(json.loads((tmp_path / folder / "run.json").read_text()) for folder in table["folder"])


ENDS = """
import os, time
from taichisoft import Control, Controller, hookimpl

class Ends(Controller):
    def __init__(self, how: str):
        print("about to", how)
        {"sleep": lambda: time.sleep(600), "crash": lambda: os._exit(3), "kill": lambda: os.kill(os.getpid(), 9)}[how]()
    def control(self, observation):
        return Control()

@hookimpl
def taichisoft_controllers():
    return {"ends": Ends}
"""


def test_hanging_and_crashing_runs_are_failures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The process that makes runs is killed when one takes too long; a new one tries again where somebody killed it.

    What a run printed is in its log however it ended. (One that hangs may not have begun to print within its limit.)
    """
    monkeypatch.delenv("PYTHONUNBUFFERED", raising=False)
    path = tmp_path / "ends.py"
    path.write_text(ENDS)
    values = {"controller.settings.how": ["sleep", "crash", "kill"]}
    study = sweep_of(tmp_path, controller="ends", plugins=[str(path)], vary=values, time_limit=2.0)
    records = made_apart(sweep_jobs(study, tmp_path))
    assert [(record["status"], record["message"]) for record in records] == [
        ("timeout", "not done within 2 s"),
        ("process lost", "exit code 3"),
        ("process lost", "the process was ended by SIGKILL"),
    ]
    runs = tmp_path / "runs"
    assert sorted(path.name for path in runs.iterdir()) == sorted(record["run"] for record in records)
    for record, how in zip(records[1:], ["crash", "kill"], strict=True):
        assert f"about to {how}" in (runs / record["run"] / "log.txt").read_text()


@pytest.mark.skipif(sys.platform != "linux", reason="looks for the workers among processes")
def test_kills_change_no_result(tmp_path: Path, falling_cube: Path) -> None:
    """The table is that of the same runs made in this process, one after the other, the last first; each has another
    number of steps."""
    values = "time.step=0.001:0.008"
    complete, ended_before, redone = interrupted_sweep(tmp_path, falling_cube, values, runs=12, pause=0.003)
    assert complete and 6 <= ended_before < 12 and redone == 0
    tables = read_tables(tmp_path / "disturbed" / "study.toml")
    study = check_study(Sweep, tables, "study")
    load_plugin(study.plugins[0])
    records = make_missing(sweep_jobs(study, tmp_path / "quiet"), Here())
    write_table([result_row(record, f"runs/{record['run']}") for record in records], tmp_path / "quiet")
    assert len(set(read_table(tmp_path / "quiet")["metrics.steps"])) > 6
    for file in ("results.csv", "results.parquet"):
        assert (tmp_path / "quiet" / file).read_bytes() == (tmp_path / "disturbed" / file).read_bytes()
