"""What is wrong in a scene is said in one line: key, value, and what would be valid."""

from typing import Any

import pytest

from taichisoft import load_scene
from taichisoft.errors import SceneError
from taichisoft.scene import scene_from_dict, scene_to_toml

SOFT: dict[str, Any] = {"mesh": "tutorial-coarse", "mass": 0.04, "young_modulus": 500, "poisson_ratio": 0.3}
BOX: dict[str, Any] = {"box": [10, 10, 10], "mass": 0.01}
PLANE: dict[str, Any] = {"plane": {"point": [0, 0, 0], "normal": [0, 0, 1]}}
NAN = float("nan")


def soft(**changes: Any) -> dict[str, Any]:
    return {"soft_bodies": {"finger": {**SOFT, **changes}}}


def cable(*points: Any) -> dict[str, Any]:
    return soft(cables={"c": {"points": list(points), "pull_point": [9.0, 0.0, 0.0]}})


def rigid(**changes: Any) -> dict[str, Any]:
    return {"rigid_bodies": {"cube": {**BOX, **changes}}}


def with_box(**tables: Any) -> dict[str, Any]:
    return {"rigid_bodies": {"cube": BOX}, **tables}


def with_obstacle(**changes: Any) -> dict[str, Any]:
    return with_box(obstacles={"floor": {**PLANE, **changes}})


def with_pairs(*pairs: list[str]) -> dict[str, Any]:
    return {**with_obstacle(), "contact": {"pairs": [{"bodies": pair, "friction": 1} for pair in pairs]}}


def without(table: dict[str, Any], key: str) -> dict[str, Any]:
    return {name: value for name, value in table.items() if name != key}


WRONG = [
    # unknown keys, at every depth, with the nearest valid one
    (with_box(gravitiy=[0, 0, 0]), "gravitiy: unknown key; did you mean 'gravity'?"),
    (soft(young_modul=500), "soft_bodies.finger.young_modul: unknown key; did you mean 'young_modulus'?"),
    (soft(anchors=[{"boxx": [[0, 0, 0], [1, 1, 1]]}]), "soft_bodies.finger.anchors.0.boxx: unknown key; did you mean"),
    (soft(cavities={"air": {"grup": "cavity"}}), "soft_bodies.finger.cavities.air.grup: unknown key; did you mean"),
    (with_box(contact={"frictoin": 0.3}), "contact.frictoin: unknown key; did you mean 'friction'?"),
    (with_box(contact={"xyz": 1}), "contact.xyz: unknown key; valid keys: "),
    (with_box(time={"stepp": 0.01}), "time.stepp: unknown key; did you mean 'step'?"),
    # missing and superfluous
    ({"soft_bodies": {"finger": without(SOFT, "mesh")}}, "soft_bodies.finger.mesh: this key is missing"),
    ({"soft_bodies": {"finger": without(SOFT, "mass")}}, "exactly one of mass, density is needed; given: none"),
    (soft(density=1e-6), "soft_bodies.finger: exactly one of mass, density is needed; given: mass, density"),
    (rigid(surface="cube.obj"), "cube.obj: no such file"),
    (
        {"rigid_bodies": {"cube": {"mass": 1}}},
        "exactly one of surface, box, sphere, cylinder, capsule is needed; given: none",
    ),
    (soft(anchors=[{}]), "soft_bodies.finger.anchors.0: exactly one of box, group, nodes is needed; given: none"),
    ({}, "a scene needs at least one soft body or rigid body"),
    (
        with_box(time={"dynamics": "overdamped"}, **soft()),
        "time.dynamics = 'overdamped' is for soft bodies alone; remove the rigid body 'cube'",
    ),
    (
        {**rigid(velocity=[0.0, 0.0, 5.0]), "time": {"dynamics": "static"}},
        "rigid_bodies.cube.velocity: nothing moves at the start with time.dynamics = 'static'; remove it",
    ),
    (
        with_box(time={"dynamics": "third order"}),
        "time.dynamics = 'third order': input should be 'inertial', 'overdamped' or 'static'",
    ),
    (with_box(time={"theta": 0.4}), "time.theta = 0.4: input should be greater than or equal to 0.5"),
    (with_box(time={"theta": float("nan")}), "time.theta = nan"),
    (
        soft(membranes={"paper": {"group": "top", "thickness": 0.1, "young_modulus": 1e6}}) | {"time": {"theta": 0.5}},
        "time.theta = 0.5 must be at least 0.55 with soft_bodies.finger.membranes, which gain energy below",
    ),
    (
        soft(anchors=[{"box": [[0, 0, 0], [1, 1, 1]]}]) | {"time": {"theta": 0.5, "dynamics": "static"}},
        "time.theta = 0.5 must be 1, implicit Euler, with time.dynamics = 'static'; leave one of them out",
    ),
    (
        soft(cables={"tendon": {"points": [[0, 0, 0], [1, 0, 0]], "friction": 0.2}}) | {"time": {"theta": 0.9}},
        "must be 1, implicit Euler, with soft_bodies.finger.cables.tendon.friction; leave one of them out",
    ),
    # without effect
    (rigid(scale=2), "rigid_bodies.cube: scale would have no effect beside box; remove it"),
    (
        with_obstacle(translation=[1, 0, 0]),
        "obstacles.floor: translation would have no effect beside plane; remove it",
    ),
    (with_obstacle(rotation=[0, 9, 0]), "obstacles.floor: rotation would have no effect beside plane; remove it"),
    (
        with_obstacle(scale=2, rotation=[0, 9, 0]),
        "obstacles.floor: scale, rotation would have no effect beside plane; remove it",
    ),
    # types
    (soft(young_modulus="stiff"), "soft_bodies.finger.young_modulus = 'stiff': "),
    (with_box(gravity=[0, 0]), "gravity"),
    (with_box(gravity=9810), "gravity = 9810: "),
    (rigid(box=[1, 2]), "rigid_bodies.cube.box"),
    (with_box(soft_bodies=[]), "soft_bodies = []: "),
    # values
    (soft(young_modulus=NAN), "soft_bodies.finger.young_modulus = nan: "),
    (with_box(gravity=[0, 0, NAN]), "gravity.2 = nan: "),
    (with_box(gravity=[0, 0, float("inf")]), "gravity.2 = inf: "),
    (soft(young_modulus=-1), "soft_bodies.finger.young_modulus = -1: input should be greater than 0"),
    (soft(mass=0), "soft_bodies.finger.mass = 0: input should be greater than 0"),
    (soft(poisson_ratio=0.5), "soft_bodies.finger.poisson_ratio = 0.5: input should be less than 0.5"),
    (soft(rayleigh_stiffness=-0.1), "soft_bodies.finger.rayleigh_stiffness = -0.1: "),
    (soft(corotation="svd"), "soft_bodies.finger.corotation = 'svd': input should be 'polar' or 'edges'"),
    (rigid(box=[1, 2, 0]), "rigid_bodies.cube.box.2 = 0: input should be greater than 0"),
    (with_box(time={"step": 0}), "time.step = 0: input should be greater than 0"),
    (with_box(contact={"friction": -0.1}), "contact.friction = -0.1: "),
    (with_box(contact={"contact_distance": 5}), "contact: alarm_distance (5) must exceed contact_distance (5)"),
    (with_box(contact={"max_iterations": 0}), "contact.max_iterations = 0: "),
    (
        with_box(obstacles={"floor": {"plane": {"point": [0, 0, 0], "normal": [0, 0, 0]}}}),
        "obstacles.floor.plane.normal: [0.0, 0.0, 0.0] has no direction; its length must not vanish",
    ),
    (soft(anchors=[{"nodes": [3, -1]}]), "soft_bodies.finger.anchors.0.nodes.1 = -1: input should be greater than or"),
    (soft(anchors=[{"nodes": [3.0]}]), "soft_bodies.finger.anchors.0.nodes.0 = 3.0: input should be a valid integer"),
    (soft(anchors=[{"nodes": []}]), "soft_bodies.finger.anchors.0.nodes = []: at least 1 is needed"),
    (soft(anchors=[{"nodes": [3, 5, 3]}]), "soft_bodies.finger.anchors.0: nodes names node 3 2 times; name every node"),
    (soft(regions=[{"nodes": [3], "young_modulus": 1}]), "soft_bodies.finger.regions.0.nodes: unknown key"),
    (soft(anchors=[{"box": [[1, 0, 0], [0, 1, 1]]}]), "soft_bodies.finger.anchors.0: the first corner of a box must"),
    (cable([0.0, 0.0, 0.0], [1.0, 2.0]), "soft_bodies.finger.cables.c.points.1 = [1.0, 2.0]: has 2 values; 3 are"),
    (cable({"area": [[0.0, 0.0, 0.0]], "weigths": [1.0]}), "points.0.weigths: unknown key; did you mean 'weights'?"),
    (cable({"area": [[0.0, 0.0, 0.0]], "weights": [1.0, 2.0]}), "points.0: weights has 2 numbers for the 1 points of"),
    (cable({"area": [[0.0, 0.0, 0.0]], "weights": [0.0]}), "points.0: weights are all 0; at least one point must be"),
    # names
    (
        cable({"body": "cub", "point": [0.0, 0.0, 0.0]}),
        "soft_bodies.finger.cables.c.points.0.body is 'cub', which is not a body; there are: finger",
    ),
    (
        with_box(
            frames={"a": {"follows": "a"}}, cameras={"c": {"eye": [0, 0, 1], "target": [0, 0, 0], "follows": "a"}}
        ),
        "frames.a carries itself: it follows a",
    ),
    (with_box(obstacles={"cube": PLANE}), "two bodies are called 'cube'; every body needs a name of its own"),
    (
        with_box(contact={"pairs": [{"bodies": ["cube", "flor"], "friction": 1}]}, obstacles={"floor": PLANE}),
        "contact.pairs.0.bodies.1 is 'flor', which is not a body; there are: cube, floor",
    ),
    (
        with_pairs(["cube", "cube"]),
        "contact.pairs names 'cube' with itself; a body touches itself only where it is",
    ),
    (
        soft(collision_surface=5),
        "soft_bodies.finger.collision_surface: 5 must be the name of a file, or a list",
    ),
    (soft(collision_surface=[{"groups": [1]}]), "soft_bodies.finger.collision_surface.0.file: this key is missing"),
    (soft(collision_surface=[{"file": "none.stl"}]), "soft_bodies.finger.collision_surface.0.file: none.stl: no such"),
    (with_pairs(["cube", "floor"], ["floor", "cube"]), "contact: pairs names 'floor' and 'cube' twice; keep one"),
    (with_box(goal={"object": "ball"}), "goal.object is 'ball', which is not a rigid body; there are: cube"),
    ({"soft_bodies": {"a": {"like": "b"}, "b": SOFT}}, "soft_bodies.a.like = 'b': must be a soft body above it"),
    # colours
    (
        soft(colour="red"),
        "soft_bodies.finger.colour: 'red' must be written #rrggbb in hexadecimal digits, as \"#c8321e",
    ),
    (
        with_box(obstacles={"floor": {**PLANE, "colour": "#12345g"}}),
        "obstacles.floor.colour: '#12345g' must be written",
    ),
    (with_box(appearance={"background": [1, 0, 0]}), "appearance.background: [1, 0, 0] must be written #rrggbb"),
    (with_box(appearance={"backgruond": "#ffffff"}), "appearance.backgruond: unknown key; did you mean 'background'?"),
    # files
    (soft(mesh="finger.msh"), "finger.msh: no such file, and none of the shipped meshes: "),
]


@pytest.mark.parametrize(("scene", "message"), WRONG, ids=[message[:48] for _, message in WRONG])
def test_what_is_wrong_is_said_in_one_line(scene: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError) as refused:
        scene_from_dict(scene, source="grasp.toml")
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)
    if "no such file" not in message:
        assert str(refused.value).startswith("grasp.toml: ")


def test_more_than_one_error_is_counted() -> None:
    with pytest.raises(SceneError, match=r"\(and 2 more\)$"):
        scene_from_dict(soft(mass=-1, young_modulus=-1, poisson_ratio=2))


def test_a_scene_written_and_read_again_is_equal(tmp_path: Any) -> None:
    """With `like` and defaults written out."""
    twin = {"like": "finger", "translation": [0, 100, 0], "anchors": [{"box": [[0, 0, -20], [0, 30, 20]]}]}
    bodies = {"finger": {**SOFT, "cavities": {"air": {"group": "cavity"}}}, "twin": twin}
    look = {
        "appearance": {"background": "#102030", "frame": False},
        "obstacles": {"floor": {**PLANE, "colour": "#C80000"}},
    }
    scene = scene_from_dict({"soft_bodies": bodies, "rigid_bodies": {"cube": BOX}, **look})
    assert scene.soft_bodies["twin"].young_modulus == 500
    path = tmp_path / "written.toml"
    path.write_text(scene_to_toml(scene), encoding="utf-8")
    assert load_scene(path) == scene


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("contact.friction", "--set contact.friction: must look like contact.friction=0.3"),
        ("contact.friction.x=1", "--set contact.friction.x=1: "),
        ("contact.friction=-1", "contact.friction = -1"),
        ("contact.friktion=1", "contact.friktion: unknown key; did you mean 'friction'?"),
    ],
)
def test_overrides_are_checked_too(tmp_path: Any, override: str, message: str) -> None:
    path = tmp_path / "scene.toml"
    path.write_text("[contact]\nfriction = 0.3\n[rigid_bodies.cube]\nbox = [1, 1, 1]\nmass = 1\n", encoding="utf-8")
    assert load_scene(path, ["contact.friction=0.5"]).contact.friction == 0.5
    with pytest.raises(SceneError) as refused:
        load_scene(path, [override])
    assert message in str(refused.value)


def test_broken_toml_is_refused_with_its_reason(tmp_path: Any) -> None:
    path = tmp_path / "scene.toml"
    path.write_text("gravity = [0, 0\n", encoding="utf-8")
    with pytest.raises(SceneError, match=r"scene\.toml: not readable as TOML: Unclosed array"):
        load_scene(path)
