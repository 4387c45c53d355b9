"""Mistakes around SOFA's scenes: wrong values of data, files taken for the other Python, damaged caches of meshes."""

import os
import random
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from damage import DAMAGES

WRONG = (
    "float('nan')", "float('inf')", "-3.0", "None", "''", "[]", "[1, 2, 3]", "'x'", "True", "10**400", "{}", "-1e300",
)  # fmt: skip
DATA = {
    "EulerImplicitSolver": ["rayleighMass", "rayleighStiffness", "firstOrder"],
    "UniformMass": ["totalMass", "vertexMass"],
    "TetrahedronFEMForceField": ["youngModulus", "poissonRatio", "method"],
    "RestShapeSpringsForceField": ["stiffness", "points"],
    "MechanicalObject": ["position", "velocity", "scale3d", "rotation"],
    "BoxROI": ["box"],
}
SCENE = """
POINTS = [[0, 0, 0], [10, 0, 0], [0, 10, 0], [0, 0, 10]]
VALUES = {{"EulerImplicitSolver": {{}}, "MeshTopology": {{"position": POINTS, "tetrahedra": [[0, 1, 2, 3]]}},
    "MechanicalObject": {{"position": POINTS}}, "UniformMass": {{"totalMass": 0.001}},
    "TetrahedronFEMForceField": {{"youngModulus": 100, "poissonRatio": 0.3}},
    "BoxROI": {{"box": [-1, -1, -1, 11, 11, 1]}}, "RestShapeSpringsForceField": {{"points": [0], "stiffness": 1e6}}}}
{change}
def createScene(root):
    root.addObject("FreeMotionAnimationLoop")
    body = root.addChild("body")
    for kind, data in VALUES.items():
        body.addObject(kind, **data)
    body.addObject("LinearSolverConstraintCorrection")
"""
TEXTS = [  # a line, and the quotient 7 / 2 in its file
    ("print 'a'", "3"),
    ("print >> sys.stderr, 'a'", "3"),
    ("x = list(xrange(3))", "3"),
    ("def f(node): node.createObject('A')", "3"),
    ("import string; x = string.join(['a'])", "3"),
    ("def f(): return raw_input()", "3"),
    ("f = lambda: file('a')", "3"),
    ("from functools import *; x = reduce(max, [1, 2])", "3.5"),
    ("def f(node: object): node.createObject('A')", "3.5"),
    ("import beside", "3.5"),
    ("try: unicode\nexcept NameError: pass", "3.5"),
    ("x = f'{1}'", "3.5"),
]


def wrong_values(tries: int) -> list[str]:
    """Scenes with a wrong value: each loads with SOFA's default or the value as it stands, or ends in one line."""
    failures = []
    with TemporaryDirectory() as folder:
        for number in range(tries):
            dice = random.Random(f"SOFA value {number}")
            kind = dice.choice(list(DATA))
            name, value = dice.choice(DATA[kind]), dice.choice(WRONG)
            change = f"VALUES[{kind!r}][{name!r}] = {value}"
            code, shown, errors = _run(Path(folder), SCENE.format(change=change))
            bad = code not in (0, 1, 2) or "Traceback" in errors or (code == 2 and len(errors.splitlines()) != 1)
            silent = code == 0 and value in ("float('nan')", "-1e300", "[1, 2, 3]") and name != "method"
            if bad or (silent and kind in ("UniformMass", "TetrahedronFEMForceField")):
                failures.append(f"{number}: {kind}.{name} = {value}: exit code {code}: {(errors or shown)[-200:]!r}")
    return failures


def mistaken_texts(tries: int) -> list[str]:
    """Files whose Python, 2 or 3, decides over a quotient, in folders that are packages or not."""
    failures = []
    with TemporaryDirectory() as made:
        for number in range(tries):
            dice = random.Random(f"SOFA text {number}")
            line, quotient = dice.choice(TEXTS)
            folder = Path(made) / str(number)
            folder.mkdir()
            (folder / "beside.py").write_text("")
            if dice.random() < 0.5:
                (folder / "__init__.py").write_text("")
            text = f"import sys\n{line}\nQUOTIENT = 7 / 2\ndef createScene(root):\n    root.dt = QUOTIENT\n"
            (folder / "scene.py").write_text(text)
            show = "import sys; from taichisoft_sofa.loading import load_tree; t = load_tree(sys.argv[1]); "
            found = _python(["-c", f"{show}print(float(t.root.dt), len(t.converted))", str(folder / "scene.py")])
            if found.stdout.splitlines()[-1:] != [f"{float(quotient)} {int(quotient == '3')}"]:
                failures.append(f"{number}: {line!r}: {found.stdout[-100:]!r} {found.stderr[-200:]!r}")
    return failures


def damaged_caches(tries: int) -> list[str]:
    """A kept mesh is damaged or removed: the next run makes the same mesh again."""
    failures = []
    with TemporaryDirectory() as made:
        folder = Path(made)
        _run(folder, SCENE.format(change=""))
        (kept,) = (folder / "cache").rglob("*.msh")
        whole = kept.read_bytes()
        for number in range(tries):
            dice = random.Random(f"SOFA cache {number}")
            damage = dice.choice([*DAMAGES, None])
            kept.unlink() if damage is None else kept.write_bytes(damage(whole, dice))
            code, shown, errors = _run(folder, SCENE.format(change=""))
            if code != 0 or kept.read_bytes() != whole or "written again" not in shown + errors:
                failures.append(f"{number}: exit code {code}: {(errors or shown)[-200:]!r}")
    return failures


def _run(folder: Path, text: str) -> tuple[int, str, str]:
    """Run a scene for one step as a user does: exit code, output, errors."""
    (folder / "scene.py").write_text(text)
    arguments = ["run", str(folder / "scene.py"), "--duration", "0.01", "--outputs", "", "-o", str(folder / "out")]
    found = _python(["-m", "taichisoft", *arguments], folder / "cache")
    return found.returncode, found.stdout, found.stderr


def _python(arguments: list[str], cache: Path | None = None) -> "subprocess.CompletedProcess[str]":
    kept = {"TAICHISOFT_CACHE": str(cache)} if cache else {}
    environment = {**os.environ, **kept, "COLUMNS": "1000"}
    return subprocess.run([sys.executable, *arguments], capture_output=True, text=True, env=environment, check=False)


@pytest.mark.parametrize(
    "attempt", [wrong_values, mistaken_texts, damaged_caches], ids=lambda attempt: attempt.__name__
)
def test_random_mistakes_in_sofa_scenes(attempt: Callable[[int], list[str]]) -> None:
    assert attempt(2) == []
