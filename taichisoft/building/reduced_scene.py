"""A scene whose soft bodies move by modes, found in a folder."""

from pathlib import Path

from taichisoft.errors import SceneError
from taichisoft.scenes.scene import Scene
from taichisoft.scenes.soft_body import SoftBodySettings

SUFFIX = ".npz"
# Keys in which copies of a body may differ: where they are, how they look, and what is not part of their elasticity.
OWN_KEYS = {
    "rotation",
    "translation",
    "velocity",
    "collides",
    "self_contact",
    "colour",
    "axes",
    "tip",
    "reduced",
    "cavities",
    "cables",
}


def with_reduced_bodies(scene: Scene, folder: Path, key: str = "--reduced") -> Scene:
    """Let every soft body that has a file of modes move by them.

    Args:
        scene: the scene.
        folder: with a file BODY.npz for each shape of body; a body without one takes that of a body which it is a copy
            of.
        key: what names the folder, for messages.

    Raises:
        SceneError: no such folder, or none of its files is that of a soft body.
    """
    if not folder.is_dir():
        raise SceneError(f"{key} {folder}: no such folder; `taichisoft reduce SCENE -o {folder}` writes it")
    files = {name: folder / f"{name}{SUFFIX}" for name in scene.soft_bodies}
    own = {name: file.resolve() for name, file in files.items() if file.is_file()}
    if not own:
        there = ", ".join(sorted(file.name for file in folder.glob(f"*{SUFFIX}"))) or "none"
        wanted = ", ".join(f"{name}{SUFFIX}" for name in scene.soft_bodies) or "none: the scene has no soft bodies"
        raise SceneError(f"{key} {folder}: has no modes of a soft body ({wanted}); files there: {there}")
    bodies = {}
    for name, body in scene.soft_bodies.items():
        same = next(
            (other for other in (name, *own) if other in own and _is_copy(scene.soft_bodies[other], body)), None
        )
        bodies[name] = body if same is None else body.model_copy(update={"reduced": str(own[same])})
    return scene.model_copy(update={"soft_bodies": bodies})


def _is_copy(one: SoftBodySettings, other: SoftBodySettings) -> bool:
    return one.model_dump(exclude=OWN_KEYS) == other.model_dump(exclude=OWN_KEYS)
