"""The process of a case: its environment, and its time limit."""

from pathlib import Path

from taichisoft_benchmarks.case_process import environment_of, measure_in_process
from taichisoft_benchmarks.case_scenes import Meshes
from taichisoft_benchmarks.cases import cases_from_dict

START = {"kind": "start", "title": "", "scene": "gripper", "finger": "finger1"}


def environment(tmp_path: Path, **changes) -> dict[str, str]:
    (named,) = cases_from_dict({"case": {**START, **changes}})
    return environment_of(named.case, tmp_path)


def test_the_threads_of_a_case_hold_for_the_engine_and_for_numpy(tmp_path):
    given = environment(tmp_path, threads=2)
    assert given["TAICHISOFT_THREADS"] == given["OPENBLAS_NUM_THREADS"] == "2"
    assert environment(tmp_path) == {}


def test_a_cold_start_finds_no_compiled_kernel(tmp_path):
    folder = Path(environment(tmp_path, cold=True)["XDG_CACHE_HOME"])
    assert folder.parent == tmp_path
    assert not folder.exists()


def test_a_process_that_takes_too_long_is_ended(tmp_path):
    (named,) = cases_from_dict({"case": {**START, "time_limit": 0.01}})
    assert measure_in_process(named.case, Meshes(None, tmp_path)).problem == "no answer within 0.01 s"
