"""Input that nobody should write, and everybody sometimes does, ends in one line, never in a traceback.

Scenes, command lines and files with mistakes are drawn at random, each from its number alone, to repeat failures.
"""

import contextlib
import datetime
import io
import random
import shutil
import signal
import sys
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, get_args

import pytest
from conftest import Command
from damage import DAMAGES, damaged_text

from taichisoft import load_scene
from taichisoft.base import parse_toml
from taichisoft.base.files import DEEPEST
from taichisoft.command_line import LONGEST_LINE, main
from taichisoft.errors import SceneError

DEEP = 2000


@pytest.mark.parametrize(
    ("scene", "problem"),
    [
        ("soft_bodies.a = 'text'\nsoft_bodies.b.like = 'a'", "soft_bodies.a must be a table"),
        (f"title = {'[' * DEEP}{']' * DEEP}", f"nested deeper than {DEEPEST}"),
        (f"{'a.' * DEEP}a = 1", f"nested deeper than {DEEPEST}"),
        (f"gravity = [0, 0, {'9' * 5000}]", "integer of thousands of digits"),
        (f"[soft_bodies.a]\nmesh = '{'x' * 5000}'", "no such file"),
        ("[soft_bodies.a]\nmesh = '~nobody-of-this-name/x'", "no such file"),
        ("[soft_bodies.a]\nmaterial = 'x\\u0000'\nmesh = 'tutorial-coarse'", "materials"),
    ],
)
def test_scene_that_cannot_be_meant_is_refused(tmp_path: Path, scene: str, problem: str) -> None:
    file = tmp_path / "scene.toml"
    file.write_text(scene)
    with pytest.raises(SceneError) as refused:
        load_scene(file)
    assert problem in str(refused.value)


@pytest.mark.parametrize(
    "arguments",
    [
        ["recording", "report", ""],
        ["recording", "report", "x" * 5000],
        ["recording", "plot", "x" * 300],
        ["run", "gripper", "--web", "--web-address", "í:8080"],
        ["run", "gripper", "--set", f"{'a.' * DEEP}a=1"],
        ["run", "x" * 5000],
        ["run", "~nobody-of-this-name/scene.toml"],
        ["plugins", "--plugin", "x" * 5000],
    ],
)
def test_command_line_that_cannot_be_meant_is_refused(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, command: Command, arguments: list[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    code, _, errors = command(*arguments)
    (line,) = errors.splitlines()
    assert code == 2
    assert line.startswith("taichisoft: ") and len(line) < 1.1 * LONGEST_LINE


def test_nesting_has_limit() -> None:
    assert parse_toml(f"a = {'[' * (DEEPEST - 1)}{']' * (DEEPEST - 1)}")
    with pytest.raises(ValueError, match="nested deeper"):
        parse_toml(f"a = {'[' * (DEEPEST + 1)}{']' * (DEEPEST + 1)}")


DEEP_LIST: Any = "[" * DEEP + "]" * DEEP
HUGE_INTEGER = "9" * 5000

NUMBERS = [0, -1, 1, 3.5, 1e300, -1e300, 1e-300, 1e200, 1e10, float("nan"), float("inf"), 10**30]
TEXTS = ["", "x", "x" * 5000, "a\0b", "a\nb", "é", "../..", "/", "~nobody/x", ".", "\u202e", "$(x)", "left"]
OTHERS = [True, False, [], {}, [[]], [1, 2, 3], [1e200] * 3, ["a"], {"a": 1}, datetime.date(2020, 2, 2), [0.0] * 3]


def base_scene() -> dict[str, Any]:
    """A scene of few elements that has every kind of table."""
    import taichisoft

    pad = str(Path(taichisoft.__file__).parent / "tiny_gripper" / "pad.msh")
    return {
        "title": "tried",
        "gravity": [0.0, 0.0, -9810.0],
        "time": {"step": 0.01, "duration": 0.02},
        "contact": {"friction": 0.6, "contact_distance": 0.2, "alarm_distance": 2.0},
        "controller": {"name": "scripted", "settings": {"script": "rest"}, "period": 0.02},
        "limits": {"lowest_pressure": 0.0, "highest_pressure": 30.0, "base_speed": 100.0},
        "goal": {"object": "cube", "tolerance": 1.0, "hold": 0.01, "creep": 0.1},
        "appearance": {"background": "#002b36", "frame": False, "eye": [100.0, 0.0, 0.0]},
        "external_forces": [{"body": "cube", "force": [1.0, 0.0, 0.0], "start": 0.0, "duration": 0.01}],
        "soft_bodies": {
            "left": {
                "mesh": pad,
                "translation": [-26.0, 0.0, 10.0],
                "density": 1e-6,
                "young_modulus": 100.0,
                "poisson_ratio": 0.3,
                "rayleigh_stiffness": 0.02,
                "anchors": [{"group": "base"}],
                "regions": [{"box": [[-5.0, -5.0, -5.0], [5.0, 5.0, 5.0]], "young_modulus": 300.0}],
                "cavities": {"cavity": {"group": "cavity", "highest_pressure": 20.0}},
            },
            "right": {"like": "left", "rotation": [0.0, 0.0, 180.0], "translation": [26.0, 0.0, 10.0]},
        },
        "rigid_bodies": {
            "cube": {"box": [10.0, 10.0, 10.0], "mass": 0.001, "position": [0.0, 0.0, 5.2]},
            "ball": {"sphere": {"radius": 4.0}, "density": 1e-6, "position": [0.0, 0.0, 40.0]},
        },
        "obstacles": {"floor": {"plane": {"point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}}},
    }


def mistaken_scene(number: int) -> str:
    """The text of a scene with one to three mistakes."""
    import tomli_w

    dice = random.Random(f"scene {number}")
    document = base_scene()
    text_values: dict[str, str] = {}
    for _ in range(dice.choice([1, 1, 1, 2, 3])):
        _spoil(document, dice, text_values)
    try:
        text = tomli_w.dumps(document)
    except (TypeError, ValueError, RecursionError):
        return "title = [" * 3
    for mark, value in text_values.items():
        text = text.replace(f'"{mark}"', value)
    if dice.random() < 0.1:
        place = dice.randrange(len(text))
        text = text[:place] + dice.choice(["[", "]", '"', "=", "\0", "\n", "'''", "é", "."]) + text[place + 1 :]
    return text


def _spoil(document: dict[str, Any], dice: random.Random, text_values: dict[str, str]) -> None:
    """Change, remove or add one entry somewhere in the tables."""
    from taichisoft import Scene

    places = list(_places(document, Scene))
    table, key, model = dice.choice(places)
    kind = dice.random()
    if kind < 0.15:
        del table[key]
        return
    if kind < 0.35 and isinstance(table, dict) and model is not None:
        key = dice.choice([*model.model_fields, "x", "like"])
    elif kind < 0.4 and isinstance(table, dict):
        key = dice.choice(TEXTS)
    table[key] = _nasty(dice, text_values, table[key] if isinstance(table, list) or key in table else None)


def _nasty(dice: random.Random, text_values: dict[str, str], before: Any) -> Any:
    if dice.random() < 0.1:
        mark = f"@{len(text_values)}@"
        text_values[mark] = dice.choice([DEEP_LIST, HUGE_INTEGER, "1e999999", "[" * 50 + "]" * 50])
        return mark
    if isinstance(before, float | int) and dice.random() < 0.6:
        return dice.choice([*NUMBERS, before * 1e3, before * 1e-3, before * 1e6, -before])
    return dice.choice([*NUMBERS, *TEXTS, *OTHERS])


def _places(table: Any, model: Any) -> Iterator[tuple[Any, Any, Any]]:
    """Every entry of tables within tables: the table, its key, and the class of the table."""
    for key in list(table) if isinstance(table, dict) else range(len(table)):
        yield table, key, model
        inner = table[key]
        if isinstance(inner, dict | list):
            annotation = getattr(getattr(model, "model_fields", {}).get(key), "annotation", model)
            yield from _places(inner, _model_in(annotation))


def _model_in(annotation: Any) -> Any:
    if hasattr(annotation, "model_fields"):
        return annotation
    return next((model for part in get_args(annotation) if (model := _model_in(part)) is not None), None)


def attempt_scene(number: int) -> list[str]:
    """Run a scene with mistakes for two steps."""
    Path("tried.toml").write_text(mistaken_scene(number), encoding="utf-8", errors="surrogatepass")
    return ["run", "tried.toml", "--duration", "0.02", "--output", "out"]


DEEP_KEY = "a" + ".a" * 3000
FILES = ("scene.toml", "text.toml", "empty.h5", "text.h5", "text.msh", "text.stl", "folder", "nothing.h5", "pad.msh")
COMMANDS: dict[str, tuple[int, str]] = {
    "run": (1, "--controller --output --set --duration --outputs --speed --keys --web-address --goal"),
    "resume": (1, "--at --set --duration --output --outputs"),
    "render": (1, "--time --video --fps --size --view --eye --target --output --colour-by"),
    "view": (1, "--address"),
    "recording plot": (1, "--output --format --only"),
    "recording report": (1, "--output"),
    "recording export": (1, "--output"),
    "mesh": (1, "--output --set"),
    "mesh info": (1, ""),
    "mesh sweep": (1, "--output --set --vary"),
    "mesh cache": (0, ""),
    "materials": (1, "--output"),
    "plugins": (1, "--plugin"),
    "sofa": (2, "--output"),
    "": (1, "--plugin"),
}
"""Number of arguments, and options, of each command."""
KEYS = ("time.step", "contact.friction", "soft_bodies.left.mesh", "soft_bodies.left", "x", "title", "goal", DEEP_KEY)


def attempt_command(number: int) -> list[str]:
    """A command line with mistakes that neither runs for ever nor opens a page."""
    dice = random.Random(f"command {number}")
    texts = [text for text in TEXTS if "\0" not in text]
    values = [*map(str, NUMBERS), *texts, *FILES, HUGE_INTEGER, "í:8080", "x" * 300]
    name = dice.choice(list(COMMANDS))
    positional, options = COMMANDS[name]
    line = name.split()
    if name == "run" and dice.random() < 0.7:
        line += ["scene.toml", "--duration", "0.02"]
    else:
        line += [dice.choice(values) for _ in range(positional if dice.random() < 0.9 else dice.randrange(3))]
    for _ in range(dice.choice([0, 1, 1, 2])):
        if options:
            line.append(dice.choice(options.split()))
            if dice.random() < 0.95:
                line.append((f"{dice.choice(KEYS)}=" if line[-1] == "--set" else "") + dice.choice(values))
    return line


def write_command_files() -> None:
    """The files that command lines name."""
    import tomli_w

    document = base_scene()
    Path("scene.toml").write_text(tomli_w.dumps(document))
    shutil.copy(document["soft_bodies"]["left"]["mesh"], "pad.msh")
    for name in ("text.toml", "text.h5", "text.msh", "text.stl"):
        Path(name).write_text("It was a dark and stormy night.\n")
    Path("empty.h5").touch()
    Path("folder").mkdir()


VOLUMES = ("whole.msh", "whole.vtk", "whole.vtu")
SURFACES = ("whole.stl", "whole.obj", "whole.ply")


def write_mesh_files() -> None:
    """A mesh and a surface in every format, and a scene that has one of each."""
    import tomli_w
    import trimesh

    from taichisoft.mesh import read_volume_mesh, write_volume_mesh

    document = base_scene()
    shutil.copy(document["soft_bodies"]["left"]["mesh"], "whole.msh")
    for name in VOLUMES[1:]:
        write_volume_mesh(read_volume_mesh("whole.msh"), name)
    for name in SURFACES:
        trimesh.creation.icosphere(1, 5.0).export(name)
    document["rigid_bodies"]["ball"] = {"surface": "whole.stl", "mass": 0.001, "position": [0.0, 0.0, 40.0]}
    Path("scene.toml").write_text(tomli_w.dumps(document))


def attempt_mesh_file(number: int) -> list[str]:
    """Do something with a damaged file."""
    dice = random.Random(f"mesh file {number}")
    whole = dice.choice(VOLUMES + SURFACES)
    tried = Path("tried").with_suffix(Path(whole).suffix)
    tried.write_bytes(damaged_text(Path(whole).read_bytes(), dice))
    if dice.random() < 0.3:
        return ["mesh", "info", str(tried)]
    if whole in SURFACES and dice.random() < 0.2:
        return ["mesh", "--surfaces", str(tried), "--size", "4", "--output", "meshed.msh"]
    key = "soft_bodies.left.mesh" if whole in VOLUMES else "rigid_bodies.ball.surface"
    return ["run", "scene.toml", "--set", f"{key}='{tried}'", "--duration", "0.02", "--output", "out"]


def write_step_file() -> None:
    """A block with a round void."""
    from taichisoft_meshing.gmsh_session import gmsh_session

    with gmsh_session("whole.step") as gmsh:
        occ = gmsh.model.occ
        occ.cut([(3, occ.addBox(0.0, 0.0, 0.0, 20.0, 10.0, 10.0))], [(3, occ.addSphere(10.0, 5.0, 5.0, 3.0))])
        occ.synchronize()
        gmsh.write("whole.step")


def attempt_step_file(number: int) -> list[str]:
    """Mesh a damaged body; OpenCASCADE, which reads it, may crash."""
    dice = random.Random(f"STEP file {number}")
    Path("tried.step").write_bytes(damaged_text(Path("whole.step").read_bytes(), dice))
    return ["mesh", "tried.step", "--size", "5", "--force", "--output", "meshed.msh"]


def write_study_table() -> None:
    """A table of 40 runs."""
    from taichisoft_studies.results_table import PARQUET, write_table

    row = {"seed": 1, "status": "completed", "message": "", "metrics.force": 1.5, "folder": "runs/x"}
    write_table([{"run": f"r{number}", "pressure": 0.1 * number, **row} for number in range(40)], Path())
    shutil.copy(PARQUET, "whole")


def attempt_study_table(number: int) -> list[str]:
    """Report on a study whose table is damaged."""
    from taichisoft_studies.results_table import PARQUET

    dice = random.Random(f"table {number}")
    Path(PARQUET).write_bytes(dice.choice(DAMAGES)(Path("whole").read_bytes(), dice))
    return ["study", "report", "."]


SECONDS = 60.0
"""Most processor time of a try [s]."""
LONGEST_ERROR = 2000
"""Characters that an error may have."""
EXIT_CODES = (0, 1, 2)


class _TooLong(BaseException):
    """A try took more than SECONDS."""


def problem_of(arguments: list[str]) -> str:
    """Run a command line in this process; returns what is wrong, nothing if it ended well or in one line."""

    before, errors, written = sys.argv, io.StringIO(), io.StringIO()
    sys.argv = ["taichisoft", *arguments]
    signal.signal(signal.SIGPROF, _raise_too_long)
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    try:
        with contextlib.redirect_stderr(errors), contextlib.redirect_stdout(written):
            main()
        return "main returned"
    except SystemExit as end:
        problem = _problem(end.code if end.code is not None else 0, errors.getvalue(), written.getvalue())
    except _TooLong:
        problem = f"no end within {SECONDS:g} s of processor time"
    except BaseException as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        problem = f"{type(error).__name__}: {str(error)[:200]} ({place.filename}, line {place.lineno})"
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        sys.argv = before
    return f"{' '.join(arguments)[:200]}: {problem}" if problem else ""


def _problem(code: Any, errors: str, written: str) -> str:
    lines = [line for line in errors.splitlines() if not line.startswith("taichisoft: TAICHISOFT_DISABLE")]
    if code not in EXIT_CODES:
        return f"exit code {code}"
    if "Traceback" in errors and "plug-in" not in lines[0]:
        return f"a traceback: {lines[-1][:200]}"
    shows_help = not lines and "Usage:" in written  # of a command that needs a subcommand
    if code == 2 and len(lines) != 1 and not shows_help:
        return f"{len(lines)} lines of errors: {lines[:2]}"
    if any(len(line) > LONGEST_ERROR for line in lines):
        return f"an error of {max(map(len, lines))} characters: {lines[0][:100]}"
    return ""


def _raise_too_long(_number: int, _frame: Any) -> None:
    raise _TooLong


@pytest.mark.parametrize(
    ("write_files", "attempt", "count"),
    [
        (lambda: None, attempt_scene, 25),
        (write_command_files, attempt_command, 40),
        (write_mesh_files, attempt_mesh_file, 12),
        (write_step_file, attempt_step_file, 2),
        (write_study_table, attempt_study_table, 2),
    ],
)
def test_random_mistakes_end_in_one_line(
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    write_files: Callable[[], None],
    attempt: Callable[[int], list[str]],
    count: int,
) -> None:
    """A few of each kind; each attempt writes its file into the current folder and returns its command line."""
    monkeypatch.chdir(tmp_path)
    write_files()
    problems = {number: problem_of(attempt(number)) for number in range(5000, 5000 + count)}
    assert {number: problem for number, problem in problems.items() if problem} == {}
