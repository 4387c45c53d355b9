"""Scene files: what is wrong is named with its key in one line; overrides, inheritance and the resolved scene."""

from pathlib import Path
from typing import Any

import pytest

from taichisoft import load_scene
from taichisoft.errors import SceneError
from taichisoft.scene import data_folder, scene_from_dict, scene_to_toml

SCENE = """
[soft_bodies.finger]
mesh = "tutorial-coarse"
mass = 0.04
young_modulus = 500.0
poisson_ratio = 0.3
anchors = [{ group = "base" }]
regions = [{ group = "silicone", young_modulus = 1500.0 }]
cavities.cavity.group = "cavity"
[rigid_bodies.cube]
box = [10, 10, 10]
mass = 0.001
[obstacles.floor]
plane = { point = [0, 0, 0], normal = [0, 0, 1] }
"""
SHIPPED = sorted(path.stem for path in (data_folder() / "scenes").glob("*.toml"))


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "scene.toml"
    path.write_text(SCENE)
    return path


def refusal(path: Path | str, *overrides: str) -> str:
    with pytest.raises(SceneError) as refused:
        load_scene(path, overrides)
    assert "\n" not in str(refused.value)
    return str(refused.value)


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("gravty=3", "gravty: unknown key; did you mean 'gravity'?"),
        ("time.durration=3", "time.durration: unknown key; did you mean 'duration'?"),
        ("time.xyz=3", "time.xyz: unknown key; valid keys: step, duration"),
        ("contact.pairs=[{bodes=['cube','floor'], friction=1}]", "contact.pairs.0.bodes: unknown key; did you mean "),
        ("controller.nam='x'", "controller.nam: unknown key; did you mean 'name'?"),
        ("goal.objct='cube'", "goal.objct: unknown key; did you mean 'object'?"),
        ("soft_bodies.finger.mas=1", "soft_bodies.finger.mas: unknown key; did you mean 'mass'?"),
        (
            "soft_bodies.finger.anchors.0.stifness=1",
            "soft_bodies.finger.anchors.0.stifness: unknown key; did you mean ",
        ),
        ("soft_bodies.finger.regions.0.yung_modulus=1", "soft_bodies.finger.regions.0.yung_modulus: unknown key; did "),
        ("soft_bodies.finger.cavities.cavity.grp=1", "soft_bodies.finger.cavities.cavity.grp: unknown key; did you "),
        ("obstacles.floor.plane.normale=[1,0,0]", "obstacles.floor.plane.normale: unknown key; did you mean 'normal'?"),
    ],
)
def test_an_unknown_key_is_named_at_every_depth_with_the_nearest_right_one(
    path: Path, override: str, message: str
) -> None:
    assert f"{path} with --set {override}: {message}" in refusal(path, override)


def test_the_misspelt_key_is_named_rather_than_the_one_that_is_missing_for_it(path: Path) -> None:
    path.write_text(SCENE.replace("poisson_ratio", "poison_ratio"))
    message = f"{path}: soft_bodies.finger.poison_ratio: unknown key; did you mean 'poisson_ratio'? (and 1 more)"
    assert refusal(path) == message


def test_a_body_named_like_a_key_does_not_mislead_the_search_for_the_nearest_key(path: Path) -> None:
    path.write_text(SCENE.replace("soft_bodies.finger", "soft_bodies.regions"))
    assert "did you mean 'mass'?" in refusal(path, "soft_bodies.regions.mas=1")


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("contact.friction='0.3'", "contact.friction = '0.3': input should be a valid number"),
        ("contact.friction=true", "contact.friction = True: input should be a valid number"),
        ("contact.friction=-1", "contact.friction = -1: input should be greater than or equal to 0"),
        ("contact.max_iterations=0", "contact.max_iterations = 0: input should be greater than 0"),
        ("contact.contact_distance=0", "contact.contact_distance = 0: input should be greater than 0"),
        ("contact.alarm_distance=0.5", "contact: alarm_distance (0.5) must exceed contact_distance (1)"),
        ("time.step=0", "time.step = 0: input should be greater than 0"),
        ("time.step=inf", "time.step = inf: input should be a finite number"),
        ("time.duration=nan", "time.duration = nan: input should be a finite number"),
        ("gravity=[0,0,nan]", "gravity.2 = nan: input should be a finite number"),
        ("gravity=[0,0]", "gravity = [0, 0]: has 2 values; 3 are needed"),
        ("gravity=[0,0,0,0]", "gravity = [0, 0, 0, 0]: has 4 values; 3 are needed"),
        ("gravity=9.81", "gravity = 9.81: must be a list"),
        ("time=3", "time = 3: must be a table, [time]"),
        ("rigid_bodies=3", "rigid_bodies = 3: must be a table, [rigid_bodies]"),
        ("soft_bodies.finger.anchors=[1]", "soft_bodies.finger.anchors.0 = 1: must be a table"),
        ("soft_bodies.finger.young_modulus=-5", "soft_bodies.finger.young_modulus = -5: input should be greater than"),
        ("soft_bodies.finger.mass=0", "soft_bodies.finger.mass = 0: input should be greater than 0"),
        ("soft_bodies.finger.density=1", "soft_bodies.finger: exactly one of mass, density is needed; given: mass, de"),
        ("soft_bodies.finger.poisson_ratio=0.5", "soft_bodies.finger.poisson_ratio = 0.5: input should be less than"),
        ("soft_bodies.finger.poisson_ratio=-1", "soft_bodies.finger.poisson_ratio = -1: input should be greater than"),
        ("soft_bodies.finger.regions.0.poisson_ratio=0.6", "regions.0.poisson_ratio = 0.6: input should be less than"),
        ("soft_bodies.finger.anchors.0={box=[[0,0,0],[-1,1,1]]}", "they are [0.0, 0.0, 0.0] and [-1.0, 1.0, 1.0]"),
        ("soft_bodies.finger.corotation='big'", "soft_bodies.finger.corotation = 'big': input should be 'polar' or"),
        ("rigid_bodies={'a.b'={box=[1,1,1],mass=1}}", "rigid_bodies has a 'a.b': a name must not be empty nor contain"),
        ("rigid_bodies.finger={box=[1,1,1],mass=1}", "two bodies are called 'finger'; every body needs a name of its"),
        ("goal.object='cub'", "goal.object is 'cub', which is not a rigid body; there are: cube"),
        (
            "contact.pairs=[{bodies=['cube','x'], friction=1}]",
            "contact.pairs.0.bodies.1 is 'x', which is not a body; there are: ",
        ),
    ],
)
def test_a_wrong_value_is_named_with_its_key(path: Path, override: str, message: str) -> None:
    assert message in refusal(path, override)


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("contact.friction", "must look like contact.friction=0.3"),
        ("=3", "must look like contact.friction=0.3"),
        ("contact..friction=3", "must look like contact.friction=0.3"),
        ("soft_bodies.fingr.mass=1", "soft_bodies has no 'fingr'; did you mean 'finger'?"),
        ("soft_bodies.finger.anchors.1.stiffness=1", "soft_bodies.finger.anchors has no entry '1'; it has 1, counted"),
        ("soft_bodies.finger.anchors.-1.stiffness=1", "soft_bodies.finger.anchors has no entry '-1'; it has 1"),
        ("contact.friction.x=1", "contact.friction is not a table: it has no 'x'"),
        ("contact.pairs.0.friction=1", "contact has no list 'pairs' of its own"),
    ],
)
def test_an_override_that_leads_nowhere_says_where_it_stops(path: Path, override: str, message: str) -> None:
    path.write_text(SCENE + "\n[contact]\nfriction = 0.5\n")
    assert refusal(path, override).startswith(f"--set {override}: {message}")


def test_overrides_reach_lists_absent_tables_and_text(path: Path) -> None:
    scene = load_scene(
        path,
        ["soft_bodies.finger.anchors.0.stiffness=5e3", "contact.friction = 0.25", "title=two words", "time.step=0.005"],
    )
    assert scene.soft_bodies["finger"].anchors[0].stiffness == 5e3
    assert (scene.contact.friction, scene.title, scene.time.step) == (0.25, "two words", 0.005)


def test_like_takes_over_what_a_body_does_not_say_itself(path: Path) -> None:
    path.write_text(SCENE + '[soft_bodies.second]\nlike = "finger"\nyoung_modulus = 300.0\n')
    scene = load_scene(path, ["soft_bodies.finger.poisson_ratio=0.4"])
    first, second = scene.soft_bodies.values()
    assert second == first.model_copy(update={"young_modulus": 300.0})
    assert second.poisson_ratio == 0.4


@pytest.mark.parametrize("like", ["fingr", "second", ["finger"], 3])
def test_like_that_names_no_body_above_is_refused(path: Path, like: Any) -> None:
    path.write_text(SCENE + f"[soft_bodies.second]\nlike = {like!r}\n")
    assert f"soft_bodies.second.like = '{like}': must be a soft body above it; there are: finger" in refusal(path)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "a scene needs at least one soft body or rigid body"),
        (b"a = [1,", "not readable as TOML: "),
        (b"\xff\xfe\x00", "not readable as TOML: "),
        (b"[time]\n[time]\n", "not readable as TOML: Cannot declare ('time',) twice"),
    ],
)
def test_a_file_that_is_no_scene_is_named(path: Path, content: bytes, message: str) -> None:
    path.write_bytes(content)
    assert refusal(path).startswith(f"{path}: {message}")


def test_a_file_that_is_absent_is_named_with_the_nearest_that_ships(path: Path) -> None:
    assert refusal(path.parent).startswith(f"{path.parent}: is a folder; a file (.toml")  # and what plug-ins read
    assert refusal("griper").endswith(f"none of the shipped scenes: {', '.join(SHIPPED)}; did you mean 'gripper'?")
    assert "soft_bodies.finger.mesh: 3 must be the name of a file" in refusal(path, "soft_bodies.finger.mesh=3")
    path.write_text(SCENE.replace("tutorial-coarse", "tutorial-corse"))
    assert refusal(path).startswith(f"{path}: soft_bodies.finger.mesh: tutorial-corse: no such file")
    assert refusal(path).endswith("did you mean 'tutorial-coarse'?")


def test_files_are_looked_for_beside_the_scene_first(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    for folder in (tmp_path, elsewhere):
        (folder / "tutorial-coarse.msh").touch()
    assert load_scene(path).soft_bodies["finger"].mesh.file == str(tmp_path / "tutorial-coarse.msh")
    (tmp_path / "tutorial-coarse.msh").unlink()
    assert load_scene(path).soft_bodies["finger"].mesh.file == str(elsewhere / "tutorial-coarse.msh")
    (elsewhere / "tutorial-coarse.msh").unlink()
    shipped = data_folder() / "meshes" / "tutorial-coarse.msh"
    assert load_scene(path).soft_bodies["finger"].mesh.file == str(shipped)


@pytest.mark.parametrize("name", SHIPPED)
def test_the_resolved_scene_reads_back_equal(name: str, tmp_path: Path) -> None:
    scene = load_scene(name)
    resolved = tmp_path / "resolved.toml"
    resolved.write_text(scene_to_toml(scene), encoding="utf-8")
    assert load_scene(resolved) == scene
    text = resolved.read_text(encoding="utf-8")
    for default in ("max_iterations = 1000", "alarm_distance = 5.0", 'corotation = "polar"', "stiffness = 1"):
        assert default in text  # a later version with other defaults must give the same run


def test_a_scene_made_in_python_begins_its_errors_with_the_given_source() -> None:
    with pytest.raises(SceneError, match=r"^my scene: rigid_bodies\.cube\.mas: unknown key; did you mean 'mass'"):
        scene_from_dict({"rigid_bodies": {"cube": {"box": [1, 1, 1], "mas": 1}}}, source="my scene")


@pytest.mark.parametrize("overrides", [{"contact.friction": 0.5}, None, "contact.friction=0.5"])
def test_overrides_that_are_no_list_of_texts_are_one_line(overrides: Any) -> None:
    with pytest.raises(SceneError) as refused:
        load_scene("gripper", overrides)
    assert str(refused.value) == f'overrides = {overrides!r}: must be a list of texts, such as ["contact.friction=0.3"]'
