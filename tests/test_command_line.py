"""The command `taichisoft` as a user meets it: exit codes, one line for every error, what a run leaves behind."""

import csv
import io
import json
import os
import signal
import subprocess
import sys
import time
import warnings
from pathlib import Path

import pytest
import rich
import trimesh
from conftest import PATIENCE, Command
from rich.console import Console
from typer.testing import CliRunner

import taichisoft
from taichisoft import load_scene
from taichisoft.base import plain
from taichisoft.scene import data_folder
from taichisoft_benchmarks.__main__ import bench
from taichisoft_outputs import material_files
from taichisoft_outputs.materials_command import materials
from taichisoft_studies.mesh_variants import summary_table
from taichisoft_studies.study_commands import compare

SCENE = """
[time]
duration = 0.03
[controller]
name = "scripted"
settings = { script = "rest" }
[soft_bodies.finger]
mesh = "tutorial-coarse"
element = "linear"
mass = 0.04
young_modulus = 500.0
poisson_ratio = 0.3
anchors = [{ group = "base" }]
regions = [{ box = [[-100.0, 22.5, -8.0], [-19.0, 28.0, 8.0]], young_modulus = 1500.0 }]
cavities.cavity.group = "cavity"
[rigid_bodies.cube]
box = [10.0, 10.0, 10.0]
mass = 0.001
position = [-60.0, -60.0, 0.0]
"""
SHIPPED = sorted(path.stem for path in (data_folder() / "scenes").glob("*.toml"))


@pytest.fixture
def command(command: Command, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Command:
    """Runs the command in a folder of its own with a scene."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.toml").write_text(SCENE)
    return command


def refusal(command: Command, *arguments: str) -> str:
    """The one line with which a command fails; it must not leave results behind."""
    code, _, errors = command("run", *arguments)
    (line,) = errors.splitlines()
    assert code == 2
    assert line.startswith("taichisoft: ")
    assert not Path("out").exists()
    return line.removeprefix("taichisoft: ")


def outcome_and_steps(recording: Path) -> tuple[str, int]:
    """How the run ended and how many steps it recorded."""
    import h5py

    with h5py.File(recording) as file:
        return file.attrs["outcome"].decode(), len(file["steps/time"]) - 1


def test_geometry_is_meshed_on_first_use(command: Command, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("TAICHISOFT_CACHE", str(tmp_path / "cache"))
    finger = data_folder() / "fingers" / "tutorial.toml"
    arguments = ("run", "scene.toml", "--set", 'soft_bodies.finger.mesh={file = "tutorial.toml", size = 14.0}')
    code, output, errors = command(*arguments)
    assert code == 0, errors
    assert f"meshing {finger}, size 14.0" in output
    assert f"meshed {finger}, size 14.0: " in output
    code, output, errors = command(*arguments)
    assert code == 0, errors
    assert "meshing" not in output
    assert f"mesh of {finger}, size 14.0: " in output
    code, _, errors = command(*arguments, "--set", "soft_bodies.finger.mesh.set.body.width=3.0")
    assert code == 2
    assert errors.startswith(f"taichisoft: scene.toml: soft_bodies.finger.mesh: {finger}: channel.width = 15: must be")


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_scene_runs_and_leaves_what_it_resolved_to(command: Command, name: str, tmp_path: Path) -> None:
    """Three steps are too few to lift anything: a scene with a goal says so, with exit code 1."""
    scene = load_scene(name)
    code, output, errors = command("run", name, "--duration", "0.03")
    folder = tmp_path / "out" / name
    assert code == (0 if scene.goal is None else 1), errors
    assert f"results in {Path('out') / name}" in output
    assert outcome_and_steps(folder / "recording.h5") == ("completed", 3)
    assert json.loads((folder / "metrics.json").read_text())["steps"] == 3
    assert load_scene(folder / "scene.toml") == scene


def test_overrides_are_in_resolved_scene(command: Command, tmp_path: Path) -> None:
    assert command("run", "scene.toml", "--set", "contact.friction=0.25", "--output", "a/new/folder")[0] == 0
    assert load_scene(tmp_path / "a/new/folder/scene.toml").contact.friction == 0.25


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("contact.friction", "--set contact.friction: must look like contact.friction=0.3"),
        ("contact.frction=1", "contact.frction: unknown key; did you mean 'friction'?"),
        ("time.step=-1", "time.step = -1: input should be greater than 0"),
        ("soft_bodies.finger.mesh='fingr.msh'", "soft_bodies.finger.mesh: fingr.msh: no such file"),
        ("soft_bodies.finger.mesh='empty.msh'", "empty.msh: is empty"),
        ("soft_bodies.finger.mesh='ball.stl'", "ball.stl: '.stl' is not a kind of volume mesh file; valid: .msh"),
        ("soft_bodies.finger.cavities.cavity={surface='open.stl'}", "open.stl: is not closed: 3 edges"),
        ("soft_bodies.finger.cavities.cavity={surface='far.stl'}", "far.stl: vertex 0 at [500."),
        ("soft_bodies.finger.cavities.cavity={surface='empty.stl'}", "empty.stl: is empty"),
        (
            "soft_bodies.finger.cavities.cavity.group='cav'",
            "scene.toml: soft_bodies.finger.cavities.cavity.group = 'cav'",
        ),
        ("soft_bodies.finger.anchors.0.group='bas'", "anchors.0.group = 'bas': "),
        (
            "soft_bodies.finger.anchors.0={box=[[9.0,0.0,0.0],[10.0,1.0,1.0]]}",
            "anchors.0.box = [[9.0, 0.0, 0.0], [10.0, 1.0, 1.0]]: selects no node",
        ),
        ("soft_bodies.finger.regions.0.box=[[9.0,0.0,0.0],[10.0,1.0,1.0]]", "regions.0.box = [[9.0, 0.0, 0.0]"),
        ("rigid_bodies.cube.position=[-60.0,10.0,0.0]", "scene.toml: bodies 'finger' and 'cube' overlap at the start"),
        ("controller.name='scriptd'", "no controller is called 'scriptd'; there are: "),
        ("controller.settings.scrpt='rest'", "controller.settings.scrpt: unknown key; did you mean 'script'?"),
        ("controller.settings={}", "scene.toml: controller.settings.script: this key is missing"),
        (
            "controller.settings.pressure='high'",
            "controller.settings.pressure = 'high': input should be a valid number",
        ),
        (
            "controller.settings.script='bad.toml'",
            "bad.toml: the times of the keyframes must increase; they are [1.0, ",
        ),
    ],
)
def test_wrong_value_is_one_line(command: Command, tmp_path: Path, override: str, message: str) -> None:
    ball = trimesh.creation.icosphere(1, 2.0)
    ball.apply_translation([-60.0, 26.0, 0.0])  # in the back of the finger
    ball.export(tmp_path / "ball.stl")
    trimesh.Trimesh(ball.vertices, ball.faces[1:]).export(tmp_path / "open.stl")
    trimesh.creation.box([20.0, 5.0, 3.0]).apply_translation([510.0, 0.0, 0.0]).export(tmp_path / "far.stl")
    for empty in ("empty.stl", "empty.msh"):
        (tmp_path / empty).touch()
    (tmp_path / "bad.toml").write_text("keyframes = [{ time = 1, pressure = 0 }, { time = 0.5, pressure = 0 }]")
    assert message in refusal(command, "scene.toml", "--set", override)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nothing.toml"], "nothing.toml: no such file, and none of the shipped scenes: "),
        (["."], ".: is a folder; a file (.toml"),  # and what plug-ins read
        (["scene.toml", "--duration", "0"], "duration = 0: must be a positive number of seconds"),
        (["scene.toml", "--duration", "-1"], "duration = -1: must be a positive number of seconds"),
        (["scene.toml", "--duration", "nan"], "duration = nan: must be a positive number of seconds"),
        (["scene.toml", "--controller", "piano"], "no controller is called 'piano'; there are: "),
        (["scene.toml", "--outputs", "film"], "no output is called 'film'; there are: "),
        (["scene.toml", "--output", "scene.toml"], "--output scene.toml: cannot be written: File exists"),
        (["scene.toml", "--output", "scene.toml/x"], "--output scene.toml/x: cannot be written: Not a directory"),
    ],
)
def test_wrong_argument_is_one_line(command: Command, arguments: list[str], message: str) -> None:
    assert refusal(command, *arguments).startswith(message)


def test_scene_without_controller_says_how_to_name_one(command: Command, tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text(SCENE.replace('[controller]\nname = "scripted"\nsettings', "#"))
    assert refusal(command, "scene.toml") == "scene.toml: there is no [controller]; name one with --controller"


def test_diverged_run_keeps_its_results(command: Command, tmp_path: Path) -> None:
    (tmp_path / "burst.toml").write_text("keyframes = [{ time = 0, pressure = 0 }, { time = 0.3, pressure = 1e5 }]")
    code, output, errors = command("run", "scene.toml", "--set", "controller.settings.script=burst.toml")
    (line,) = errors.splitlines()
    assert code == 2
    assert line.startswith("taichisoft: step 1: body 'finger' has ")
    assert "elements turned inside out; control.pressure['finger.cavity'] = 3333.33 kPa: soft robots have 0 to " in line
    folder = tmp_path / "out" / "scene"
    assert outcome_and_steps(folder / "recording.h5") == (line.removeprefix("taichisoft: "), 1)
    assert json.loads((folder / "metrics.json").read_text())["steps"] == 1
    assert "results in" in output


def test_inside_out_cavity_is_turned_with_warning(command: Command, tmp_path: Path) -> None:
    ball = trimesh.creation.box([20.0, 5.0, 3.0])
    ball.apply_translation([-60.0, 26.0, 0.0])  # in the back of the finger
    ball.invert()
    ball.export(tmp_path / "ball.stl")
    override = "soft_bodies.finger.cavities.cavity={surface='ball.stl'}"
    code, output, _ = command("run", "scene.toml", "--set", override, "--outputs", "")
    assert code == 0
    assert f"warning: {tmp_path / 'ball.stl'}: is inside out; its triangles are turned round\n" in output


def test_brackets_in_titles_and_folders_are_text(command: Command) -> None:
    code, output, errors = command(
        "run", "scene.toml", "--set", "title='grip [/b] [red]'", "--output", "[/b]", "--outputs", "metrics,metrics"
    )
    assert (code, errors) == (0, "")
    assert "grip [/b] [red]" in output
    assert "results in [/b]" in output


def test_stopped_run_leaves_whole_recording(tmp_path: Path) -> None:
    """A process of its own: the signal comes while it computes; of other signals tests/engine/test_run.py."""
    (tmp_path / "scene.toml").write_text(SCENE)
    process = subprocess.Popen(
        [
            sys.executable,
            "-c",
            "from taichisoft.command_line import main; main()",
            *("run", "scene.toml", "--duration", "100000", "--output", "stopped"),
        ],
        cwd=tmp_path,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    recording = tmp_path / "stopped" / "recording.h5"
    try:
        deadline = time.monotonic() + PATIENCE
        while not recording.exists():
            assert process.poll() is None and time.monotonic() < deadline
            time.sleep(0.05)
        time.sleep(0.3)
        process.send_signal(signal.SIGINT)
        output, errors = process.communicate(timeout=PATIENCE)
    finally:
        process.kill()
    assert (process.returncode, errors) == (130, "")
    assert "results in stopped" in output
    outcome, steps = outcome_and_steps(recording)
    assert outcome == "interrupted"
    metrics = json.loads((tmp_path / "stopped" / "metrics.json").read_text())
    assert (metrics["outcome"], metrics["steps"]) == ("interrupted", steps)


@pytest.mark.parametrize("number", ["SIGTERM", "SIGHUP"])
@pytest.mark.skipif(sys.platform == "win32", reason="sends a signal")
def test_any_command_ends_as_by_ctrl_c(command: Command, monkeypatch: pytest.MonkeyPatch, number: str) -> None:
    """What a command has begun is cleared away; the process used to be killed where it was."""
    cleared = []

    def build(*_: object) -> None:
        try:
            signal.raise_signal(getattr(signal, number))
        finally:
            cleared.append(True)

    monkeypatch.setattr("taichisoft.running.run_command.load_scene", build)
    assert command("run", "scene.toml") == (130, "", "")
    assert cleared == [True]


@pytest.mark.parametrize(
    ("arguments", "environment"),
    [
        (["materials"], {"PYTHONIOENCODING": "latin-1", "COLUMNS": "60"}),
        (["--help"], {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "COLUMNS": "20"}),
    ],
)
def test_narrow_encoding_shows_tables(arguments: list[str], environment: dict[str, str]) -> None:
    program = [sys.executable, "-m", "taichisoft", *arguments]
    shown = subprocess.run(program, env={**os.environ, **environment}, capture_output=True, timeout=PATIENCE)
    assert (shown.returncode, shown.stderr) == (0, b"")
    assert b"yeoh" in shown.stdout or b"run" in shown.stdout


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="has no device that is always full")
@pytest.mark.parametrize(("arguments", "unbuffered"), [("materials", ""), ("materials", "1")])
def test_full_disk_is_one_line(arguments: str, unbuffered: str) -> None:
    environment = {**os.environ, "PYTHONUNBUFFERED": unbuffered}
    program = [sys.executable, "-m", "taichisoft", arguments]
    with Path("/dev/full").open("wb") as full:
        ended = subprocess.run(program, env=environment, stdout=full, stderr=subprocess.PIPE, timeout=PATIENCE)
    (line,) = ended.stderr.decode().splitlines()
    assert ended.returncode == 2
    assert line.startswith("taichisoft: ") and line.endswith("No space left on device")


def test_warning_made_error_is_one_line(command: Command) -> None:
    """As PYTHONWARNINGS=error makes it."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        code, _, errors = command("run", "scene.toml")
    (line,) = errors.splitlines()
    assert code == 1
    assert line.startswith("taichisoft: UserWarning: soft_bodies.finger.mesh: walls of one element")


def test_version_is_shown(command: Command) -> None:
    assert command("--version") == (0, f"taichisoft {taichisoft.__version__}\n", "")


def test_plugins_are_listed_with_what_they_provide(command: Command) -> None:
    code, output, _ = command("plugins")
    assert code == 0
    for word in ("controllers", "outputs", "meshing", "taichisoft_outputs", "scripted", "recording"):
        assert word in output


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["rn"], "No such command 'rn'. Did you mean 'run'?; see taichisoft --help"),
        (["mesh-info"], "No such command 'mesh-info'. Did you mean 'mesh info'?; see taichisoft --help"),
        (["optimise"], "No such command 'optimise'. Did you mean 'study optimise'?; see taichisoft --help"),
        (["sweep", "a"], "No such command 'sweep'. Did you mean 'mesh sweep', 'study sweep'?; see taichisoft --help"),
        (["recordin"], "No such command 'recordin'. Did you mean 'recording'?; see taichisoft --help"),
        (["study", "swep"], "No such command 'swep'. Did you mean 'sweep'?; see taichisoft study --help"),
        (["run"], "Missing argument 'scene'; see taichisoft run --help"),
        (["run", "scene.toml", "--film"], "No such option: --film"),
        (["run", "x", "--duration", "long"], "Invalid value for '--duration': "),
        (["run", "x", "--set"], "Option '--set' requires an argument"),
    ],
)
def test_parser_refuses_in_one_line(
    command: Command, monkeypatch: pytest.MonkeyPatch, arguments: list[str], message: str
) -> None:
    monkeypatch.setenv("COLUMNS", "20")
    code, output, errors = command(*arguments)
    (line,) = errors.splitlines()
    assert (code, output) == (2, "")
    assert line.startswith(f"taichisoft: {message}")


def test_command_alone_shows_its_help(command: Command) -> None:
    code, output, errors = command()
    assert (code, errors) == (2, "")
    assert "--version" in output


def test_help_fits_screen_with_daily_commands_first(command: Command) -> None:
    shown = command("--help")[1].splitlines()
    lines = shown[next(number for number, line in enumerate(shown) if "Commands" in line) :]
    names = [name for line in lines if (name := line.strip("│ ").split(" ")[0]).isalpha() and line[2] != " "]
    daily, others = "run render view resume", "new mesh mould characterise converge study reduce recording materials"
    assert names == f"{daily} {others} plugins sofa doctor".split()
    assert len(lines) <= 24


def test_profile_shows_phases(command: Command) -> None:
    code, out, _ = command("run", "scene.toml", "--profile")
    assert code == 0
    for phase in ("rotations and assembly", "factorisation", "contact detection", "Gauss-Seidel", "rest", "step"):
        assert phase in out
    _, out, _ = command("run", "scene.toml")
    assert "factorisation" not in out


NAME = "[red]\x1b[2Jfinger[/red]"
SHOWN = r"[red]\x1b[2Jfinger[/red]"


def on_terminal(table: object) -> str:
    console = Console(file=io.StringIO(), width=300, color_system=None, force_terminal=False)
    console.print(table)
    return console.file.getvalue()  # type: ignore[attr-defined]


def test_plain_text_has_no_markup_or_control_characters() -> None:
    assert plain(NAME).plain == SHOWN
    assert on_terminal(plain(NAME)) == SHOWN + "\n"


def test_mesh_sweep_shows_names_as_they_are() -> None:
    rows = [{NAME: NAME, "nodes": "12", "folder": "", "problem": "broken"}]
    text = on_terminal(summary_table(rows, NAME))
    assert text.count(SHOWN) == 3 and "failed" in text
    assert "\x1b" not in text


def test_comparison_shows_keys_and_values_as_they_are(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for run, title in (("one", "[red]thin[/red]"), ("two", "[green]thick")):
        (tmp_path / run).mkdir()
        (tmp_path / run / "scene.toml").write_text(f'title = "{title}"\n"[blue]key" = "{run}\\u001b"\n')
    monkeypatch.setenv("COLUMNS", "200")
    compare([tmp_path / "one", tmp_path / "two"], tmp_path / "both")
    text = capsys.readouterr().out
    assert "[red]thin[/red]" in text and "[green]thick" in text
    assert "scene.[blue]key" in text and r"one\x1b" in text and "\x1b" not in text
    with (tmp_path / "both" / "comparison.csv").open(newline="") as file:
        assert ["scene.title", "[red]thin[/red]", "[green]thick"] in list(csv.reader(file))


def test_materials_are_listed_by_names_and_units(monkeypatch: pytest.MonkeyPatch) -> None:
    material = next(iter(material_files.shipped_materials().values()))
    monkeypatch.setattr(material_files, "materials_of_plugins", lambda: {NAME: material})
    monkeypatch.setattr(rich, "get_console", lambda: Console(width=200))
    text = CliRunner().invoke(materials).stdout
    assert SHOWN in text and "\x1b" not in text
    assert "Young's modulus at rest [kPa]" in text


def test_benchmark_cases_are_lines_of_text(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    window = "step_ms = [2, 20]"
    (tmp_path / "cases.toml").write_text(
        f'[finger]\nkind = "steps"\ntitle = "[red]thin\\u001b"\nscene = "finger-inflated"\nfinger = "finger"\n'
        f'mesh = "tutorial-coarse"\nsteps = 30\nwindows = {{ {window} }}\n'
    )
    bench(cases=tmp_path / "cases.toml", list_=True)
    assert capsys.readouterr().out.rstrip().endswith(r" [red]thin\x1b")
