"""Descriptors of cases: sweeps and peers are cases of their own, and what is wrong is one line."""

import subprocess
from pathlib import Path

import numpy as np
import pytest

from taichisoft import Simulation
from taichisoft.mesh import tetrahedron_volumes
from taichisoft_benchmarks.case_scenes import CELL, FOOT_DEPTH, MAT_CELLS, Meshes, make_mat, scene_of
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


def test_shipped_cases_include_those_with_targets():
    names = {case.name for case in read_cases()}
    assert {"finger_coarse", "finger_fine", "gripper_coarse", "gripper_fine", "factor_coarse"} <= names
    assert {"growth_nodes_400", "growth_nodes_20000", "growth_contacts_784"} <= names
    assert {"start_cold", "meshing_coarse", "meshing_fine", "factor_fine_2_threads"} <= names


def test_entry_of_sweep_becomes_case():
    swept = {**STEPS, "sweep": {"one": {"threads": 1}, "two": {"threads": 2, "steps": 40}}}
    first, second = cases_from_dict({"speed": swept})
    assert (first.name, first.group, first.parameter, first.case.threads) == ("speed_one", "speed", {"threads": 1}, 1)
    assert (second.name, second.case.threads, second.case.steps) == ("speed_two", 2, 40)


def test_peer_becomes_case_of_its_own():
    ours, theirs = cases_from_dict({"finger": {**STEPS, "peers": ["mujoco"]}})
    assert (ours.name, theirs.name, theirs.group) == ("finger", "finger_mujoco", "finger_mujoco")
    assert isinstance(theirs.case, PeerCase)
    assert theirs.case.peer == "mujoco"
    assert theirs.case.windows == ours.case.windows


def test_quick_look_keeps_starts_of_windows():
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
def test_wrong_descriptor_is_one_line(table, message):
    with pytest.raises(BenchmarkError) as refused:
        cases_from_dict({"finger": table})
    assert message in str(refused.value)


def test_cases_with_same_name_are_refused():
    swept = {**STEPS, "sweep": {"one": {"threads": 1}}}
    with pytest.raises(BenchmarkError, match="two cases are called 'finger_one'"):
        cases_from_dict({"finger": swept, "finger_one": STEPS})


def test_cases_are_chosen_by_name_group_pattern():
    cases = read_cases()
    assert [case.name for case in choose(cases, ["finger_coarse"])] == ["finger_coarse"]
    assert {case.group for case in choose(cases, ["growth_nodes"])} == {"growth_nodes"}
    assert {case.group for case in choose(cases, ["growth_*"])} == {"growth_nodes", "growth_contacts"}
    assert choose(cases, []) == cases
    with pytest.raises(BenchmarkError, match="--case finger_corse: fits no case; did you mean 'finger_coarse'"):
        choose(cases, ["finger_corse"])


TIMING = {"title": "", "steps": 2, "windows": {"step_ms": [1, 2]}}
FINGER = {**TIMING, "kind": "steps", "scene": "finger-inflated", "finger": "finger"}


def scene(table, tmp_path: Path, tutorial: Path | None = None):
    (named,) = cases_from_dict({"case": table})
    return scene_of(named.case, Meshes(tutorial, tmp_path))


def test_shipped_mesh_is_default(tmp_path):
    made = scene({**FINGER, "mesh": "tutorial-medium"}, tmp_path)
    assert Path(made.soft_bodies["finger"].mesh.file).name == "tutorial-medium.msh"


def test_tutorial_meshes_bring_their_surfaces(tmp_path):
    for name in ("pneunetCut.vtk", "pneunetCut.stl", "pneunetCavityCut.stl"):
        (tmp_path / name).touch()
    made = scene({**FINGER, "mesh": "tutorial-medium"}, tmp_path, tmp_path).soft_bodies["finger"]
    assert Path(made.mesh.file) == tmp_path / "pneunetCut.vtk"
    assert Path(made.collision_surface[0].file) == tmp_path / "pneunetCut.stl"
    assert Path(made.cavities["cavity"].surface) == tmp_path / "pneunetCavityCut.stl"
    assert made.cavities["cavity"].group is None


def test_folder_without_mesh_is_refused(tmp_path):
    with pytest.raises(BenchmarkError, match=r"has no pneunetCut\.vtk"):
        scene({**FINGER, "mesh": "tutorial-medium"}, tmp_path, tmp_path)


def test_finger_of_size_is_meshed_before_timing(tmp_path, monkeypatch):
    monkeypatch.setenv("TAICHISOFT_CACHE", str(tmp_path))
    made = scene({**FINGER, "element_size": 16.0}, tmp_path).soft_bodies["finger"].mesh
    assert (Path(made.file).name, made.size) == ("tutorial.toml", 16.0)
    (kept,) = (tmp_path / "meshes").glob("*.msh")
    assert kept.name.startswith("tutorial-")


def test_reduced_models_are_made_once(tmp_path, monkeypatch):
    """`taichisoft reduce` makes them, in a folder of the scene's own; what it says reaches the user."""
    asked = []

    def reduce(command, **_):
        asked.append(command)
        return subprocess.CompletedProcess(command, 1 if len(asked) == 1 else 0, "", "taichisoft: no anchors")

    monkeypatch.setattr(subprocess, "run", reduce)
    reduced = {**FINGER, "reduced": True}
    with pytest.raises(BenchmarkError, match=r"scene\.toml: taichisoft: no anchors"):
        scene(reduced, tmp_path)
    (folder,) = tmp_path.glob("reduced-*")
    assert asked[0][2:] == ["taichisoft", "reduce", str(folder / "scene.toml"), "-o", str(folder)]
    (folder / "finger.npz").touch()
    (folder / "validation.json").touch()
    assert scene(reduced, tmp_path).soft_bodies["finger"].reduced == str(folder / "finger.npz")
    assert len(asked) == 1


def test_mat_has_same_nodes_on_every_foot():
    whole = CELL**3 * np.prod(MAT_CELLS)
    for foot in (7, 28):
        mesh = make_mat(foot)
        assert mesh.nodes.shape == (28 * 28 * 3, 3)
        assert (mesh.nodes[:, 2] == 0.0).sum() == foot**2
    assert tetrahedron_volumes(mesh.nodes, mesh.elements).sum() == pytest.approx(whole)
    small = make_mat(7)
    off = tetrahedron_volumes(small.nodes, small.elements).sum()
    assert whole - FOOT_DEPTH * CELL**2 * MAT_CELLS[0] ** 2 < off < whole


@pytest.mark.parametrize("foot", [4, 9])
def test_every_vertex_of_the_foot_has_contact(tmp_path, foot):
    """At first; where the foot has settled, those of its edge may carry nothing."""
    simulation = Simulation(scene({**TIMING, "kind": "contacts", "foot": foot}, tmp_path))
    assert max(simulation.step().contact_count for _ in range(3)) == foot**2
