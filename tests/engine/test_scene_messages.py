"""What is wrong in a scene is told in one line: the key, its value, and what would be valid."""

from pathlib import Path

import pytest

from taichisoft import load_scene
from taichisoft.errors import SceneError
from taichisoft.scene import data_folder, scene_from_dict

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


# FINGER stands for soft_bodies.finger; a row with "&" has several overrides.
WRONG = [
    # unknown keys, at every depth, with the nearest valid one
    ("gravty=3", "gravty: unknown key; did you mean 'gravity'?"),
    ("time.durration=3", "time.durration: unknown key; did you mean 'duration'?"),
    ("time.xyz=3", "time.xyz: unknown key; valid keys: step, duration"),
    ("contact.frictoin=0.3", "contact.frictoin: unknown key; did you mean 'friction'?"),
    ("contact.pairs=[{bodes=['cube','floor'], friction=1}]", "contact.pairs.0.bodes: unknown key; did you mean "),
    ("controller.nam='x'", "controller.nam: unknown key; did you mean 'name'?"),
    ("goal.objct='cube'", "goal.objct: unknown key; did you mean 'object'?"),
    ("appearance.backgruond='#ffffff'", "appearance.backgruond: unknown key; did you mean 'background'?"),
    ("FINGER.mas=1", "FINGER.mas: unknown key; did you mean 'mass'?"),
    ("FINGER.anchors.0.stifness=1", "FINGER.anchors.0.stifness: unknown key; did you mean "),
    ("FINGER.regions.0.yung_modulus=1", "FINGER.regions.0.yung_modulus: unknown key; did you mean "),
    ("FINGER.regions.0={nodes=[3], young_modulus=1}", "FINGER.regions.0.nodes: unknown key"),
    ("FINGER.cavities.cavity.grp=1", "FINGER.cavities.cavity.grp: unknown key; did you mean "),
    ("FINGER.cables={c={points=[{area=[[0,0,0]], weigths=[1]}]}}", "points.0.weigths: unknown key; did you mean 'we"),
    ("obstacles.floor.plane.normale=[1,0,0]", "obstacles.floor.plane.normale: unknown key; did you mean 'normal'?"),
    # missing and superfluous
    ("soft_bodies={finger={mass=1, young_modulus=1, poisson_ratio=0}}", "FINGER.mesh: this key is missing"),
    ("FINGER.collision_surface=[{groups=[1]}]", "FINGER.collision_surface.0.file: this key is missing"),
    ("FINGER.density=1", "FINGER: exactly one of mass, density is needed; given: mass, density"),
    ("rigid_bodies={cube={mass=1}}", "exactly one of surface, box, sphere, cylinder, capsule is needed; given: none"),
    ("rigid_bodies.cube.follows='base'", "cube: exactly one of mass, density, follows is needed; given: mass, follows"),
    ("FINGER.anchors.0={}", "FINGER.anchors.0: exactly one of box, group, nodes is needed; given: none"),
    ("rigid_bodies.cube.scale=2", "rigid_bodies.cube: scale would have no effect beside box; remove it"),
    ("obstacles.floor.translation=[1,0,0]", "floor: translation would have no effect beside plane; remove it"),
    (
        "obstacles.floor.scale=2 & obstacles.floor.rotation=[0,9,0]",
        "obstacles.floor: scale, rotation would have no effect beside plane; remove it",
    ),
    (
        "FINGER.cavities.cavity.shut_pressure=3",
        'shut_pressure would have no effect unless air = "sealed" or air = "network"; remove it',
    ),
    ("FINGER.cavities.cavity.air='line'", 'FINGER.cavities.cavity: air = "line" needs the key line'),
    ("goal={object='cube', kind='placed'}", 'goal: kind = "placed" needs the key position'),
    ("goal={object='cube', kind='lifted'}", 'goal: kind = "lifted" needs the key height'),
    ("goal={object='cube', height=3}", 'goal: height would have no effect unless kind = "lifted"; remove it'),
    ("goal={object='cube', kind='thrown'}", "goal.kind = 'thrown': input should be 'held', 'placed', 'pushed' or"),
    ("appearance.target=[0,0,0]", "appearance: target needs the key eye"),
    # types
    ("contact.friction='0.3'", "contact.friction = '0.3': input should be a valid number"),
    ("contact.friction=true", "contact.friction = True: input should be a valid number"),
    ("FINGER.anchors.0={nodes=[3.0]}", "FINGER.anchors.0.nodes.0 = 3.0: input should be a valid integer"),
    ("gravity=[0,0]", "gravity = [0, 0]: has 2 values; 3 are needed"),
    ("gravity=[0,0,0,0]", "gravity = [0, 0, 0, 0]: has 4 values; 3 are needed"),
    ("rigid_bodies.cube.box=[1,2]", "rigid_bodies.cube.box = [1, 2]: has 2 values; 3 are needed"),
    ("FINGER.cables={c={points=[[0,0,0],[1,2]]}}", "FINGER.cables.c.points.1 = [1, 2]: has 2 values; 3 are"),
    ("gravity=9.81", "gravity = 9.81: must be a list"),
    ("time=3", "time = 3: must be a table, [time]"),
    ("rigid_bodies=3", "rigid_bodies = 3: must be a table, [rigid_bodies]"),
    ("soft_bodies=[]", "soft_bodies = []: must be a table, [soft_bodies]"),
    ("FINGER.anchors=[1]", "FINGER.anchors.0 = 1: must be a table"),
    ("FINGER.collision_surface=5", "FINGER.collision_surface: 5 must be the name of a file, or a list"),
    ("FINGER.mesh=3", "FINGER.mesh: 3 must be the name of a file"),
    ("FINGER.pattern=5", "FINGER.pattern = 5: must be a table"),
    # values
    ("contact.friction=-1", "contact.friction = -1: input should be greater than or equal to 0"),
    ("contact.max_iterations=0", "contact.max_iterations = 0: input should be greater than 0"),
    ("contact.alarm_distance=0.5", "contact: alarm_distance (0.5) must exceed contact_distance (1)"),
    ("time.step=0", "time.step = 0: input should be greater than 0"),
    ("time.step=inf", "time.step = inf: input should be a finite number"),
    ("time.theta=nan", "time.theta = nan"),
    ("time.theta=0.4", "time.theta = 0.4: input should be greater than or equal to 0.5"),
    ("gravity=[0,0,nan]", "gravity.2 = nan: input should be a finite number"),
    ("FINGER.young_modulus=-5", "FINGER.young_modulus = -5: input should be greater than 0"),
    ("FINGER.poisson_ratio=0.5", "FINGER.poisson_ratio = 0.5: input should be less than 0.5"),
    ("FINGER.poisson_ratio=-1", "FINGER.poisson_ratio = -1: input should be greater than -1"),
    ("FINGER.rayleigh_stiffness=-0.1", "FINGER.rayleigh_stiffness = -0.1: input should be greater than or equal"),
    ("FINGER.regions.0.poisson_ratio=0.6", "regions.0.poisson_ratio = 0.6: input should be less than"),
    ("FINGER.anchors.0={box=[[0,0,0],[-1,1,1]]}", "they are [0.0, 0.0, 0.0] and [-1.0, 1.0, 1.0]"),
    ("FINGER.anchors.0={nodes=[3,-1]}", "FINGER.anchors.0.nodes.1 = -1: input should be greater than or equal to 0"),
    ("FINGER.anchors.0={nodes=[]}", "FINGER.anchors.0.nodes = []: at least 1 is needed"),
    ("FINGER.anchors.0={nodes=[3,5,3]}", "FINGER.anchors.0: nodes names node 3 2 times; name every node once"),
    ("FINGER.corotation='svd'", "FINGER.corotation = 'svd': input should be 'polar', 'edges' or 'none'"),
    ("rigid_bodies.cube.box=[1,2,0]", "rigid_bodies.cube.box.2 = 0: input should be greater than 0"),
    ("obstacles.floor.plane.normal=[0,0,0]", "floor.plane.normal: [0.0, 0.0, 0.0] has no direction; its length must"),
    ("FINGER.colour='red'", "FINGER.colour: 'red' must be written #rrggbb in hexadecimal digits, as \"#c8321e"),
    ("obstacles.floor.colour='#12345g'", "obstacles.floor.colour: '#12345g' must be written #rrggbb"),
    ("appearance.background=[1,0,0]", "appearance.background: [1, 0, 0] must be written #rrggbb"),
    (
        "FINGER.cables={c={points=[{area=[[0,0,0]], weights=[1,2]}]}}",
        "points.0: weights has 2 numbers for the 1 points",
    ),
    ("FINGER.cables={c={points=[{area=[[0,0,0]], weights=[0]}]}}", "points.0: weights are all 0; at least one point"),
    ("FINGER.cables={c={points=[[0,0,0]]}}", "c: points has 1 points; a cable needs two, its pull point counted"),
    ("FINGER.pattern={count=0, axis='x'}", "FINGER.pattern.count = 0: input should be greater than or equal to 1"),
    ("FINGER.pattern={count=2.5, axis='x'}", "FINGER.pattern.count = 2.5: input should be a valid integer"),
    ("FINGER.pattern={count=3}", "FINGER.pattern.axis: this key is missing"),
    ("FINGER.pattern={count=3, axis='w'}", "FINGER.pattern.axis = 'w': input should be 'x', 'y'"),
    ("FINGER.pattern={count=3, axis='x', center=[0,0,0]}", "FINGER.pattern.center: unknown key; did you mean 'centre'"),
    ("FINGER.pattern={count=2, axis='x', centre=[nan,0,0]}", "FINGER.pattern.centre.0 = nan"),
    ("FINGER.pattern={count=2, axis='x'} & FINGER.translation=[1]", "soft_bodies.finger1.translation = [1]"),
    # materials and laws
    ("FINGER.law='yeoh'", 'law = "yeoh" needs coefficients = { c10 } instead'),
    (
        "FINGER.coefficients={c10=1}",
        "FINGER: exactly one of young_modulus, coefficients is needed; given: young_modulus,",
    ),
    ("FINGER.law='ogden' & FINGER.coefficients={mu1=1, alpha1=2}", "exactly one of young_modulus, coefficients"),
    ("FINGER.element='smoothed' & FINGER.poisson_ratio=-0.1", "poisson_ratio = -0.1: must be 0 or more with element"),
    ("FINGER.corotation='edges'", 'corotation = "edges" is for element = "linear", not "smoothed"'),
    ("FINGER.corotation='none'", 'corotation = "none" is for element = "linear", not "smoothed"'),
    ("FINGER.material=3", "material = 3: must be the name of a material"),
    ("FINGER.material='dragon-skin-10'", "young_modulus would have no effect beside material"),
    ("FINGER.material='dragonskin-10'", "FINGER.material: dragonskin-10: no such file, and none of the shipped mate"),
    ("FINGER.material='dragonskin-10'", "did you mean 'dragon-skin-10'?"),
    # what goes together in a step
    (
        "time.dynamics='third order'",
        "time.dynamics = 'third order': input should be 'inertial', 'overdamped' or 'static'",
    ),
    (
        "time.dynamics='overdamped'",
        "time.dynamics = 'overdamped' is for soft bodies alone; remove the rigid body 'cube'",
    ),
    (
        "time.dynamics='static' & rigid_bodies.cube.velocity=[0,0,5]",
        "rigid_bodies.cube.velocity: nothing moves at the start with time.dynamics = 'static'; remove it",
    ),
    (
        "time.dynamics='static' & FINGER.anchors=[]",
        "'static' needs anchors of every soft body; FINGER.anchors is empty",
    ),
    (
        "time={theta=0.5, dynamics='static'}",
        "time.theta = 0.5 must be 1, implicit Euler, with time.dynamics = 'static'",
    ),
    (
        "time.theta=0.9 & FINGER.cables={c={points=[[0,0,0],[1,0,0]], friction=0.2}}",
        "must be 1, implicit Euler, with FINGER.cables.c.friction; leave one of them out",
    ),
    (
        "time.theta=0.5 & FINGER.membranes={paper={group='top', thickness=0.1, young_modulus=1e6}}",
        "time.theta = 0.5 must be at least 0.55 with FINGER.membranes, which gain energy below",
    ),
    ("limits.lowest_pressure=-102", "limits.lowest_pressure = -102 kPa must be above the vacuum's -101.325 kPa"),
    (
        "controller={name='scripted', period=0.015}",
        "must be a whole multiple of time.step = 0.01 s, such as 0.01 or 0.02 s",
    ),
    # names
    ("rigid_bodies={'a.b'={box=[1,1,1],mass=1}}", "rigid_bodies has a 'a.b': a name must not be empty nor contain"),
    ("rigid_bodies.finger={box=[1,1,1],mass=1}", "two bodies are called 'finger'; every body needs a name of its own"),
    ("obstacles={cube={box=[1,1,1]}}", "two bodies are called 'cube'; every body needs a name of its own"),
    (
        "FINGER.pattern={count=2, axis='x'} & soft_bodies.finger2={like='finger'}",
        "makes a body called 'finger2', which is",
    ),
    ("goal.object='cub'", "goal.object is 'cub', which is not a rigid body; there are: cube"),
    (
        "FINGER.cables={c={points=[{body='cub', point=[0,0,0]},[1,0,0]]}}",
        "FINGER.cables.c.points.0.body is 'cub', which is not a body; there are: finger, cube, floor",
    ),
    (
        "contact.pairs=[{bodies=['cube','flor'], friction=1}]",
        "contact.pairs.0.bodies.1 is 'flor', which is not a body; there are: finger, cube, floor",
    ),
    ("contact.pairs=[{bodies=['cube','cube'], friction=1}]", "contact.pairs names 'cube' with itself; a body touches"),
    (
        "contact.pairs=[{bodies=['cube','floor'], friction=1},{bodies=['floor','cube'], friction=1}]",
        "contact: pairs names 'floor' and 'cube' twice; keep one of the two",
    ),
    ("frames.jaw.follows='bas'", "frames.jaw.follows is 'bas', which is not a frame; there are: base, jaw"),
    (
        "frames.jaw.follows='jaw' & cameras={c={eye=[0,0,1], target=[0,0,0], follows='jaw'}}",
        "frames.jaw carries itself: it follows jaw",
    ),
    # files
    ("FINGER.mesh='finger.msh'", "FINGER.mesh: finger.msh: no such file, and none of the shipped meshes: "),
    ("FINGER.collision_surface=[{file='none.stl'}]", "FINGER.collision_surface.0.file: none.stl: no such file"),
    ("rigid_bodies.cube={mass=1, surface='cube.obj'}", "rigid_bodies.cube.surface: cube.obj: no such file"),
    ("FINGER.mesh='tutorial-corse'", "did you mean 'tutorial-coarse'?"),
]


@pytest.mark.parametrize(("overrides", "message"), WRONG, ids=[message[:48] for _, message in WRONG])
def test_mistake_is_told_in_one_line(path: Path, overrides: str, message: str) -> None:
    changes = overrides.replace("FINGER", "soft_bodies.finger").split(" & ")
    line = refusal(path, *changes)
    assert message.replace("FINGER", "soft_bodies.finger") in line
    assert line.startswith(f"{path} with --set {changes[0]}")


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
def test_override_that_leads_nowhere_is_refused(path: Path, override: str, message: str) -> None:
    path.write_text(SCENE + "\n[contact]\nfriction = 0.5\n")
    assert refusal(path, override).startswith(f"--set {override}: {message}")


@pytest.mark.parametrize("overrides", [{"contact.friction": 0.5}, None, "contact.friction=0.5"])
def test_overrides_must_be_a_list_of_texts(overrides: object) -> None:
    with pytest.raises(SceneError) as refused:
        load_scene("gripper", overrides)  # type: ignore[arg-type]
    assert str(refused.value) == f'overrides = {overrides!r}: must be a list of texts, such as ["contact.friction=0.3"]'


def test_misspelt_key_is_named_before_the_missing_one(path: Path) -> None:
    path.write_text(SCENE.replace("poisson_ratio", "poison_ratio"))
    message = f"{path}: soft_bodies.finger.poison_ratio: unknown key; did you mean 'poisson_ratio'? (and 1 more)"
    assert refusal(path) == message
    path.write_text(SCENE.replace("soft_bodies.finger", "soft_bodies.regions"))  # a body is named like a key
    assert "did you mean 'mass'?" in refusal(path, "soft_bodies.regions.mas=1")


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ("law = 'hooke', coefficients = { c10 = 1.0 }", 'law = "hooke" takes young_modulus instead of coefficients'),
        ("law = 'yeoh', coefficients = { c10 = 1.0, c02 = 1.0 }", 'coefficients.c02: law = "yeoh" has c10, c20'),
        ("law = 'mooney-rivlin', coefficients = { c10 = 1.0 }", 'law = "mooney-rivlin" needs c01, too'),
        ("law = 'ogden', coefficients = { mu1 = 1.0, alpha1 = 2.0, mu2 = 1.0 }", "needs alpha2, too"),
        ("law = 'ogden', coefficients = { mu1 = 1.0, alpha1 = -2.0 }", "modulus at rest is -1 kPa; must be positive"),
        ("law = 'yeoh'", "exactly one of young_modulus, coefficients is needed; given: none"),
        ("mas = 1, density = 1e-6", "soft_bodies.f.mas: unknown key"),
    ],
)
def test_law_with_other_coefficients_is_refused(path: Path, keys: str, message: str) -> None:
    path.write_text(f"soft_bodies.f = {{ mesh = 'tutorial-coarse', mass = 0.04, poisson_ratio = 0.4, {keys} }}")
    assert message in refusal(path)


@pytest.mark.parametrize("like", ["fingr", "second", ["finger"], 3])
def test_like_must_name_a_body_above(path: Path, like: object) -> None:
    path.write_text(SCENE + f"[soft_bodies.second]\nlike = {like!r}\n")
    assert f"soft_bodies.second.like = '{like}': must be a soft body above it; there are: finger" in refusal(path)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "a scene needs at least one soft body or rigid body"),
        (b"a = [1, 2", "not readable as TOML: Unclosed array"),
        (b"\xff\xfe\x00", "not readable as TOML: "),
        (b"[time]\n[time]\n", "not readable as TOML: Cannot declare ('time',) twice"),
    ],
)
def test_file_without_a_scene_is_named(path: Path, content: bytes, message: str) -> None:
    path.write_bytes(content)
    assert refusal(path).startswith(f"{path}: {message}")


def test_missing_file_is_named_with_the_nearest_that_ships(path: Path) -> None:
    assert refusal(path.parent).startswith(f"{path.parent}: is a folder; a file (.toml")  # and what plug-ins read
    assert refusal("griper").endswith(f"none of the shipped scenes: {', '.join(SHIPPED)}; did you mean 'gripper'?")


def test_errors_begin_with_the_source_and_end_with_their_count() -> None:
    with pytest.raises(SceneError, match=r"^my scene: rigid_bodies\.cube\.mas: unknown key; .* \(and 2 more\)$"):
        scene_from_dict({"rigid_bodies": {"cube": {"box": [1, 1, -1], "mas": 1, "density": -1}}}, source="my scene")
