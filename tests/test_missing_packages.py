"""Without optional packages the engine runs, and what needs one of them says in one line what installs it."""

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from conftest import PATIENCE

ROOT = Path(__file__).resolve().parents[1]
TINY_GRIPPER = ROOT / "taichisoft" / "tiny_gripper" / "scene.toml"
LEFT_OUT = {
    "": {"gmsh", "imageio_ffmpeg", "matplotlib", "mpl_toolkits", "open3d", "PIL"},
    "arm": {"yourdfpy"},
    "gym": {"gymnasium"},
    "notebook": {"ipykernel", "ipywidgets"},
    "site": {"furo", "myst_parser", "sphinx", "sphinx_copybutton"},
    "sofa": {"fissix"},
    "studies": {"cmaes", "distributed", "optuna", "pandas", "pyarrow"},
    "web": {"viser"},
}
"""Import names of the packages that are not there, by the extra that brings them."""
COMMANDS = {
    "run cube.toml --outputs recording,csv,metrics -o run --duration 0.02": None,
    "run cube.toml --web": "web",
    "view run/recording.h5": "web",
    "run pick-and-place": "arm",
    "study sweep gripper --vary contact.friction=0.2,0.3 -o out": "studies",
    "study optimise finger-tip-force -o out": "studies",
    "study report out": "studies",
    "sofa convert old.py -o old.toml": "sofa",
    "run old.py": "sofa",
    "mesh tutorial -o out": "",
    "mesh info pad.msh -o pad.png": "",
    "run meshed.toml": "",
    "run cube.toml --image -o out": "",
    "run cube.toml --video grasp.gif -o out": "",
    "render run/recording.h5": "",
    "recording plot run/recording.h5": "",
    "materials plot": "",
    "recording report run/recording.h5 -o page.html": None,
    "materials": None,
    "plugins": None,
}
"""Command lines by the extra without which each ends: None where it needs none, "" for a package of the whole."""
RUNNER = """
import contextlib, io, json, sys
from taichisoft.command_line import main

answers = {}
for command in json.load(sys.stdin):
    sys.argv = ["taichisoft", *command.split()]
    said = io.StringIO()
    try:
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(said):
            main()
    except SystemExit as end:
        answers[command] = [end.code, said.getvalue()]
json.dump(answers, sys.stdout)
"""
CUBE = """
controller = { name = "scripted", settings = { script = "rest" } }
[rigid_bodies.cube]
box = [10.0, 10.0, 10.0]
mass = 0.001
"""
OLD_SCENE = "def createScene(root):\n    print 'a scene in Python 2'\n"


@pytest.fixture(scope="module")
def python(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The interpreter of an environment that has all packages of this one, by links, but those left out."""
    folder = tmp_path_factory.mktemp("engine").resolve()
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", folder], check=True, timeout=PATIENCE)
    (site_packages,) = folder.glob("lib/python*/site-packages")
    names = set.union(*LEFT_OUT.values())
    for place in filter(lambda path: Path(path).name.endswith("-packages"), sys.path):
        for entry in Path(place).iterdir():
            link = site_packages / entry.name
            if entry.name.partition(".")[0] not in names and entry.suffix != ".pth" and not link.exists():
                link.symlink_to(entry)
    roots = [ROOT, *(ROOT / name for name in ("controllers", "meshing", "plugins"))]
    (site_packages / "checkout.pth").write_text("\n".join(map(str, roots)))
    return folder / "bin/python"


def run(python: Path, code: str, folder: Path, given: str = "") -> str:
    kept = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    command = [str(python), "-c", code]
    done = subprocess.run(
        command, cwd=folder, env=kept, input=given, capture_output=True, text=True, check=False, timeout=PATIENCE
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def answers(python: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[int | None, list[str]]]:
    """Exit status and lines of standard error of every command."""
    folder = tmp_path_factory.mktemp("commands")
    (folder / "old.py").write_text(OLD_SCENE)
    (folder / "cube.toml").write_text(CUBE)
    pads = TINY_GRIPPER.read_text(encoding="utf-8")
    (folder / "meshed.toml").write_text(
        pads.replace('"pad.msh"', '{ file = "tutorial", set = { mesh = { largest = 17.3 } } }')
    )
    shutil.copy(TINY_GRIPPER.with_name("pad.msh"), folder)
    answered = json.loads(run(python, RUNNER, folder, json.dumps(list(COMMANDS))))
    assert "no plots: a plot: needs matplotlib" in (folder / "page.html").read_text(encoding="utf-8")
    return {command: (status, said.splitlines()) for command, (status, said) in answered.items()}


@pytest.mark.parametrize("command", COMMANDS)
def test_command_needs_its_own_packages_alone(answers: dict[str, tuple[int | None, list[str]]], command: str) -> None:
    status, lines = answers[command]
    extra = COMMANDS[command]
    if extra is None:
        assert status == 0, lines
        return
    assert status == 2
    (line,) = lines
    assert re.match(r"taichisoft: .*: needs .*, which (is|are) not installed: ", line)
    named = set(re.findall(r"\w+", line.partition(": needs ")[2].partition(",")[0])) - {"and"}
    assert named <= LEFT_OUT[extra]
    assert line.endswith(f": pip install 'taichisoft[{extra}]'" if extra else ": pip install taichisoft")


def test_environments_name_their_extra_on_import(python: Path, tmp_path: Path) -> None:
    code = "try: import taichisoft_gym\nexcept ImportError as error: print(error)"
    said = run(python, code, tmp_path)
    assert said == "taichisoft_gym: needs gymnasium, which is not installed: pip install 'taichisoft[gym]'\n"


def test_engine_alone_is_installed_as_documented() -> None:
    """By the names of distributions: what the command of docs/installing.md names is all but what is left out here."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    distributions = {"PIL": "pillow", "imageio_ffmpeg": "imageio-ffmpeg", "open3d": "open3d"}
    left_out = {distributions.get(name, name) for name in LEFT_OUT[""]} | {"open3d-cpu"}
    needed = [one for one in project["dependencies"] if re.split("[<>=;]", one)[0] not in left_out]
    page = (ROOT / "docs" / "installing.md").read_text(encoding="utf-8")
    (command,) = re.findall(r"^pip install (.*)\npip install --no-deps taichisoft$", page, re.MULTILINE)
    assert shlex.split(command) == needed


def test_packages_left_out_are_those_of_extras() -> None:
    """So that a package which joins an extra is left out here as well."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    for extra, required in project["optional-dependencies"].items():
        if extra not in ("peers", "test"):
            assert {re.split("[<>=]", one)[0].replace("-", "_") for one in required} == LEFT_OUT[extra]
