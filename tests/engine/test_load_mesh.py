"""Meshes of soft bodies that are no mesh files: plug-ins make them."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from taichisoft import VolumeMesh
from taichisoft.errors import MeshError, PluginError, SceneError
from taichisoft.running.simulation import load_mesh
from taichisoft.scene.soft_body import BodyMesh

Install = Callable[..., None]
TETRAHEDRON = VolumeMesh("made", np.vstack([np.zeros(3), np.eye(3)]), np.array([[0, 1, 2, 3]]))


def load(**source: Any) -> VolumeMesh:
    return load_mesh(BodyMesh(**source), "soft_bodies.pad.mesh")


def test_a_plug_in_makes_the_mesh_of_files_of_its_suffix(install: Install) -> None:
    asked: list[Any] = []

    def make(file: Path, size: float = 1.0, set: dict[str, Any] | None = None) -> VolumeMesh:
        asked.append((file, size, set))
        return TETRAHEDRON

    install("one", taichisoft_mesh_makers=lambda: {".pad": make})
    assert load(file="a/b.PAD") is TETRAHEDRON
    load(file="b.pad", size=3.0, set={"height": 2})
    assert asked == [(Path("a/b.PAD"), 1.0, None), (Path("b.pad"), 3.0, {"height": 2})]
    with pytest.raises(SceneError, match=r"^soft_bodies.pad.mesh: nodes has no effect on b.pad; remove it"):
        load(file="b.pad", nodes=100)


def fails(file: Path) -> VolumeMesh:
    raise KeyError("height")


def refuses(file: Path) -> VolumeMesh:
    raise MeshError(f"{file}: height = -1: must be positive")


@pytest.mark.parametrize(
    ("make", "error", "problem"),
    [
        (
            fails,
            PluginError,
            r"^soft_bodies.pad.mesh: mesh maker '.pad' failed on b.pad: KeyError: 'height' \(",
        ),
        (refuses, SceneError, r"^soft_bodies.pad.mesh: b.pad: height = -1: must be positive$"),
        (
            lambda file: None,
            PluginError,
            r"^soft_bodies.pad.mesh: mesh maker '.pad' returned None; must be a VolumeMesh$",
        ),
        (
            lambda file: VolumeMesh("made", TETRAHEDRON.nodes, TETRAHEDRON.elements[:, [0, 2, 1, 3]]),
            MeshError,
            r"^made: element 0 is inverted",
        ),
    ],
)
def test_what_is_wrong_with_it_is_said_with_the_key(
    install: Install, make: Any, error: type[Exception], problem: str
) -> None:
    install("one", taichisoft_mesh_makers=lambda: {".pad": make})
    with pytest.raises(error, match=problem):
        load(file="b.pad")


def test_only_what_is_meshed_has_a_size(install: Install) -> None:
    install("none", taichisoft_mesh_makers=lambda: {})
    with pytest.raises(MeshError, match=r"^b.pad: '.pad' is not a kind of volume mesh file"):
        load(file="b.pad")
    shipped = "data/meshes/tutorial-coarse.msh"
    with pytest.raises(SceneError, match=r"size has no effect on .*coarse.msh; remove it, or name a geometry"):
        load(file=str(Path(__file__).resolve().parents[2] / shipped), size=3.0)
    with pytest.raises(ValueError, match="nodes would have no effect beside size; remove it"):
        BodyMesh(file="b.toml", size=3.0, nodes=100)
