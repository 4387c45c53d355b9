"""Scenes in formats that plug-ins read: overrides, inheritance, file names and errors are those of TOML."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from taichisoft import load_scene
from taichisoft.errors import PluginError, SceneError
from taichisoft.scene import scene_to_toml

Install = Callable[..., None]
SCENE: dict[str, Any] = {
    "title": "one cube",
    "rigid_bodies": {"cube": {"box": [10.0, 10.0, 10.0], "mass": 0.001}},
    "soft_bodies": {
        "left": {"mesh": "body.msh", "mass": 0.04, "young_modulus": 500, "poisson_ratio": 0.3},
        "right": {"like": "left", "translation": [0, 50, 0]},
    },
}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.json").write_text(json.dumps(SCENE))
    (tmp_path / "body.msh").touch()
    return tmp_path


def read(path: Path) -> Any:
    return json.loads(path.read_text())


def test_a_scene_of_another_format_is_like_the_same_in_toml(install: Install, folder: Path) -> None:
    install("json", taichisoft_scene_readers=lambda: {".json": read})
    scene = load_scene(folder / "scene.json", ["rigid_bodies.cube.mass=0.02"])
    assert scene.rigid_bodies["cube"].mass == 0.02
    assert scene.soft_bodies["right"].mesh.file == str(folder / "body.msh")
    (folder / "same.toml").write_text(scene_to_toml(scene))
    assert load_scene(folder / "same.toml") == scene
    assert load_scene("scene") == load_scene(folder / "scene.json")
    (folder / "SCENE2.JSON").write_text(json.dumps(SCENE))
    assert load_scene(folder / "SCENE2.JSON") == load_scene("scene")


def test_what_a_reader_keeps_is_not_changed_by_overrides(install: Install, folder: Path) -> None:
    kept = read(folder / "scene.json")
    install("json", taichisoft_scene_readers=lambda: {".json": lambda path: kept})
    load_scene("scene.json", ["rigid_bodies.cube.mass=0.02"])
    assert kept == SCENE


def test_a_toml_scene_asks_no_plugin(install: Install, folder: Path) -> None:
    def fail() -> Any:
        raise RuntimeError

    install("broken", taichisoft_scene_readers=fail)
    (folder / "scene.toml").write_text("rigid_bodies.cube = { box = [1.0, 1.0, 1.0], mass = 1.0 }")
    assert list(load_scene("scene").rigid_bodies) == ["cube"]
    assert list(load_scene("gripper").rigid_bodies) == ["cube"]


def test_files_of_other_suffixes_are_toml(install: Install, folder: Path) -> None:
    install("json", taichisoft_scene_readers=lambda: {".json": read})
    (folder / "scene.txt").write_text("rigid_bodies.cube = { box = [1.0, 1.0, 1.0], mass = 1.0 }")
    assert list(load_scene("scene.txt").rigid_bodies) == ["cube"]
    (folder / "scene.yaml").write_text("a: 1")
    with pytest.raises(SceneError, match=r"scene.yaml: not readable as TOML: "):
        load_scene("scene.yaml")


def test_a_missing_scene_is_an_error_with_and_without_readers(install: Install, folder: Path) -> None:
    with pytest.raises(SceneError, match=r"^nothing.json: no such file, and none of the shipped scenes: "):
        load_scene("nothing.json")
    install("json", taichisoft_scene_readers=lambda: {".json": read})
    with pytest.raises(SceneError, match=r"^nothing.json: no such file, and none of the shipped scenes: "):
        load_scene("nothing.json")


def test_errors_begin_with_the_file(install: Install, folder: Path) -> None:
    def refuse(path: Path) -> Any:
        raise SceneError(f"{path}: line 3: a bracket is missing")

    install("json", taichisoft_scene_readers=lambda: {".json": read, ".list": lambda path: [], ".bad": refuse})
    (folder / "scene.json").write_text("{")
    with pytest.raises(
        PluginError, match=r"scene.json: scene reader '.json' failed: JSONDecodeError: .*test_scene_rea"
    ):
        load_scene("scene.json")
    (folder / "scene.json").write_text('{"titel": "x", "rigid_bodies": {}}')
    with pytest.raises(SceneError, match=r"scene.json: titel: unknown key; did you mean 'title'\?"):
        load_scene("scene.json")
    (folder / "scene.list").touch()
    with pytest.raises(
        PluginError, match=r"scene.list: scene reader '.list' returned \[\]; must be a mapping of tables"
    ):
        load_scene("scene.list")
    (folder / "scene.bad").touch()
    with pytest.raises(SceneError, match=r"scene.bad: line 3: a bracket is missing$"):
        load_scene("scene.bad")


@pytest.mark.parametrize(
    ("suffix", "problem"),
    [
        (".toml", r"^scene reader '.toml': TOML is read without a plug-in$"),
        ("json", r"^scene reader 'json': must look like '.yaml', in small letters$"),
        (".JSON", r"^scene reader '.JSON': must look like"),
    ],
)
def test_a_suffix_that_cannot_be_is_refused(install: Install, folder: Path, suffix: str, problem: str) -> None:
    install("json", taichisoft_scene_readers=lambda: {suffix: read})
    with pytest.raises(PluginError, match=problem):
        load_scene("scene.json")
