"""Small SOFA scenes that tests write and load."""

from pathlib import Path
from textwrap import dedent

from taichisoft_sofa.tree.loading import SceneTree, load_tree


def written(folder: Path, **files: str) -> Path:
    """Write files into a folder: `scene_py="..."` is scene.py, `controllers__init_py` is controllers/__init__.py."""
    for name, text in files.items():
        stem, _, suffix = name.rpartition("_")
        file = folder / f"{stem.replace('__', '/', 1) if '__' in stem else stem}.{suffix}"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(dedent(text))
    return folder


def loaded(folder: Path, create: str, before: str = "", **files: str) -> SceneTree:
    """The tree of a scene whose createScene has this body, with these files beside it."""
    body = "\n".join(f"    {line}" for line in dedent(create).strip("\n").split("\n"))
    (folder / "scene.py").write_text(f"{dedent(before)}\ndef createScene(root):\n{body}\n")
    written(folder, **files)
    return load_tree(folder / "scene.py")
