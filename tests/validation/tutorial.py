"""The scenes of SOFA's PneuNet gripper tutorial (step 7), on the tutorial's own meshes."""

import math
from pathlib import Path
from typing import Any

from taichisoft import Scene
from taichisoft.scene import scene_from_dict

COARSE, FINE = "pneunetCutCoarse.vtk", "pneunetCut.vtk"


def finger(shared: Path, mesh: str = COARSE) -> dict[str, Any]:
    """The finger's table: silicone with a stiff layer, clamped at its base."""
    meshes = shared / "tutorial-meshes"
    return {
        "mesh": str(meshes / mesh),
        "mass": 0.04,
        "young_modulus": 500,
        "poisson_ratio": 0.3,
        "rayleigh_mass": 0.1,
        "rayleigh_stiffness": 0.1,
        "damped_anchors": True,
        "element": "linear",
        "corotation": "edges",  # SOFA's method "large"
        "regions": [{"box": [[-100, 22.5, -8], [-19, 28, 8]], "young_modulus": 1500}],
        "anchors": [{"box": [[-10, 0, -20], [0, 30, 20]]}],
        "cavities": {"cavity": {"surface": str(meshes / "pneunetCavityCut.stl")}},
        "collision_surface": str(meshes / "pneunetCut.stl"),
    }


def finger_scene(shared: Path, mesh: str = COARSE, step: float = 0.01) -> Scene:
    """One finger under gravity along x."""
    return scene_from_dict(
        {"gravity": [-9810, 0, 0], "time": {"step": step}, "soft_bodies": {"finger": finger(shared, mesh)}}
    )


def gripper_scene(shared: Path, mass: float = 0.001, **contact: float) -> Scene:
    """Three fingers, a cube of `mass` [kg] with its true inertia, and the floor; `contact` as in a scene."""
    fingers = {"finger1": finger(shared)}
    for index, turn in ((2, 120), (3, 240)):
        angle = math.radians(turn - 90)
        shift = [0, 70 + 70 * math.sin(angle), 70 * math.cos(angle)]
        fingers[f"finger{index}"] = {**finger(shared), "rotation": [-turn, 0, 0], "translation": shift}
    cube = {
        "surface": str(shared / "tutorial-meshes" / "smCube27.obj"),
        "scale": 6,
        "mass": mass,
        "position": [-100, 70, 0],
    }
    return scene_from_dict(
        {
            "gravity": [-9810, 0, 0],
            "soft_bodies": fingers,
            "rigid_bodies": {"cube": cube},
            "obstacles": {"floor": {"plane": {"point": [-122, 0, 0], "normal": [1, 0, 0]}}},
            "contact": {"friction": 0.6, **contact},
        }
    )
