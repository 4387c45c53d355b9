"""Fixtures for the tests of plug-ins; pytest finds them where taichisoft is installed (`-p no:taichisoft` hides them).

Only pytest is imported until a test requests a fixture.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from taichisoft.running.plugins import Registry
    from taichisoft.scene.scene import Scene

TINY_GRIPPER = Path(__file__).parent / "tiny_gripper" / "scene.toml"


@pytest.fixture
def taichisoft_scene() -> "Scene":
    """Two soft pads of 36 tetrahedra each and a cube of 1 g between them; half a second takes 0.1 s to simulate.

    Bodies: "left" and "right", with the cavities "left.cavity" and "right.cavity"; "cube", on the obstacle "floor". At
    7 kPa the pads touch the cube, and with 9 kPa they can lift it (along z).
    """
    from taichisoft.running.scene_files import load_scene

    return load_scene(TINY_GRIPPER)


@pytest.fixture
def taichisoft_plugins() -> "Iterator[Registry]":
    """A registry with the installed plug-ins; plug-ins that the test adds are removed after it."""
    from taichisoft.running.plugins import separate_registry

    with separate_registry() as registry:
        yield registry
