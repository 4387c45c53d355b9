"""Scenes and command lines with mistakes in them: each must end well, or in one line. `python -m` this module.

A try is drawn from its number alone, so that one that fails can be made again. Tries run in child processes, a batch in
each: a crash, and a try that takes too long, are failures like a traceback.
"""

import contextlib
import datetime
import io
import json
import os
import random
import shutil
import signal
import sys
import tempfile
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, get_args

import typer

from taichisoft.child_process import run_python

SECONDS = 60.0
"""Longest time of a try [s]."""
BATCH = 100
"""Tries in one process."""
LONGEST_LINE = 2000
"""Characters that an error may have."""
EXIT_CODES = (0, 1, 2)

DEEP = 2000
DEEP_LIST: Any = "[" * DEEP + "]" * DEEP
HUGE_INTEGER = "9" * 5000
DEEP_KEY = "a" + ".a" * 3000

NUMBERS = [0, -1, 1, 3.5, 1e300, -1e300, 1e-300, 1e200, 1e10, float("nan"), float("inf"), 10**30]
TEXTS = ["", "x", "x" * 5000, "a\0b", "a\nb", "é", "../..", "/", "~nobody/x", ".", "\u202e", "$(x)", "left"]
OTHERS = [True, False, [], {}, [[]], [1, 2, 3], [1e200] * 3, ["a"], {"a": 1}, datetime.date(2020, 2, 2), [0.0] * 3]

FILES = ("scene.toml", "text.toml", "empty.h5", "text.h5", "text.msh", "text.stl", "folder", "nothing.h5", "pad.msh")


@dataclass(frozen=True)
class Failure:
    """A try that ended neither well nor in one line.

    Attributes:
        number: number of the try.
        what: the command line.
        problem: how it ended, in one line.
    """

    number: int
    what: str
    problem: str


def base_scene() -> dict[str, Any]:
    """A scene of few elements with something of everything in it."""
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
    from taichisoft.scenes.scene import Scene

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
    return next((found for one in get_args(annotation) if (found := _model_in(one)) is not None), None)


COMMANDS: dict[str, tuple[int, str]] = {
    "run": (1, "--controller --output --set --duration --outputs --speed --keys --web-address --goal"),
    "resume": (1, "--at --set --duration --output --outputs"),
    "render": (1, "--time --video --fps --size --view --eye --target --output --colour-by"),
    "view": (1, "--address"),
    "plot": (1, "--output --format --only"),
    "report": (1, "--output"),
    "export": (1, "--output"),
    "mesh": (1, "--output --set"),
    "mesh-info": (1, ""),
    "mesh-sweep": (1, "--output --set --vary"),
    "mesh-cache": (0, ""),
    "materials": (1, "--output"),
    "plugins": (1, "--plugin --plugins-dir"),
    "sofa": (2, "--output"),
    "bench": (0, "--case --cases --compare --output"),
    "": (1, "--plugin --plugins-dir"),
}
"""Number of arguments, and options, of each command."""
KEYS = ("time.step", "contact.friction", "soft_bodies.left.mesh", "soft_bodies.left", "x", "title", "goal", DEEP_KEY)


def mistaken_command(number: int) -> list[str]:
    """A command line with mistakes; none that would go on for ever or open a page."""
    dice = random.Random(f"command {number}")
    texts = [text for text in TEXTS if "\0" not in text]
    values = [*map(str, NUMBERS), *texts, *FILES, HUGE_INTEGER, "í:8080", "x" * 300]
    name = dice.choice(list(COMMANDS))
    positional, options = COMMANDS[name]
    line = [name] if name else []
    if name == "bench":
        line.append("--list")
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


def try_scene(number: int) -> Failure | None:
    """Run a scene with mistakes for two steps."""
    Path("tried.toml").write_text(mistaken_scene(number), encoding="utf-8", errors="surrogatepass")
    return _ended(number, ["run", "tried.toml", "--duration", "0.02", "--output", "out"])


def try_command(number: int) -> Failure | None:
    """Type a command line with mistakes."""
    return _ended(number, mistaken_command(number))


TRIES: dict[str, Callable[[int], Failure | None]] = {"scenes": try_scene, "command lines": try_command}


class _TooLong(BaseException):
    """A try took longer than SECONDS."""


def _ended(number: int, arguments: list[str]) -> Failure | None:
    """None where a command ended well or in one line."""
    from taichisoft.command_line import main

    shown = " ".join(arguments)
    shown = shown if len(shown) <= 200 else shown[:197] + "..."
    before, errors = sys.argv, io.StringIO()
    sys.argv = ["taichisoft", *arguments]
    signal.signal(signal.SIGALRM, _raise_too_long)
    signal.setitimer(signal.ITIMER_REAL, SECONDS)
    try:
        with contextlib.redirect_stderr(errors), contextlib.redirect_stdout(io.StringIO()):
            main()
    except SystemExit as end:
        code = end.code if end.code is not None else 0
    except _TooLong:
        return Failure(number, shown, f"no end within {SECONDS:g} s")
    except BaseException as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        problem = f"{type(error).__name__}: {str(error)[:200]} ({place.filename}, line {place.lineno})"
        return Failure(number, shown, problem)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        sys.argv = before
    told = [line for line in errors.getvalue().splitlines() if not line.startswith("taichisoft: TAICHISOFT_DISABLE")]
    if code not in EXIT_CODES:
        return Failure(number, shown, f"exit code {code}")
    if "Traceback" in errors.getvalue() and "plug-in" not in told[0]:
        return Failure(number, shown, f"a traceback: {told[-1][:200]}")
    if code == 2 and len(told) != 1:
        return Failure(number, shown, f"{len(told)} lines of errors: {told[:2]}")
    if any(len(line) > LONGEST_LINE for line in told):
        return Failure(number, shown, f"an error of {max(map(len, told))} characters: {told[0][:100]}")
    return None


def _raise_too_long(_number: int, _frame: Any) -> None:
    raise _TooLong


def run_batch(kind: str, first: int, count: int) -> list[Failure]:
    """Make tries in this process, in a folder of its own."""
    failures = []
    folder, before = tempfile.mkdtemp(prefix="fuzz-"), Path.cwd()
    os.chdir(folder)
    try:
        _write_files()
        for number in range(first, first + count):
            print(f"at {number}", file=sys.__stdout__, flush=True)
            failure = TRIES[kind](number)
            if failure is not None:
                failures.append(failure)
    finally:
        os.chdir(before)
        shutil.rmtree(folder, ignore_errors=True)
    return failures


def _write_files() -> None:
    """The files that command lines name."""
    import tomli_w

    document = base_scene()
    Path("scene.toml").write_text(tomli_w.dumps(document))
    shutil.copy(document["soft_bodies"]["left"]["mesh"], "pad.msh")
    for name in ("text.toml", "text.h5", "text.msh", "text.stl"):
        Path(name).write_text("It was a dark and stormy night.\n")
    Path("empty.h5").touch()
    Path("folder").mkdir()


def run_tries(kind: str, count: int, first: int = 0) -> list[Failure]:
    """Make tries in child processes; a batch that crashes goes on after the try that crashed it."""
    failures: list[Failure] = []
    done, end = first, first + count
    while done < end:
        size = min(BATCH, end - done)
        child = run_python(["-m", __spec__.name, "--batch", kind, str(done), str(size)], SECONDS * size)
        lines = child.output.splitlines()
        reached = max((int(line.split()[1]) for line in lines if line.startswith("at ")), default=done)
        failures += [Failure(**json.loads(line)) for line in lines if line.startswith("{")]
        if child.problem:
            failures.append(Failure(reached, "", child.problem))
            done = reached + 1
        else:
            done += size
    return failures


def measure(
    scenes: Annotated[int, typer.Option(help="How many scenes to try.")] = 1000,
    command_lines: Annotated[int, typer.Option(help="How many command lines to try.")] = 1000,
    first: Annotated[int, typer.Option(help="Number of the first try.")] = 0,
) -> None:
    """Try scenes and command lines with mistakes, and show those that end in anything but one line."""
    bad = 0
    for kind, count in (("scenes", scenes), ("command lines", command_lines)):
        failures = run_tries(kind, count, first)
        bad += len(failures)
        for failure in failures:
            typer.echo(f"{kind} {failure.number}: {failure.what}: {failure.problem}")
        typer.echo(f"{kind}: {count} tries, {len(failures)} failures")
    if bad:
        raise typer.Exit(1)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--batch"]:
        for found in run_batch(sys.argv[2], int(sys.argv[3]), int(sys.argv[4])):
            print(json.dumps(found.__dict__), file=sys.__stdout__)
    else:
        typer.run(measure)
