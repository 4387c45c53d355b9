"""The scenes of the cases: shipped ones with another mesh, a mat on a foot."""

import hashlib
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from taichisoft import Scene
from taichisoft.mesh import VolumeMesh, write_volume_mesh
from taichisoft.running import load_scene, with_reduced_bodies
from taichisoft.scene import find_file, scene_from_dict, scene_to_toml
from taichisoft_benchmarks.cases import Case, ContactsCase, SceneCase, StepsCase
from taichisoft_benchmarks.errors import BenchmarkError
from taichisoft_benchmarks.regular_meshes import bar
from taichisoft_meshing.mesh_job import mesh_for_scene

TUTORIAL_MESHES = {"tutorial-coarse": "pneunetCutCoarse.vtk", "tutorial-medium": "pneunetCut.vtk"}
"""Files in the folder of SOFA's tutorial that take the place of shipped meshes."""

FINGER = "tutorial.toml"
"""Geometry of the fingers whose elements a case gives a size."""

CELL = 2.0
"""Edge of a cell of the mat [mm]."""
MAT_CELLS = (27, 27, 2)
FOOT_DEPTH = 1.0
"""Height of the foot below the mat [mm]: the vertices beside it are beyond the reach of contacts."""


@dataclass(frozen=True)
class Meshes:
    """The folders of meshes.

    Attributes:
        tutorial: folder of the tutorial's meshes, None for the shipped ones.
        made: folder in which meshes that the cases make are kept.
    """

    tutorial: Path | None
    made: Path


def scene_of(case: Case, meshes: Meshes) -> Scene:
    """The scene that a case is about."""
    if isinstance(case, ContactsCase):
        return _mat(case, meshes)
    if isinstance(case, SceneCase):
        body = f"soft_bodies.{case.finger}"
        changed = [f"{body}.{key}={_as_toml(value)}" for key, value in finger_files(case, meshes).items()]
        scene = load_scene(case.scene, [*changed, *case.overrides])
        is_reduced = isinstance(case, StepsCase) and case.reduced
        return with_reduced_bodies(scene, _reduced_models(scene, meshes)) if is_reduced else scene
    raise BenchmarkError(f"cases of kind '{case.kind}' have no scene")


def finger_files(case: SceneCase, meshes: Meshes) -> dict[str, Any]:
    """The keys of a finger that name files: its mesh, and the surfaces that belong to it."""
    if case.element_size is not None:
        mesh_for_scene(find_file(FINGER, "fingers", ()), size=case.element_size)  # now, before any clock runs
        return {"mesh": {"file": FINGER, "size": case.element_size}}
    if meshes.tutorial is None or case.mesh not in TUTORIAL_MESHES:
        return {"mesh": case.mesh}
    mesh = meshes.tutorial.resolve() / TUTORIAL_MESHES[case.mesh]
    surfaces = tutorial_surfaces(mesh.parent)
    for file in (mesh, surfaces["collision_surface"], surfaces["cavities"]["cavity"]["surface"]):
        if not Path(file).is_file():
            raise BenchmarkError(f"--tutorial-meshes {meshes.tutorial}: has no {Path(file).name}")
    return {"mesh": str(mesh), **surfaces}


def tutorial_surfaces(folder: Path) -> dict[str, Any]:
    """The keys of a finger that name surfaces of SOFA's tutorial: the skin with the cavity's wall, and that wall."""
    return {
        "collision_surface": str(folder / "pneunetCut.stl"),
        "cavities": {"cavity": {"surface": str(folder / "pneunetCavityCut.stl")}},
    }


def _reduced_models(scene: Scene, meshes: Meshes) -> Path:
    """The folder of a scene's reduced models, made by `taichisoft reduce` where they are not there yet."""
    text = scene_to_toml(scene)
    folder = meshes.made / f"reduced-{hashlib.sha256(text.encode()).hexdigest()[:12]}"
    if not (folder / "validation.json").exists():  # which is written last
        folder.mkdir(exist_ok=True)
        (folder / "scene.toml").write_text(text, encoding="utf-8")
        command = [sys.executable, "-m", "taichisoft", "reduce", str(folder / "scene.toml"), "-o", str(folder)]
        made = subprocess.run(command, capture_output=True, text=True)
        if made.returncode:
            raise BenchmarkError(f"taichisoft reduce {folder / 'scene.toml'}: {made.stderr.strip()[-200:]}")
    return folder


def _as_toml(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {_as_toml(inner)}" for key, inner in value.items()) + "}"
    return f"'{value}'" if isinstance(value, str) else str(value)


def _mat(case: ContactsCase, meshes: Meshes) -> Scene:
    """A mat that stands on its foot, one contact per vertex."""
    path = meshes.made / f"mat-on-{case.foot}.msh"
    if not path.exists():
        write_volume_mesh(make_mat(case.foot), path)
    return scene_from_dict(
        {
            "gravity": [0.0, 0.0, -9810.0],
            # Every vertex of the foot becomes a contact, and no other vertex does. So many contacts on one soft
            # body converge slowly: the sweeps are limited, and the case measures their cost.
            "contact": {
                "spacing": 0.0,
                "contact_distance": 0.2,
                "alarm_distance": 0.4,
                "tolerance": 1e-4,
                "max_iterations": 1000,
            },
            "controller": {"name": "scripted", "settings": {"script": "rest"}},
            "soft_bodies": {
                "mat": {
                    "mesh": str(path),
                    "element": "linear",
                    "density": 1e-6,
                    "young_modulus": 500.0,
                    "poisson_ratio": 0.3,
                    "rayleigh_stiffness": 0.1,
                }
            },
            "obstacles": {"floor": {"plane": {"point": [0.0, 0.0, -0.2], "normal": [0.0, 0.0, 1.0]}}},
        },
        "benchmark mat",
    )


def make_mat(foot: int) -> VolumeMesh:
    """A mat of 28 x 28 x 3 nodes, of which `foot` x `foot` stand out of its underside down to z = 0.

    The node at (i, j, k) is number (i * 28 + j) * 3 + k.
    """
    mat = bar(MAT_CELLS, (CELL * MAT_CELLS[0], CELL * MAT_CELLS[1], CELL * MAT_CELLS[2]))
    place = np.round(mat.nodes / CELL)
    first = (MAT_CELLS[0] + 1 - foot) // 2
    on_foot = ((place[:, :2] >= first) & (place[:, :2] < first + foot)).all(axis=1)
    nodes = mat.nodes.copy()
    nodes[(place[:, 2] == 0) & ~on_foot, 2] += FOOT_DEPTH
    return VolumeMesh("mat", nodes, mat.elements).check()
