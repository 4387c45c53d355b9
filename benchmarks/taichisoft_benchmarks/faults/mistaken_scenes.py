"""Scenes with one to three mistakes: a value of another type, size or sign, a missing or foreign key, no TOML."""

import datetime
import random
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

DEEP = 2000
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
    return next((found for one in get_args(annotation) if (found := _model_in(one)) is not None), None)


def attempt(number: int) -> list[str]:
    """Run a scene with mistakes for two steps."""
    Path("tried.toml").write_text(mistaken_scene(number), encoding="utf-8", errors="surrogatepass")
    return ["run", "tried.toml", "--duration", "0.02", "--output", "out"]
