"""Descriptors of cases: sweeps and peers are cases of their own, and what is wrong is one line."""

from pathlib import Path

import pytest

from taichisoft_benchmarks.cases import PeerCase, cases_from_dict, choose, read_cases
from taichisoft_benchmarks.errors import BenchmarkError

STEPS = {
    "kind": "steps",
    "title": "a finger",
    "scene": "finger-inflated",
    "finger": "finger",
    "steps": 30,
    "windows": {"early_ms": [2, 20], "late_ms": [20, 30]},
}


def test_the_shipped_cases_have_what_the_targets_are_about():
    names = {case.name for case in read_cases()}
    assert {"finger_coarse", "finger_fine", "gripper_coarse", "gripper_fine", "factor_coarse", "throughput"} <= names
    assert {"growth_nodes_400", "growth_nodes_20000", "growth_contacts_784", "growth_fingers_12"} <= names
    assert {"start_cold", "meshing_coarse", "meshing_fine", "rendering", "factor_fine_2_threads"} <= names


def test_an_entry_of_a_sweep_is_a_case_with_its_changes():
    swept = {**STEPS, "sweep": {"one": {"threads": 1}, "two": {"threads": 2, "steps": 40}}}
    first, second = cases_from_dict({"speed": swept})
    assert (first.name, first.group, first.parameter, first.case.threads) == ("speed_one", "speed", {"threads": 1}, 1)
    assert (second.name, second.case.threads, second.case.steps) == ("speed_two", 2, 40)


def test_a_peer_is_a_case_of_its_own_beside_ours():
    ours, theirs = cases_from_dict({"finger": {**STEPS, "peers": ["mujoco"]}})
    assert (ours.name, theirs.name, theirs.group) == ("finger", "finger_mujoco", "finger_mujoco")
    assert isinstance(theirs.case, PeerCase)
    assert theirs.case.peer == "mujoco"
    assert theirs.case.windows == ours.case.windows


def test_a_peer_of_a_reduced_case_has_all_nodes():
    ours, theirs = cases_from_dict({"finger": {**STEPS, "reduced": True, "peers": ["mujoco"]}})
    assert (ours.case.reduced, theirs.case.reduced) == (True, False)


def test_a_quick_look_keeps_the_start_of_every_window():
    (named,) = cases_from_dict({"finger": STEPS})
    quick = named.case.shortened()
    assert quick.windows == {"early_ms": (2, 12), "late_ms": (20, 30)}
    assert quick.steps == 30
    (named,) = cases_from_dict({"finger": {**STEPS, "windows": {"early_ms": [2, 20]}}})
    assert named.case.shortened().steps == 12


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({**STEPS, "kind": "stepz"}, "cases: finger.kind = 'stepz': did you mean 'steps'?"),
        ({**STEPS, "stps": 3}, "cases: finger.stps: unknown key; did you mean 'steps'?"),
        ({**STEPS, "steps": 0}, "cases: finger.steps = 0: input should be greater than 0"),
        ({**STEPS, "windows": {"step_ms": [5, 31]}}, "windows.step_ms = [5, 31]: must rise and end within 30 steps"),
        ({**STEPS, "windows": {"step_ms": [5, 5]}}, "windows.step_ms = [5, 5]: must rise and end within 30 steps"),
        ({**STEPS, "peers": ["sofa"]}, "finger.peers.0 = 'sofa': input should be 'mujoco'"),
        ({**STEPS, "sweep": {"threads": 1}}, "finger.sweep = {'threads': 1}: must be tables of keys"),
        ({**STEPS, "sweep": {}}, "finger.sweep = {}: must be tables of keys"),
        ({**STEPS, "sweep": {"a": {"thread": 1}}}, "finger.thread: unknown key; did you mean 'threads'"),
        ("steps", "cases: finger = 'steps': must be a table, [finger]"),
    ],
)
def test_a_wrong_descriptor_is_one_line(table, message):
    with pytest.raises(BenchmarkError) as refused:
        cases_from_dict({"finger": table})
    assert message in str(refused.value)


def test_two_cases_of_one_name_are_refused():
    swept = {**STEPS, "sweep": {"one": {"threads": 1}}}
    with pytest.raises(BenchmarkError, match="two cases are called 'finger_one'"):
        cases_from_dict({"finger": swept, "finger_one": STEPS})


def test_a_file_that_is_no_toml_is_named(tmp_path: Path):
    path = tmp_path / "cases.toml"
    path.write_text("[finger")
    with pytest.raises(BenchmarkError, match=r"cases\.toml: not readable as TOML: "):
        read_cases(path)


def test_cases_are_chosen_by_name_group_and_pattern():
    cases = read_cases()
    assert [case.name for case in choose(cases, ["finger_coarse"])] == ["finger_coarse"]
    assert {case.group for case in choose(cases, ["growth_nodes"])} == {"growth_nodes"}
    assert {case.group for case in choose(cases, ["growth_*"])} == {"growth_nodes", "growth_contacts", "growth_fingers"}
    assert choose(cases, []) == cases
    with pytest.raises(BenchmarkError, match="--case finger_corse: fits no case; did you mean 'finger_coarse'"):
        choose(cases, ["finger_corse"])
