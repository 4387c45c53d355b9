"""Scenes in Python 2 run as they did there, and errors name their lines."""

from pathlib import Path

import pytest
from scenes_of_sofa import loaded, written

from taichisoft.errors import SceneError
from taichisoft_sofa.loading import load_tree
from taichisoft_sofa.tree.scene_modules import compiled


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
def test_the_quotient_of_integers_is_an_integer_in_python_2_alone(tmp_path: Path, text: str, value: object) -> None:
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


def test_a_scene_in_python_2_imports_what_is_beside_it_though_its_folder_is_a_package(tmp_path: Path) -> None:
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
