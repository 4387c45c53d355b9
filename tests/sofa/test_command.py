"""SOFA's scenes on the command line: run, check, convert, and the cache of their meshes."""

import os
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from blocks import make_block
from conftest import Command
from scenes_of_sofa import BODY, written

from taichisoft import VolumeMesh, load_scene, write_volume_mesh
from taichisoft.errors import SceneError
from taichisoft_sofa.scene_reader import read_scene

SCENE = """
from material import YOUNG

def createScene(root):
    root.addObject("RequiredPlugin", name="SoftRobots")
    free_motion(root)
    node = body(root)
    node.TetrahedronFEMForceField.youngModulus = YOUNG
    node.addObject("FixedConstraint", indices=[0, 1, 2])
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sofa: None) -> Path:
    """A folder with a scene, and a library that it imports in another one."""
    monkeypatch.setenv("TAICHISOFT_CACHE", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    write_volume_mesh(make_block((2, 1, 1), (20.0, 10.0, 10.0)), tmp_path / "block.vtk")
    written(tmp_path, {"scene.py": BODY + SCENE, "library/material.py": "YOUNG = 700\n"})
    return tmp_path


def test_run_with_libraries_lists_departures(folder: Path, command: Command) -> None:
    arguments = ("run", "scene.py", "--duration", "0.02", "--outputs", "csv", "-o", "out")
    code, _, errors = command(*arguments)
    assert code == 2
    assert "there is no 'material'" in errors or "No module named 'material'" in errors
    code, shown, errors = command(*arguments, "--python-path", "library")
    assert (code, errors) == (0, "")
    assert "without effect here: RequiredPlugin" in shown
    assert "otherwise than in SOFA" not in shown
    assert "young_modulus = 700.0" in (folder / "out" / "scene.toml").read_text()
    scene = load_scene("out/scene.toml")
    assert scene.controller is not None
    assert scene.controller.settings["python_path"] == [str(folder / "library")]


def test_a_run_has_as_many_steps_as_are_asked_for(folder: Path, command: Command) -> None:
    arguments = ("run", "scene.py", "--python-path", "library", "--outputs", "csv", "-o", "out", "--steps", 3)
    code, _, errors = command(*arguments)
    assert code == 0, errors
    times = np.genfromtxt(folder / "out" / "run.csv", delimiter=",", names=True)["time_s"]
    assert times == pytest.approx([0.01, 0.02, 0.03])
    code, _, errors = command(*arguments, "--duration", "0.01")
    assert code == 2
    assert "--steps 3, --duration 0.01: give one of them" in errors


def test_files_in_python_2_are_named(folder: Path, command: Command) -> None:
    (folder / "library" / "material.py").write_text("print 'a'\nYOUNG = 1401 / 2\n")
    arguments = ("run", "scene.py", "--duration", "0.01", "--outputs", "", "-o", "out", "--python-path", "library")
    code, shown, errors = command(*arguments)
    assert (code, errors) == (0, "")
    assert f"{folder / 'library/material.py'} is in Python 2 (line 1: " in shown
    assert "young_modulus = 700.0" in (folder / "out" / "scene.toml").read_text()


def test_settings_reach_the_reader_alone(folder: Path, command: Command) -> None:
    text = (folder / "scene.py").read_text().replace("body(root)\n", "body(root, correction=False)\n")
    (folder / "scene.py").write_text(text)
    _, shown, _ = command(
        "run",
        "scene.py",
        "--python-path",
        "library",
        "--sofa-exact",
        "--duration",
        "0.01",
        "--outputs",
        "",
        "-o",
        "out",
    )
    assert "otherwise than in SOFA: /body: stands still" in shown
    code, _, errors = command("run", "gripper", "--sofa-exact", "-o", "out")
    assert code == 2
    assert "sofa_exact has no effect on a .toml scene; settings: none" in errors
    with pytest.raises(SceneError, match=r"exact has no effect on a .py scene; did you mean 'sofa_exact'\?"):
        load_scene("scene.py", reader_settings={"exact": True})
    with pytest.raises(SceneError, match=r"^--python-path nowhere: no such folder$"):
        load_scene("scene.py", reader_settings={"python_path": f"library{os.pathsep}nowhere"})


def test_check_makes_steps_and_says_where_they_end(folder: Path, command: Command) -> None:
    fails = (
        "import Sofa.Core\nclass Mine(Sofa.Core.Controller):\n    n = 0\n    def onAnimateBeginEvent(self, event):\n"
    )
    fails += "        self.n += 1\n        assert self.n < 3, 'enough'\n"
    text = BODY + SCENE + "    root.addObject(Mine(name='mine'))\n"
    (folder / "fails.py").write_text(fails + text)
    code, shown, _ = command("sofa", "check", "--steps", 4, "--python-path", "library", "scene.py", "fails.py")
    assert code == 1
    assert "scene.py: can be run, 4 steps made" in shown
    assert "refused: after 2 of 4 steps: " in shown
    assert "enough" in shown
    assert "1 of 2 scenes can be run" in shown


def test_check_lists_all_and_fails_if_something_is_refused(folder: Path, command: Command) -> None:
    text = (folder / "scene.py").read_text()
    (folder / "other.py").write_text(f"{text}    node.addObject('CylinderCollisionModel')\n")
    (folder / "scene.py").write_text(f"{text}    node.UniformMass.showAxes = True\n    node.UniformMass.totalMas = 3\n")
    code, shown, _ = command("sofa", "check", "scene.py", "--python-path", "library")
    assert code == 0
    assert "scene.py: can be run" in shown
    assert "without effect: RequiredPlugin" in shown
    assert re.search(r"not read here: .*UniformMass \(showAxes\)", shown)
    assert "totalMas = 3 is not read here; did you mean 'totalMass'?" in shown
    code, shown, _ = command("sofa", "check", "scene.py", "other.py", "--python-path", "library")
    assert code == 1
    assert "other.py: refused" in shown
    assert "refused: CylinderCollisionModel '/body/CylinderCollisionModel' (" in shown
    assert "a surface that touches others" in shown


FAILING = {
    "missing.py": None,
    "own.py": "class Own(BaseException):\n    def __str__(self): raise ValueError\ndef createScene(root): raise Own",
    "ends.py": "import sys\ndef createScene(root): sys.exit('bye')",
    "deep.py": "def createScene(root): createScene(root)",
    "stops.py": "def createScene(root): raise GeneratorExit",
    "broken.py": "def createScene(root): 1 +",
    "escape.py": "def createScene(root):\n    print('\\x1b[2J')\n    raise ValueError('\\x1b[31m\\n\\r\\x07')",
}


def test_check_continues_after_failing_files(folder: Path, command: Command) -> None:
    for name, text in FAILING.items():
        if text is not None:
            (folder / name).write_text(text)
    code, shown, errors = command("sofa", "check", *FAILING, "scene.py", "--python-path", "library")
    assert (code, errors) == (1, "")
    assert [line for line in shown.splitlines() if not line.startswith(" ")] == [
        *(f"{name}: refused" for name in FAILING),
        "scene.py: can be run",
        "1 of 8 scenes can be run",
    ]
    assert all(character.isprintable() or character == "\n" for character in shown)
    for line in ("missing.py: no such file", "line 3: Own", "SystemExit: bye", "RecursionError", "GeneratorExit"):
        assert line in shown
    assert r"it says: \x1b[2J" in shown


AIR = """
    child = node.addChild("air")
    child.addObject("MeshTopology", position=[[0, 0, 0], [1, 0, 0], [0, 1, 0]], triangles=[[0, 1, 2]])
    child.addObject("MechanicalObject")
    child.addObject("SurfacePressureConstraint")
    child.addObject("BarycentricMapping")
"""


@pytest.mark.parametrize("open_cavity", [False, True])
def test_what_can_be_run_has_a_model(folder: Path, command: Command, open_cavity: bool) -> None:
    """Two elements that share an edge alone have no closed surface, which only bodies that collide need."""
    nodes = np.array([[0, 0, 0], [10, 0, 0], [0, 10, 0], [0, 0, 10], [0, -10, 0], [0, 0, -10]], dtype=np.float64)
    write_volume_mesh(VolumeMesh("edge", nodes, np.array([[0, 1, 2, 3], [0, 4, 1, 5]])), folder / "block.vtk")
    text = BODY + SCENE.replace("YOUNG", "700").replace("from material import 700", "")
    (folder / "scene.py").write_text(text + AIR * open_cavity)
    code, shown, _ = command("sofa", "check", "scene.py")
    assert code == open_cavity, shown
    assert ("is not closed" in shown) is open_cavity
    code, _, errors = command("run", "scene.py", "--duration", "0.01", "--outputs", "", "-o", "out")
    assert (code != 0) is open_cavity, errors


def test_a_scene_that_is_refused_is_one_line(folder: Path, command: Command) -> None:
    text = (folder / "scene.py").read_text()
    (folder / "other.py").write_text(f"{text}    for n in 'ab': node.addObject('CylinderCollisionModel', name=n)\n")
    code, _, errors = command("run", "other.py", "--python-path", "library")
    assert code == 2
    assert len(errors.splitlines()) == 1
    assert "(and 1 more: taichisoft sofa check " in errors


def test_a_converted_scene_is_the_same_without_its_program(folder: Path, command: Command) -> None:
    code, shown, _ = command("sofa", "convert", "scene.py", "-o", "made/native.toml", "--python-path", "library")
    assert code == 0
    assert "native.toml, with its meshes in " in shown
    shutil.move(folder / "made", folder / "moved")
    native = load_scene("moved/native.toml")
    whole = load_scene("scene.py", reader_settings={"python_path": "library"})
    ours, theirs = native.soft_bodies["body"], whole.soft_bodies["body"]
    assert native.controller is None
    assert ours.model_copy(update={"mesh": theirs.mesh}) == theirs
    assert Path(ours.mesh.file).read_bytes() == Path(theirs.mesh.file).read_bytes()
    code, _, errors = command("sofa", "convert", "scene.py", "-o", "native.yaml")
    assert code == 2
    assert "'.yaml' is not a kind of native scene; valid: .toml" in errors


def test_meshes_are_kept_by_their_content(folder: Path) -> None:
    first = read_scene(folder / "scene.py", "library")["soft_bodies"]["body"]["mesh"]
    written_at = Path(first).stat().st_mtime_ns
    (folder / "library" / "material.py").write_text("YOUNG = 800\n")
    again = read_scene(folder / "scene.py", "library")["soft_bodies"]["body"]
    assert (again["mesh"], again["young_modulus"]) == (first, 800.0)
    assert Path(first).stat().st_mtime_ns == written_at
    write_volume_mesh(make_block((1, 1, 1), (20.0, 10.0, 10.0)), folder / "block.vtk")
    assert read_scene(folder / "scene.py", "library")["soft_bodies"]["body"]["mesh"] != first


@pytest.mark.parametrize("damage", ["a bit", "cut", "gone", "folder"])
def test_a_kept_mesh_that_was_changed_is_made_anew(folder: Path, command: Command, damage: str) -> None:
    """One bit may leave a mesh that can be read, and another body."""
    kept = Path(read_scene(folder / "scene.py", "library")["soft_bodies"]["body"]["mesh"])
    whole = kept.read_bytes()
    place = len(whole) // 2
    turned = whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :]
    damages = {"a bit": turned, "cut": whole[:place]}
    if damage == "folder":
        shutil.rmtree(kept.parent)
    elif damage == "gone":
        kept.unlink()
    else:
        kept.write_bytes(damages[damage])
    arguments = ("run", "scene.py", "--duration", "0.01", "--outputs", "", "-o", "out", "--python-path", "library")
    code, shown, errors = command(*arguments)
    assert code == 0, errors
    assert kept.read_bytes() == whole
    assert ("does not match its checksum; it is written again" in shown) is (damage != "folder")
    _, shown, _ = command(*arguments)
    assert "checksum" not in shown
    assert [path for path in kept.parent.parent.iterdir() if path.name.startswith(".")] == []


HEEDS_KEYS = """
import Sofa.Core

class Mine(Sofa.Core.Controller):
    def onKeypressedEvent(self, event):
        pass
"""


@pytest.mark.parametrize("heeds", [True, False])
def test_page_sends_keys_to_scene_controllers(folder: Path, command: Command, heeds: bool) -> None:
    """With --web and no --controller; else the keyboard is there."""
    pytest.importorskip("viser")
    own = BODY + SCENE.replace("YOUNG", "700").replace("from material import 700", "")
    written(folder, {"own.py": own + ('    root.addObject(Mine(name="mine"))\n' + HEEDS_KEYS) * heeds})
    code, _, errors = command("run", "own.py", "--web", "--duration", "0.02", "--outputs", "csv", "-o", "out")
    assert code == 0, errors
    assert f'name = "{"sofa" if heeds else "keyboard"}"' in (folder / "out/scene.toml").read_text()


def test_a_table_counts_the_scenes_of_each_folder(folder: Path, command: Command) -> None:
    written(folder, {"empty.py": "def createScene(root):\n    pass\n"})
    wrong = "def createScene(root):\n    root.addObject('TriangularFEMForceField')\n"
    written(folder, {"other/wrong.py": wrong})
    scenes = ("scene.py", "empty.py", "other/wrong.py")
    code, shown, _ = command("sofa", "check", *scenes, "--python-path", "library", "--table")
    assert code == 1
    assert shown.splitlines()[:4] == [
        "| folder | scenes | run | the others |",
        "|---|---|---|---|",
        "| . | 2 | 1 | empty.py: holds nothing that moves, touches or can be seen: there is nothing to run |",
        "| other | 1 | 0 | wrong.py: TriangularFEMForceField '/TriangularFEMForceField': is not known here |",
    ]
    assert shown.splitlines()[4] == "1 of 3 scenes can be run; 1 of the others hold nothing to run"
