"""The scenes of the cases: shipped ones with another mesh, fingers on a circle, a mat on a foot."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from taichisoft.building.scene_files import load_scene
from taichisoft.errors import SceneError
from taichisoft.scenes.file import scene_from_dict
from taichisoft.scenes.scene import Scene
from taichisoft.scenes.shipped import find_file
from taichisoft_benchmarks.descriptors import Case, ContactsCase, Fingers, FingersCase, SceneCase
from taichisoft_benchmarks.errors import BenchmarkError
from taichisoft_benchmarks.meshes import mat_with_foot
from taichisoft_meshing.scene_meshes import mesh_for_scene

# Of SOFA's tutorial: the skin with the cavity's wall, and that wall.
TUTORIAL_SURFACE = "pneunetCut.stl"
TUTORIAL_CAVITY = "pneunetCavityCut.stl"

FINGER = "tutorial.toml"
"""Geometry of the fingers whose elements a case gives a size."""

CIRCLE = 140.0
"""Radius on which the fingers stand [mm]: twelve of them, 20 mm wide, do not touch when they bend inwards."""


@dataclass(frozen=True)
class Meshes:
    """Where meshes come from.

    Attributes:
        tutorial: folder of the tutorial's meshes, None for the shipped ones.
        made: folder in which meshes that the cases make are kept.
    """

    tutorial: Path | None
    made: Path


def scene_of(case: Case, meshes: Meshes) -> Scene:
    """The scene that a case is about.

    Raises:
        SceneError, MeshError: the scene or one of its files is not valid.
        BenchmarkError: the folder of tutorial meshes lacks a file.
    """
    if isinstance(case, FingersCase):
        return _circle_of_fingers(case, meshes)
    if isinstance(case, ContactsCase):
        return _mat(case, meshes)
    if isinstance(case, SceneCase):
        body = f"soft_bodies.{case.finger}"
        changed = [f"{body}.{key}={_as_toml(value)}" for key, value in finger_files(case, meshes).items()]
        return load_scene(case.scene, [*changed, *case.overrides])
    raise SceneError(f"cases of kind '{case.kind}' have no scene")


def finger_files(case: Fingers, meshes: Meshes) -> dict[str, Any]:
    """The keys of a finger that name files: its mesh, and the surfaces that belong to it.

    Raises:
        BenchmarkError: the folder of tutorial meshes lacks a file.
    """
    if case.element_size is not None:
        mesh_for_scene(find_file(FINGER, "fingers", ()), size=case.element_size)  # now, before any clock runs
        return {"mesh": {"file": FINGER, "size": case.element_size}}
    if meshes.tutorial is None or case.tutorial_mesh is None:
        return {"mesh": case.mesh}
    folder = meshes.tutorial.resolve()
    for name in (case.tutorial_mesh, TUTORIAL_SURFACE, TUTORIAL_CAVITY):
        if not (folder / name).is_file():
            raise BenchmarkError(f"--tutorial-meshes {meshes.tutorial}: has no {name}")
    return {
        "mesh": str(folder / case.tutorial_mesh),
        "collision_surface": str(folder / TUTORIAL_SURFACE),
        "cavities.cavity": {"surface": str(folder / TUTORIAL_CAVITY)},
    }


def _as_toml(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {_as_toml(inner)}" for key, inner in value.items()) + "}"
    return f"'{value}'" if isinstance(value, str) else str(value)


def _circle_of_fingers(case: FingersCase, meshes: Meshes) -> Scene:
    """The finger of the inflated scene, `count` times around the x axis, each bending towards it."""
    files = finger_files(case, meshes)
    cavity = files.pop("cavities.cavity", {"group": "cavity"})
    first = load_scene("finger-inflated").model_dump(mode="json", exclude_none=True)
    finger = {**first["soft_bodies"]["finger"], **files, "cavities": {"cavity": cavity}}
    fingers = {}
    for index in range(case.count):
        degrees = 360.0 * index / case.count
        angle = math.radians(degrees)
        shift = [0.0, -CIRCLE * math.cos(angle), -CIRCLE * math.sin(angle)]
        fingers[f"finger{index + 1}"] = {**finger, "rotation": [degrees, 0.0, 0.0], "translation": shift}
    return scene_from_dict({**first, "soft_bodies": fingers}, "benchmark fingers")


def _mat(case: ContactsCase, meshes: Meshes) -> Scene:
    """A mat that stands on its foot, one contact per vertex."""
    return scene_from_dict(
        {
            "gravity": [0.0, 0.0, -9810.0],
            # Every vertex of the foot becomes a contact, and none of the rest is near enough. So many contacts
            # on one soft body converge slowly: the sweeps are limited, and the case measures what they cost.
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
                    "mesh": str(mat_with_foot(case.foot, meshes.made)),
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
