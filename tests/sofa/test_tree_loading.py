"""Scenes run with our modules in place of SOFA's, which leave no trace, also in Python 2; controllers get events."""

import sys
from collections.abc import Iterator
from pathlib import Path
from textwrap import dedent
from types import ModuleType

import numpy as np
import pytest
from scenes_of_sofa import declare, loaded, only_types, written

from taichisoft.errors import ControllerFailed, SceneError
from taichisoft_sofa.loading import load_tree
from taichisoft_sofa.tree.scene_modules import compiled
from taichisoft_sofa.tree.value_kinds import VECTOR, fixed, vectors


@pytest.fixture(autouse=True)
def known_types(monkeypatch: pytest.MonkeyPatch) -> None:
    """The data of a cable and of positions are known."""
    only_types(monkeypatch)
    declare("CableConstraint", value=(VECTOR, [0.0]), pullPoint=fixed(3))
    declare("MechanicalObject", rest_position=vectors(3))


@pytest.fixture(autouse=True)
def same_python(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Every test leaves this Python as it was."""
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    modules, path, hooks, folder = dict(sys.modules), list(sys.path), list(sys.meta_path), Path.cwd()
    yield
    assert not [name for name in modules if sys.modules.get(name) is not modules[name]]
    assert not [
        name
        for name in sys.modules.keys() - modules.keys()
        if name.startswith(("Sofa", "stlib", "splib", "softrobots", "__sofa", "own_"))
    ]
    assert (sys.path, sys.meta_path, Path.cwd()) == (path, hooks, folder)
    assert not sys.dont_write_bytecode
    assert not [entry for entry in sys.path_importer_cache if entry not in path and "pytest-of" in entry]


CONTROLLER = """
    import Sofa.Core
    import Sofa.constants.Key as Key

    class Own(Sofa.Core.Controller):
        def __init__(self, *args, **kwargs):
            Sofa.Core.Controller.__init__(self, args, kwargs)
            self.node = args[0]
            self.name = "Own"
            self.seen = []

        def init(self):
            self.seen.append("init")

        def onKeypressedEvent(self, event):
            self.seen.append(event["key"])
            if event["key"] == Key.plus:
                self.node.cable.value = [self.node.cable.value[0] + 1.0]

        def onAnimateBeginEvent(self, event):
            from own_later import late
            self.seen.append(late(event["dt"]))

        def onAnimateEndEvent(self, event):
            self.seen.append("end")
"""


def test_a_scene_builds_a_tree(tmp_path: Path) -> None:
    tree = loaded(
        tmp_path, 'root.gravity.value = [0, -9810, 0]\nroot.addChild("finger").addObject("BoxROI", box="1 2")'
    )
    assert tree.root.gravity.value.tolist() == [0, -9810, 0]
    assert [node.getName() for node in tree.nodes()] == ["root", "finger"]
    (roi,) = tree.components()
    assert (roi.place.file, roi.place.line) == (str(tmp_path / "scene.py"), 4)
    assert tree.path == tmp_path / "scene.py"


def test_every_module_of_sofa_that_scenes_import_is_there(tmp_path: Path) -> None:
    imports = """
        import Sofa, Sofa.Core, Sofa.Simulation, Sofa.Helper, Sofa.Types, Sofa.constants, SofaRuntime
        import Sofa.constants.Key as Key
        from Sofa.constants import *
        from Sofa.Helper import msg_info
        SofaRuntime.importPlugin("SoftRobots")
        assert [ord(key) for key in (Key.leftarrow, Key.uparrow, Key.rightarrow, Key.downarrow)] == [18, 19, 20, 21]
        assert Sofa.constants.Key.plus == "+" and Key.A == "A"
        Sofa.msg_warning("scene", "take care")
    """
    loaded(tmp_path, "assert isinstance(root, Sofa.Core.Node)", imports)


def test_what_our_modules_do_not_have_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"scene.py, line 3: AttributeError: taichisoft's Sofa.Core has no 'Mapping'"):
        loaded(tmp_path, "Sofa.Core.Mapping()", "import Sofa.Core")


def test_a_real_sofa_is_neither_used_nor_touched(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = ModuleType("Sofa")
    written(tmp_path / "real", {"SofaRuntime.py": "raise RuntimeError"})
    with monkeypatch.context() as changed:
        changed.setitem(sys.modules, "Sofa", real)
        changed.setattr(sys, "path", [str(tmp_path / "real"), *sys.path])
        loaded(tmp_path, "root.addChild(Sofa.Core.Node('finger'))", "import Sofa.Core, SofaRuntime")
        assert sys.modules["Sofa"] is real


def test_scene_finds_files_in_its_folder(tmp_path: Path) -> None:
    written(tmp_path / "deeper", {"points.txt": "1 2 3"})
    create = """
        import os
        from own_parts import position
        assert os.getcwd() == os.path.dirname(os.path.abspath(__file__))
        root.addObject("MechanicalObject", rest_position=open("deeper/points.txt").read(), position=position)
    """
    tree = loaded(tmp_path, create, files={"own_parts.py": "position = [[4, 5, 6]]"})
    assert np.array_equal(tree.root.MechanicalObject.rest_position.value, [[1, 2, 3]])
    assert np.array_equal(tree.root.MechanicalObject.position.value, [[4, 5, 6]])
    assert tree.find_file("deeper/points.txt") == tmp_path / "deeper/points.txt"
    assert tree.find_file("deeper/none.txt") is None
    assert not list(tmp_path.rglob("__pycache__"))


def test_folders_of_files_that_a_scene_registers(tmp_path: Path) -> None:
    written(tmp_path / "meshes", {"cube.obj": ""})
    tree = loaded(tmp_path, 'import SofaRuntime\nSofaRuntime.DataRepository.addFirstPath("meshes")')
    assert tree.find_file("cube.obj") == tmp_path / "meshes/cube.obj"


def test_two_scenes_with_modules_of_the_same_name(tmp_path: Path) -> None:
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        loaded(
            tmp_path / name, "import own_parts\nroot.name = own_parts.NAME", files={"own_parts.py": f"NAME = '{name}'"}
        )
    monkey = ModuleType("own_parts")
    sys.modules["own_parts"] = monkey
    try:
        tree = load_tree(tmp_path / "two/scene.py")
        assert sys.modules["own_parts"] is monkey
    finally:
        del sys.modules["own_parts"]
    assert tree.root.getName() == "two"


def test_a_controller_is_told_of_keys_and_steps(tmp_path: Path) -> None:
    create = """
        from own_controller import Own
        root.addObject("CableConstraint", name="cable", value=0.0)
        root.addObject(Own(root))
    """
    tree = loaded(
        tmp_path, create, files={"own_controller.py": CONTROLLER, "own_later.py": "def late(dt): return f'late {dt}'"}
    )
    (own,) = tree.controllers
    assert own is tree.root.Own
    tree.initialise()
    tree.key_pressed("+")
    tree.key_pressed("uparrow")
    tree.key_pressed("down")
    tree.key_pressed("a")
    tree.key_pressed("page_up")
    tree.animate_begin(0.01)
    tree.animate_end(0.01)
    assert own.seen == ["init", "+", chr(19), chr(21), "A", "late 0.01", "end"]
    assert tree.root.cable.value.value.tolist() == [1.0]
    assert tree.root.cable.value.place.file == str(tmp_path / "own_controller.py")


def test_a_controller_that_does_not_listen_is_told_nothing(tmp_path: Path) -> None:
    tree = loaded(
        tmp_path, "from own_controller import Own\nroot.addObject(Own(root))", files={"own_controller.py": CONTROLLER}
    )
    tree.root.Own.listening = False
    tree.key_pressed("+")
    assert tree.root.Own.seen == []


def test_any_event_reaches_a_controller_that_takes_them_all(tmp_path: Path) -> None:
    create = """
        class Own(Sofa.Core.Controller):
            seen = []
            def onEvent(self, event):
                self.seen.append(event["type"])
        root.addObject(Own(name="all"))
    """
    tree = loaded(tmp_path, create, "import Sofa.Core")
    tree.animate_begin(0.01)
    tree.key_released("+")
    assert tree.root.all.seen == ["AnimateBeginEvent", "KeyreleasedEvent"]


def test_controllers_get_events_in_order(tmp_path: Path) -> None:
    create = """
        class Own(Sofa.Core.Controller):
            pass
        child = root.addChild("child")
        child.addObject(Own(name="first"))
        root.addObject(Own(name="second"))
    """
    assert [item.getName() for item in loaded(tmp_path, create, "import Sofa.Core").controllers] == ["first", "second"]


OLDER = """
    import Sofa

    class controller(Sofa.PythonScriptController):
        def initGraph(self, node):
            self.node = node
            self.seen = ["initGraph"]

        def onKeyPressed(self, c):
            cable = self.node.getObject("cable")
            if ord(c) == 19:
                value = cable.findData("value").value[0][0] + self.node.findData("dt").value
                cable.findData("value").value = str(value)
                point = cable.findData("pullPoint").value
                cable.findData("pullPoint").value = " ".join(str(x + 1) for x in point[0])
                rest = self.node.getObject("dofs").rest_position
                moved = "".join(" " + str(rest[i][0] + 1) + " 0 0" for i in range(len(rest)))
                self.node.getObject("dofs").findData("rest_position").value = moved

        def onBeginAnimationStep(self, dt):
            self.seen.append(dt)

        def onEndAnimationStep(self, dt):
            self.seen.append("end")
"""
OLDER_SCENE = """
    root.createObject("CableConstraint", name="cable", pullPoint="1 2 3")
    root.createObject("MechanicalObject", name="dofs", rest_position="1 2 3 4 5 6")
    root.createObject("PythonScriptController", filename="controllers/own.py", classname="controller")
"""


def test_an_older_controller_sees_vectors_as_lists_of_rows(tmp_path: Path) -> None:
    tree = loaded(tmp_path, OLDER_SCENE, files={"controllers/own.py": OLDER})
    (own,) = tree.controllers
    assert own is tree.root.PythonScriptController
    assert own.filename.value == "controllers/own.py"
    tree.initialise()
    tree.key_pressed("up")
    tree.animate_begin(0.5)
    tree.animate_end(0.5)
    assert own.seen == ["initGraph", 0.5, "end"]
    assert tree.root.cable.value.value.tolist() == [0.01]
    assert tree.root.cable.pullPoint.value.tolist() == [2, 3, 4]
    assert tree.root.dofs.rest_position.value.tolist() == [[2, 0, 0], [5, 0, 0]]
    assert np.array_equal(tree.root.dofs.rest_position.take(), [[2, 0, 0], [5, 0, 0]])


def test_provided_values_are_cached_for_an_event(tmp_path: Path) -> None:
    create = """
        class Own(Sofa.Core.Controller):
            def onAnimateBeginEvent(self, event):
                dofs = root.dofs
                self.height = sum(dofs.rest_position[i][1] for i in range(len(dofs.rest_position)))
        root.addObject("MechanicalObject", name="dofs", rest_position=[[0, 0, 0]])
        root.addObject(Own())
    """
    tree = loaded(tmp_path, create, "import Sofa.Core")
    asked: list[float] = []

    def provided() -> np.ndarray:
        asked.append(1.0)
        return np.full((10, 3), sum(asked))

    rest = tree.root.dofs.rest_position
    rest.take()
    rest.provider = provided
    tree.animate_begin(0.01)
    tree.animate_begin(0.01)
    assert len(asked) == 2
    assert tree.root.Own.height == 20
    assert rest[0][0] == 3


def test_an_older_controller_attaches_itself_to_its_node(tmp_path: Path) -> None:
    create = """
        class Own(Sofa.PythonScriptController):
            def __init__(self, node):
                self.listening = True
                self.name = "own"
        Own(root)
    """
    tree = loaded(tmp_path, create, "import Sofa")
    assert tree.controllers == [tree.root.own]


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        ("filename='none.py', classname='controller'", "filename = 'none.py': no such file"),
        ("filename='own.py', classname='Contoller'", "own.py has no PythonScriptController 'Contoller'"),
    ],
)
def test_an_older_controller_that_is_not_there_is_one_line(tmp_path: Path, arguments: str, error: str) -> None:
    with pytest.raises(SceneError, match=rf"scene.py, line 3: .*{error}"):
        loaded(
            tmp_path,
            f"root.createObject('PythonScriptController', {arguments})",
            files={"own.py": "class controller: pass"},
        )


@pytest.mark.parametrize(
    ("create", "error"),
    [
        ("1 / 0", "scene.py, line 3: ZeroDivisionError: division by zero"),
        ("import own_parts\nown_parts.fail()", "own_parts.py, line 2: ValueError: not so"),
        ("root.finger", "scene.py, line 3: AttributeError: node 'root' has no 'finger'"),
        ("root.dt = 'soon'", "scene.py, line 3: data 'dt' of node 'root': 'soon' is not a number"),
        ("import own_missing", "scene.py, line 3: ModuleNotFoundError: No module named 'own_missing'"),
        ("import own_broken", r"own_broken.py, line 2: neither Python 3 nor Python 2: .*; correct the line"),
        ("raise SystemExit(3)", "scene.py, line 3: SystemExit: 3"),
    ],
)
def test_what_a_scene_raises_is_one_line_with_its_place(tmp_path: Path, create: str, error: str) -> None:
    files = {"own_parts.py": "def fail():\n    raise ValueError('not\\nso')", "own_broken.py": "x = 1\ny = = 2\n"}
    with pytest.raises(SceneError, match=error) as raised:
        loaded(tmp_path, create, files=files)
    assert "\n" not in str(raised.value)
    assert raised.value.__cause__ is not None


def test_what_a_controller_raises_is_one_line_with_its_place(tmp_path: Path) -> None:
    create = """
        class Own(Sofa.Core.Controller):
            def onKeypressedEvent(self, event):
                root.cable.value = event["none"]
        root.addObject(Own())
    """
    tree = loaded(tmp_path, create, "import Sofa.Core")
    with pytest.raises(ControllerFailed, match=r"scene.py, line 5: KeyError: 'none'") as raised:
        tree.key_pressed("+")
    assert isinstance(raised.value.__cause__, KeyError)


@pytest.mark.parametrize("text", ["", "createScene = 3"])
def test_a_scene_without_create_scene_is_an_error(tmp_path: Path, text: str) -> None:
    written(tmp_path, {"scene.py": text})
    with pytest.raises(SceneError, match=r"scene.py: has no function createScene\(root\)"):
        load_tree(tmp_path / "scene.py")


def test_a_file_or_folder_that_is_not_there_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"none.py: no such file"):
        load_tree(tmp_path / "none.py")
    written(tmp_path, {"scene.py": ""})
    with pytest.raises(SceneError, match="none: no such folder"):
        load_tree(tmp_path / "scene.py", [tmp_path / "none"])


LIBRARY = """
    import Sofa.Core

    def Cube(node, name="Cube"):
        cube = node.addChild(name)
        cube.addObject("EulerImplicitSolver")
        cube.addObject("CGLinearSolver")
        return cube

    class ElasticMaterialObject(Sofa.Prefab):
        prefabParameters = [{"name": "volumeMeshFileName", "type": "string", "help": "", "default": ""}]
        def init(self):
            self.addObject("MeshVTKLoader", filename=self.volumeMeshFileName.value)
"""


@pytest.fixture
def library(tmp_path: Path) -> Path:
    """A folder with a library that is called like one of SOFA's."""
    folder = tmp_path / "library/stlib3"
    folder.mkdir(parents=True)
    written(folder, {"__init__.py": "", "parts.py": LIBRARY})
    return folder.parent


@pytest.mark.parametrize("name", ["stlib3", "splib3", "stlib", "softrobots.actuators"])
def test_missing_library_error_names_its_source(tmp_path: Path, name: str) -> None:
    with pytest.raises(SceneError, match=rf"scene.py, line 3: there is no '{name.split('.')[0]}.*--python-path DIR$"):
        loaded(tmp_path, f"import {name}")


def test_a_library_of_another_version_is_said_to_be_one(tmp_path: Path, library: Path) -> None:
    written(tmp_path, {"scene.py": "import stlib3.primitives\ndef createScene(root): pass\n"})
    with pytest.raises(
        SceneError, match=r"scene.py, line 1: there is no 'stlib3.primitives' in the stlib3 that was found"
    ):
        load_tree(tmp_path / "scene.py", [library])


@pytest.mark.parametrize("way", ["python_path", "PYTHONPATH"])
def test_a_library_runs_on_our_modules(
    tmp_path: Path, library: Path, way: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    written(tmp_path, {"scene.py": "from stlib3.parts import Cube\ndef createScene(root):\n    Cube(root)\n"})
    with monkeypatch.context() as changed:
        if way == "PYTHONPATH":
            changed.setattr(sys, "path", [*sys.path, str(library)])
        tree = load_tree(tmp_path / "scene.py", [library] if way == "python_path" else [])
    assert tree.root.Cube.CGLinearSolver.place == (str(tmp_path / "scene.py"), 3)
    assert not list(library.rglob("__pycache__"))


def test_older_library_names_attach_prefabs(tmp_path: Path, library: Path) -> None:
    create = """
        from stlib.parts import Cube, ElasticMaterialObject
        Cube(root).Solver.threshold = 1e-6
        ElasticMaterialObject(attachedTo=root, volumeMeshFileName="one.vtk", name="one")
        ElasticMaterialObject(root, "two.vtk", "two")
    """
    written(tmp_path, {"scene.py": "def createScene(root):\n" + dedent(create).replace("\n", "\n    ")})
    tree = load_tree(tmp_path / "scene.py", [library])
    assert tree.root.Cube.Solver.getClassName() == "CGLinearSolver"
    assert tree.root.Cube.hasObject("UncoupledConstraintCorrection")
    assert tree.root.one.MeshVTKLoader.filename.value == "one.vtk"
    assert tree.root.two.MeshVTKLoader.filename.value == "two.vtk"


def test_python_is_as_before_when_a_scene_changes_it_and_fails(tmp_path: Path) -> None:
    folder = Path.cwd()
    with pytest.raises(SceneError):
        loaded(
            tmp_path, "import os, sys\nos.chdir('/')\nsys.path.append('/own')\nsys.meta_path.clear()\nraise ValueError"
        )
    assert Path.cwd() == folder


def test_added_path_is_kept_for_controllers(tmp_path: Path) -> None:
    create = """
        import os, sys
        sys.path.append(os.path.join(os.getcwd(), "deeper"))
        class Own(Sofa.Core.Controller):
            def onKeypressedEvent(self, event):
                import own_deep
                self.name = own_deep.NAME
        root.addObject(Own())
    """
    (tmp_path / "deeper").mkdir()
    written(tmp_path / "deeper", {"own_deep.py": "import Sofa.Core\nNAME = 'deep'"})
    tree = loaded(tmp_path, create, "import Sofa.Core")
    tree.key_pressed("+")
    tree.key_pressed("+")
    assert tree.controllers == [tree.root.deep]
    assert not list(tmp_path.rglob("__pycache__"))


def test_a_module_is_the_same_every_time_a_controller_imports_it(tmp_path: Path) -> None:
    create = """
        class Own(Sofa.Core.Controller):
            def onKeypressedEvent(self, event):
                import own_state
                own_state.COUNT.append(event["isCtrlPressed"])
                self.count = len(own_state.COUNT)
        root.addObject(Own())
    """
    tree = loaded(tmp_path, create, "import Sofa.Core", files={"own_state.py": "COUNT = []"})
    for _ in range(3):
        tree.key_pressed("+")
    assert tree.root.Own.count == 3
    assert tree.root.Own.name.value == "Own"


def test_a_controller_of_sofas_own_class_has_sofas_name(tmp_path: Path) -> None:
    tree = loaded(tmp_path, "root.addObject(Sofa.Core.Controller())", "import Sofa.Core")
    (controller,) = tree.controllers
    assert controller is tree.root.Controller
    assert (controller.type_name, controller.name.value) == ("Controller", "Controller")


def test_an_error_in_a_library_names_the_line_of_the_scene_too(tmp_path: Path, library: Path) -> None:
    written(tmp_path, {"scene.py": "from stlib3.parts import Cube\ndef createScene(root):\n    Cube(None)\n"})
    with pytest.raises(
        SceneError, match=r"scene.py, line 3, in .*/stlib3/parts.py, line 5: AttributeError: 'NoneType'"
    ):
        load_tree(tmp_path / "scene.py", [library])


def test_a_library_in_python_2_is_converted_wherever_it_is_found(
    tmp_path: Path, library: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written(library / "stlib3", {"old.py": "print 'a'\nX = 7 / 2\n"})
    with monkeypatch.context() as changed:
        changed.setattr(sys, "path", [*sys.path, str(library)])
        tree = loaded(tmp_path, "from stlib3.old import X\nroot.dt = X")
    assert tree.root.getDt() == 3


def test_a_program_that_is_no_scene_is_not_started(tmp_path: Path) -> None:
    """Some programs are named by mistake: what they would do is not done."""
    written(tmp_path, {"program.py": "from pathlib import Path\nPath('started').touch()\n"})
    with pytest.raises(SceneError, match=r"program\.py: has no function createScene\(root\)"):
        load_tree(tmp_path / "program.py")
    assert not (tmp_path / "started").exists()


def test_components_get_distinct_names(tmp_path: Path) -> None:
    """20 000 of them take no time; with a search of all names for each it would be minutes."""
    tree = loaded(
        tmp_path, "for i in range(20000): root.addObject('VisualStyle')\nroot.addObject('VisualStyle', name='a')"
    )
    names = [component.getName() for component in tree.root.objects]
    assert names[:3] == ["VisualStyle", "VisualStyle1", "VisualStyle2"]
    assert names[-2:] == ["VisualStyle19999", "a"]
    tree.root.a.setName("Other")
    tree.root.removeObject("VisualStyle1")
    assert [tree.root.addObject(kind).getName() for kind in ("VisualStyle", "Other")] == ["VisualStyle1", "Other1"]


# Scenes in Python 2 run as they did there, and errors name their lines.


def values(folder: Path, text: str) -> dict[str, object]:
    """The global variables of a module in Python 2 that a scene imports."""
    create = "import own\nroot.found = {name: getattr(own, name) for name in dir(own)}"
    return dict(loaded(folder, create, files={"own.py": text}).root.found)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("print 'a',\nx = [i for i in xrange(3)]", [0, 1, 2]),
        ("x = list(xrange(2))", [0, 1]),
        ("x = unicode('a') + u'b'", "ab"),
        ("try:\n    raise ValueError, 'a'\nexcept ValueError, e:\n    x = str(e)", "a"),
        ("print 'a'\nx = sorted({'a': 1}.iteritems())", [("a", 1)]),
        ("x = {'a': 1}.has_key('a') and long(3)", 3),
        ("x = reduce(lambda a, b: a + b, [1, 2, 3])", 6),
        ("def f((a, b)):\n    return a + b\nx = f((1, 2))", 3),
        ("x = 0777", 511),
        ("print 'a'\nx = map(str, [1, 2])", ["1", "2"]),
        ("x = 3 <> 4", True),
        ("x = `3`", "3"),
        ("import string\nx = string.join(['a', 'b'], '-')", "a-b"),
        ("import string\nx = string.split('a b'), string.digits[:2]", (["a", "b"], "01")),
        ("from string import join, digits\nx = join(['a', digits[0]])", "a 0"),
        ("import string as s\nprint 'a'\nx = s.digits[0]", "0"),
        ("import sys\nprint >> sys.stderr, 'a'\nx = 7 / 2", 3),
        ("f = file(__file__)\nx = f.readline()\nf.close()", "f = file(__file__)\n"),
        ("def ask():\n    return raw_input('? ')\nx = 7 / 2", 3),
    ],
)
def test_python_2_is_converted(tmp_path: Path, text: str, value: object) -> None:
    assert values(tmp_path, text)["x"] == value


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("print 'a'\nx = 7 / 2", 3),
        ("print 'a'\nx = -7 / 2", -4),
        ("print 'a'\nx = 7 / 2.0", 3.5),
        ("print 'a'\nx = 7\nx /= 2", 3),
        ("print 'a'\nx = [7]\nx[0] /= 2\nx = x[0]", 3),
        ("from __future__ import division\nprint 'a'\nx = 7 / 2", 3.5),
        ("print('a')\nx = 7 / 2", 3.5),
        ("def make(node):\n    node.createObject('A')\nx = 7 / 2", 3),
        ("import Sofa\nclass C(Sofa.PythonScriptController): pass\nx = 7 / 2", 3),
        ("from functools import *\nx = reduce(max, [1, 7]) / 2", 3.5),
        ("try:\n    unicode\nexcept NameError:\n    pass\nx = 7 / 2", 3.5),
        ("import sys\nif sys.version_info[0] == 2:\n    input = raw_input\nx = 7 / 2", 3.5),
        ("import string\ndef join(words): return string.Template(words)\nx = 7 / 2", 3.5),
        ("def make(node):\n    node.createObject(f'A{1}')\nx = 7 / 2", 3.5),
        ("def make(node: object):\n    node.createObject('A')\nx = 7 / 2", 3.5),
        ("x = 7 / 2\nxrange = range", 3.5),
    ],
)
def test_python2_divides_integers(tmp_path: Path, text: str, value: object) -> None:
    found = values(tmp_path, text)["x"]
    assert found == value
    assert type(found) is type(value)


def test_a_tab_goes_to_the_next_multiple_of_eight(tmp_path: Path) -> None:
    text = "x = 3\nif x:\n      if x > 5:\n\t  x = 0\n      x = x + 1\ny = '''a\n\tb'''\n"
    found = values(tmp_path, text)
    assert found["x"] == 4
    assert found["y"] == "a\n\tb"


def test_a_package_of_python_2_imports_what_is_beside_it(tmp_path: Path) -> None:
    (tmp_path / "controllers").mkdir()
    (tmp_path / "controllers/__init__.py").write_text("from own_other import X\n")
    (tmp_path / "controllers/own_other.py").write_text("X = 3\n")
    tree = loaded(tmp_path, "from controllers import X\nroot.dt = X")
    assert tree.root.getDt() == 3


@pytest.mark.parametrize("beside", ["__init__.py", "finger/__init__.py"])
def test_a_package_beside_a_scene_does_not_make_it_python_2(tmp_path: Path, beside: str) -> None:
    """A scene imports what is beside it, also from a package below; dt = 1 / 100 is no 0."""
    files = {"finger/own.py": "X = 1 / 100\n", "material.py": "Y = 7 / 2\n", beside: ""}
    create = "from finger.own import X\nfrom material import Y\nroot.dt = X\nroot.found = Y"
    tree = loaded(tmp_path, create, files=files)
    assert (tree.root.getDt(), tree.root.found) == (0.01, 3.5)
    assert tree.converted == []


def test_python2_scene_in_a_package_imports_neighbours(tmp_path: Path) -> None:
    files = {"__init__.py": "", "material.py": "Y = 7 / 2\n"}
    tree = loaded(tmp_path, "print 'a'\nfrom material import Y\nroot.found = Y, 7 / 2", files=files)
    assert tree.root.found == (3.5, 3)  # each file for itself: nothing in the other one is Python 2
    (line,) = tree.converted
    assert line.startswith(f"{tmp_path / 'scene.py'} is in Python 2 (line 3: ")


def test_a_script_of_a_controller_is_no_module_of_a_package(tmp_path: Path) -> None:
    script = "import Sofa\nfrom other import X\nclass C(Sofa.PythonScriptController):\n    value = X\n"
    files = {"own/__init__.py": "", "own/other.py": "X = 3\n", "own/script.py": script}
    create = "root.createObject('PythonScriptController', filename='own/script.py', classname='C')"
    assert loaded(tmp_path, create, files=files).controllers[0].value == 3


def test_python_3_stays_as_it_is(tmp_path: Path) -> None:
    text = "import math\n\ndef f(xrange):\n    return [math.pi / x for x in xrange]\n\nprint(f([2]), 1 / 2)\n"
    written(tmp_path, {"own.py": text})
    assert not compiled(tmp_path / "own.py").python2
    assert not compiled(tmp_path / "own.py").older


@pytest.mark.parametrize(
    "text",
    ["print 'a'", "class A(Sofa.PythonScriptController): pass", "root.createObject('A')", "x = xrange(3)"],
)
def test_what_only_the_older_generation_has_is_known(tmp_path: Path, text: str) -> None:
    written(tmp_path, {"own.py": text})
    assert compiled(tmp_path / "own.py").older


def test_a_scene_with_print_statements_loads(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "scene.pyscn").write_text("def createScene(root):\n\tprint 'hello', 1\n\troot.createChild('finger')\n")
    assert load_tree(tmp_path / "scene.pyscn").root.finger.place.line == 3
    assert capsys.readouterr().out == "hello 1\n"


def test_an_error_in_python_2_names_its_line(tmp_path: Path) -> None:
    text = (
        "import Sofa\n\ndef createScene(root):\n    print 'a'\n    x = reduce(max, [1])\n    raise ValueError, 'no'\n"
    )
    (tmp_path / "scene.py").write_text(text)
    with pytest.raises(SceneError, match=r"scene.py, line 6: ValueError: no"):
        load_tree(tmp_path / "scene.py")


def test_what_is_in_neither_python_is_refused_with_its_line(tmp_path: Path) -> None:
    (tmp_path / "scene.py").write_text("print 'a'\nx = 3 +\ndef createScene(root): pass\n")
    with pytest.raises(SceneError, match=r"scene.py, line [12]: neither Python 3 nor Python 2: .*; correct the line"):
        load_tree(tmp_path / "scene.py")


def test_a_scene_in_another_encoding(tmp_path: Path) -> None:
    text = "# -*- coding: latin-1 -*-\nprint 'a'\nx = u'é'\n"
    (tmp_path / "own.py").write_bytes(text.encode("latin-1"))
    tree = loaded(tmp_path, "import own\nroot.found = own.x")
    assert tree.root.found == "é"
