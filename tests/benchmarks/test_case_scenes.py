"""The scenes that cases make: meshes of SOFA's tutorial, fingers on a circle, a mat on a foot."""

import subprocess
from pathlib import Path

import numpy as np
import pytest

from taichisoft import Simulation
from taichisoft.mesh import tetrahedron_volumes
from taichisoft_benchmarks.case_scenes import CELL, FOOT_DEPTH, MAT_CELLS, Meshes, make_mat, scene_of
from taichisoft_benchmarks.cases import cases_from_dict
from taichisoft_benchmarks.errors import BenchmarkError
from taichisoft_benchmarks.measures.peer_steps import pressure_forces

TIMING = {"title": "", "steps": 2, "windows": {"step_ms": [1, 2]}}
FINGER = {**TIMING, "kind": "steps", "scene": "finger-inflated", "finger": "finger"}


def scene(table, tmp_path: Path, tutorial: Path | None = None):
    (named,) = cases_from_dict({"case": table})
    return scene_of(named.case, Meshes(tutorial, tmp_path))


def test_the_shipped_mesh_is_taken_without_a_folder(tmp_path):
    made = scene({**FINGER, "mesh": "tutorial-medium"}, tmp_path)
    assert Path(made.soft_bodies["finger"].mesh.file).name == "tutorial-medium.msh"


def test_the_tutorials_meshes_come_with_their_surfaces(tmp_path):
    for name in ("pneunetCut.vtk", "pneunetCut.stl", "pneunetCavityCut.stl"):
        (tmp_path / name).touch()
    made = scene({**FINGER, "mesh": "tutorial-medium"}, tmp_path, tmp_path).soft_bodies["finger"]
    assert Path(made.mesh.file) == tmp_path / "pneunetCut.vtk"
    assert Path(made.collision_surface[0].file) == tmp_path / "pneunetCut.stl"
    assert Path(made.cavities["cavity"].surface) == tmp_path / "pneunetCavityCut.stl"
    assert made.cavities["cavity"].group is None


def test_a_folder_that_lacks_a_file_is_refused(tmp_path):
    with pytest.raises(BenchmarkError, match=r"has no pneunetCut\.vtk"):
        scene({**FINGER, "mesh": "tutorial-medium"}, tmp_path, tmp_path)


def test_a_finger_of_a_size_is_meshed_before_it_is_measured(tmp_path, monkeypatch):
    monkeypatch.setenv("TAICHISOFT_CACHE", str(tmp_path))
    made = scene({**FINGER, "element_size": 16.0}, tmp_path).soft_bodies["finger"].mesh
    assert (Path(made.file).name, made.size) == ("tutorial.toml", 16.0)
    (kept,) = (tmp_path / "meshes").glob("*.msh")
    assert kept.name.startswith("tutorial-")


def test_reduced_models_are_made_once_and_a_failure_is_one_line(tmp_path, monkeypatch):
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


def test_fingers_stand_on_a_circle_and_bend_inwards(tmp_path):
    made = scene({**TIMING, "kind": "fingers", "count": 5}, tmp_path)
    simulation = Simulation(made)
    pressure = dict.fromkeys(simulation.model.cavities.names, 5.0)
    force = pressure_forces(simulation.model, simulation.state.position, pressure)
    assert len(made.soft_bodies) == 5
    before = np.linalg.norm(simulation.state.position[:, 1:], axis=1)
    from taichisoft import Control

    for _ in range(10):
        simulation.step(Control(pressure=pressure))
    after = np.linalg.norm(simulation.state.position[:, 1:], axis=1)
    tips = simulation.model.rest_position[:, 0] < -110.0
    assert (after[tips] < before[tips]).all()
    # Air pushes the walls of a closed cavity with no force in sum.
    assert np.abs(force.sum(axis=0)).max() < 1e-9 * np.abs(force).sum()


def test_the_mat_has_the_same_nodes_on_every_foot():
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
def test_every_vertex_of_the_foot_is_a_contact(tmp_path, foot):
    """At first; where the foot has settled, those of its edge may carry nothing."""
    simulation = Simulation(scene({**TIMING, "kind": "contacts", "foot": foot}, tmp_path))
    assert max(simulation.step().contact_count for _ in range(3)) == foot**2
