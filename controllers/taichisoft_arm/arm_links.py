"""The links of an arm as bodies of a scene, which frames of the scene carry."""

import hashlib
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from taichisoft.base import cache_folder
from taichisoft.errors import MeshError, SceneError
from taichisoft.mesh import write_stl
from taichisoft.scene import BASE, find_file
from taichisoft_arm.arm_controller import ArmSettings
from taichisoft_arm.mounted_arm import MountedArm
from taichisoft_arm.urdf_file import SUFFIX, LinkPart

GROUP = 20202
"""The group of all links: they overlap at joints, and do not touch each other."""


def arm_bodies(settings: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Tables of a scene for the links of the arm that the controller's settings describe.

    Args:
        settings: of the controller "arm".
        folder: folder in which files are looked for first.
    """
    checked = ArmSettings.checked(**settings)
    if checked.links == "none":
        return {}
    urdf = find_file(checked.urdf, "arms", (SUFFIX,), folder, SceneError)
    arm = MountedArm(checked.model_copy(update={"urdf": str(urdf)}))
    colliding = checked.links == "colliding"
    carriers = [*arm.frame_names(), BASE]
    bodies: dict[str, Any] = {}
    for part, pose in arm.parts("collision" if colliding else "visual"):
        table = {
            **_shape(part),
            "position": pose[:3, 3].tolist(),
            "rotation": _turns(pose[:3, :3]),
            "follows": carriers[part.frame],
            "collides": colliding,
            "groups": [GROUP],
        }
        if part.colour is not None:
            table["colour"] = part.colour
        bodies[_free_name(f"arm_{part.link}", bodies)] = table
    followed = {table["follows"] for table in bodies.values()} - {BASE}
    frames = {name: {"pivot": [0.0, 0.0, 0.0]} for name in arm.frame_names() if name in followed}
    return {"frames": frames, "rigid_bodies": bodies}


def _turns(matrix: np.ndarray) -> list[float]:
    """Turns about the x, y and z axes, in this order [degrees], that make up a rotation matrix (3, 3)."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of two turns about one axis the second is 0, which is as good as any
        turns: list[float] = Rotation.from_matrix(matrix).as_euler("xyz", degrees=True).tolist()
    return turns


def _free_name(name: str, taken: Mapping[str, Any]) -> str:
    plain = name.translate(dict.fromkeys(map(ord, ".|/"), "_"))
    names = [plain, *(f"{plain}_{number}" for number in range(2, len(taken) + 3))]
    return next(free for free in names if free not in taken)


def _shape(part: LinkPart) -> dict[str, Any]:
    if part.shape == "box":
        return {"box": list(part.size)}
    if part.shape == "sphere":
        return {"sphere": {"radius": part.size[0]}}
    if part.shape == "cylinder":
        return {"cylinder": {"radius": part.size[0], "length": part.size[1]}}
    return {"surface": str(_surface_in_mm(part))}


def _surface_in_mm(part: LinkPart) -> Path:
    """The surface in mm of the mesh of a link, kept in the cache; it may be open."""
    import trimesh

    assert part.file is not None
    try:
        content = part.file.read_bytes()
        mesh = trimesh.load_mesh(part.file, file_type=part.file.suffix[1:].lower())
        if not len(mesh.faces):
            raise ValueError("no faces")
    except Exception as error:  # trimesh's parsers raise exceptions of any kind for a broken file
        raise MeshError(f"{part.file}: not readable as a surface: {error}") from error
    mesh.apply_scale(part.size)
    key = hashlib.sha256(content + f"{part.size} mm".encode()).hexdigest()[:24]
    path = cache_folder() / "arms" / f"{part.file.stem}-{key}.stl"
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        write_stl(np.array(mesh.vertices), np.array(mesh.faces), path)
    return path
