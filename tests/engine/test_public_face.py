"""What `import taichisoft` shows, and what it and `taichisoft --help` must not wait for."""

import ast
import os
import rlcompleter
import subprocess
import sys
from pathlib import Path

import taichisoft

HEAVY = "taichi", "open3d", "gmsh", "h5py", "meshio", "matplotlib", "trimesh", "viser"
PLUGIN = """
from taichisoft import Control, Controller, Geometry, KeyEvent, Observation, Output, hookimpl
from taichisoft import RunOption, Slider, VolumeMesh, read_volume_mesh

class Still(Controller):
    def control(self, observation):
        return Control()

class Deaf(Output):
    def record(self, state, report): ...

@hookimpl
def taichisoft_controllers():
    return {"still": Still}
"""


def test_names_that_load_later_are_shown_at_once() -> None:
    code = "import sys, taichisoft; print(*dir(taichisoft)); print('taichi' in sys.modules, 'numpy' in sys.modules)"
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.splitlines()
    assert shown[0].split() == dir(taichisoft)
    assert {"Simulation", "Controller", "Output", "load_scene", "run", "errors"} <= set(shown[0].split())
    assert shown[1] == "False False"


def test_completion_shows_them_and_none_of_inner_ones() -> None:
    import taichisoft.running.hooks

    completer = rlcompleter.Completer({"taichisoft": taichisoft})
    shown = [completer.complete("taichisoft.", number) or "" for number in range(100)]
    names = {name.removeprefix("taichisoft.").partition("(")[0] for name in shown if name}
    assert names == {name for name in dir(taichisoft) if not name.startswith("_")}


def test_public_names_are_there_for_type_checkers() -> None:
    for name in taichisoft.__all__:
        assert getattr(taichisoft, name) is not None
    declared = {
        (node.module, alias.name)
        for node in ast.walk(ast.parse(Path(taichisoft.__file__).read_text(encoding="utf-8")))
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("taichisoft.")
        for alias in node.names
    }
    assert declared == {(f"taichisoft.{module}", name) for name, module in taichisoft._MODULES.items()}


def test_help_waits_for_no_heavy_package_with_plug_in(tmp_path: Path) -> None:
    """Without one it is tests/test_quick_start.py."""
    (tmp_path / "still.py").write_text(PLUGIN)
    code = (
        "import sys\nfrom taichisoft.command_line import main\n"
        "try:\n    main()\n"
        f"finally:\n    print('heavy:', *[name for name in {HEAVY!r} if name in sys.modules])"
    )
    shown = subprocess.run(
        [sys.executable, "-c", code, "run", "--help", "--plugin", "still.py"],
        cwd=tmp_path,
        env={**os.environ, "TERM": "dumb"},
        capture_output=True,
        text=True,
    )
    assert (shown.returncode, shown.stderr) == (0, "")
    assert "Usage: " in shown.stdout
    assert shown.stdout.splitlines()[-1] == "heavy:"
