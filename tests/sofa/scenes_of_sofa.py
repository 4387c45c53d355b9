"""Small SOFA scenes that tests write and load."""

from collections.abc import Mapping
from pathlib import Path
from textwrap import dedent, indent

from taichisoft_sofa.tree.loading import SceneTree, load_tree


def written(folder: Path, files: Mapping[str, str]) -> Path:
    """Write texts into files of a folder."""
    for name, text in files.items():
        file = folder / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(dedent(text), encoding="utf-8")
    return folder


def loaded(folder: Path, create: str, before: str = "", files: Mapping[str, str] | None = None) -> SceneTree:
    """The tree of a scene whose createScene has this body from line 3 on, with these files beside it."""
    body = indent(dedent(create).strip("\n"), "    ")
    written(folder, {**(files or {}), "scene.py": f"{dedent(before)}\ndef createScene(root):\n{body}\n"})
    return load_tree(folder / "scene.py")
