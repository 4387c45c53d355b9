"""Writes docs/reference: public names of Python, hooks, keys of scenes, each from its docstrings; a test compares.

python docs/write_reference.py
"""

import ast
import dataclasses
import inspect
import itertools
import re
import sys
from functools import cached_property
from pathlib import Path
from types import FunctionType, UnionType
from typing import Any, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

import taichisoft
import taichisoft_gym
from taichisoft.control import FIGURES, In
from taichisoft.running import hook_names, hookspecs
from taichisoft.scene import (
    actuators,
    air,
    file,
    key_descriptions,
    rigid_body,
    scene,
    sensor_settings,
    soft_body,
    table,
)
from taichisoft_controllers.step_in_progress import QUANTITIES, QuantityKind
from taichisoft_sofa.components.known_components import IGNORED, known_types
from taichisoft_sofa.tree.value_kinds import ALIASES

FOLDER = Path(__file__).parent / "reference"
NOTE = "<!-- Written by `python docs/write_reference.py` from docstrings; a test compares. -->"

PYTHON = f"""# Python

{NOTE}

Everything that a program or a plug-in may use: `import taichisoft` has these names. Units are millimetre, kilogram and
second: forces are in mN, pressures and moduli in kPa. Arrays are numpy's. What to do with the names is shown in the
[examples](../../examples/README.md) and, for plug-ins, in [plugins.md](../plugins.md).
"""
SECTIONS = {
    "Simulating": [
        *("load_scene", "scene_from_dict", "Scene", "make_model", "Model", "Simulation"),
        *("Control", "Force", "Observation", "StepReport", "State"),
    ],
    "Running": ["run", "make_controller", "make_output", "Controller", "KeyEvent", "Slider", "Output", "Session"],
    "Gradients": ["gradient", "RunGradient", "LeastSquares"],
    "Planning": ["rollouts", "Rollouts", "equilibrium", "Equilibrium", "Linearisation", "inverse", "InverseSolution"],
    "Meshes": ["VolumeMesh", "read_volume_mesh", "write_volume_mesh", "Geometry"],
    "Plug-ins": [
        *("hookimpl", "RunOption", "Renderer", "CameraFrame", "CameraView", "group_with_default"),
        *("load_plugin", "register_plugin", "unregister_plugin"),
    ],
}

MADE_FOR_USERS = (taichisoft.Session, taichisoft.Rollouts)
"""Classes whose objects a function or a hook gives."""

ENVIRONMENTS = f"""# Environments

{NOTE}

Names of `taichisoft_gym`; [environments.md](../environments.md) shows their use. `State` and `Observation` are those of
[Python](python.md).
"""
ENVIRONMENT_NAMES = sorted(taichisoft_gym.__all__, key=lambda name: name != "SoftRobotEnvironment")

HOOKS = f"""# Hooks

{NOTE}

All that a plug-in may implement, marked with `taichisoft.hookimpl`; [plugins.md](../plugins.md) shows how. An
implementation may leave out arguments that it does not need.
"""

SCENES = f"""# Scenes

{NOTE}

A scene is a TOML file. Units are millimetre, kilogram and second: forces in mN, pressures and moduli in kPa.
Files are looked for beside the scene, in the current folder, and among what ships. `like = "other"` takes over
everything that a soft body does not set itself from a soft body above it. `taichisoft run` writes the
resolved scene, with every default filled in, to `scene.toml` in its output folder.
"""
SOFA = f"""# Components of SOFA

{NOTE}

What becomes of the components of a SOFA scene; [sofa.md](../sofa.md) tells the rest. Names that components had in older
versions are understood as well.
"""
FIGURES_PAGE = f"""# Figures

{NOTE}

What is observed of a simulation. [Conditions](../controllers.md#conditions) of scripts can name all with a meaning, and
brackets choose one of several. "The object" is that of the scene's goal; without a goal, forces are those on all rigid
bodies, and `height`, `lift` and `speed` need a name if there are several. Forces are those of the step before.
Columns of `run.csv` are called by name, what it is of and unit, datasets of recordings by the name, and metrics such as
`final_pressures_kPa` by name and unit. An [observation](python.md) has radians instead of degrees. Rollouts and targets
use the names of its attributes.
"""
WHERE = {
    In.CSV: "CSV",
    In.RECORDING: "recording",
    In.PAGE: "page",
    In.FINAL: "metrics (last)",
    In.LARGEST: "metrics (largest)",
}
TABLES: dict[str, type[BaseModel]] = {
    "(top level)": scene.Scene,
    "[time]": scene.Time,
    "[contact]": scene.Contact,
    "[[contact.pairs]]": scene.ContactPair,
    "[controller]": scene.SceneControllerSettings,
    "[limits]": scene.Limits,
    "[air]": air.AirNetworkSettings,
    "[air.sources.NAME]": air.AirSource,
    "[air.tanks.NAME]": air.Tank,
    "[air.tubes.NAME]": air.AirTube,
    "[air.orifices.NAME]": air.AirOrifice,
    "[air.valves.NAME]": air.AirValve,
    "[[external_forces]]": scene.ExternalForce,
    "[goal]": scene.Goal,
    "[sensors.QUANTITY]": sensor_settings.SensorSettings,
    "[cameras.NAME]": sensor_settings.CameraSettings,
    "[appearance]": scene.Appearance,
    "[soft_bodies.NAME]": soft_body.SoftBodySettings,
    "[soft_bodies.NAME.mesh]": soft_body.BodyMesh,
    "[[soft_bodies.NAME.collision_surface]]": soft_body.CollisionSurfaceSettings,
    "selection of elements": soft_body.Selection,
    "selection of nodes": soft_body.NodeSelection,
    "[[soft_bodies.NAME.regions]]": soft_body.Region,
    "[[soft_bodies.NAME.anchors]]": soft_body.Anchor,
    "[[soft_bodies.NAME.forces]]": soft_body.NodalForce,
    "[soft_bodies.NAME.tip]": soft_body.Tip,
    "[soft_bodies.NAME.pattern], [rigid_bodies.NAME.pattern]": file.CircularPattern,
    "[soft_bodies.NAME.tactile.NAME]": sensor_settings.TactileArray,
    "[soft_bodies.NAME.membranes.NAME]": soft_body.MembraneSettings,
    "[soft_bodies.NAME.fibres.NAME]": soft_body.FibreSettings,
    "helix = { ... } of fibres": soft_body.Helix,
    "[soft_bodies.NAME.springs.NAME]": soft_body.SpringSettings,
    **{f"[soft_bodies.NAME.{key}.NAME]": made for key, made in actuators.ActuatorTables.tables().items()},
    "[soft_bodies.NAME.cavities.NAME.line]": air.AirLine,
    "{ body = ..., point = ... } in points of a cable": actuators.CablePoint,
    "[frames.NAME]": rigid_body.FrameSettings,
    "path = { ... } of a frame": rigid_body.FramePath,
    "hinge = { ... } of a frame": rigid_body.HingeSettings,
    "[rigid_bodies.NAME]": rigid_body.RigidBodySettings,
    "[rigid_bodies.NAME.springs]": rigid_body.RigidSpringsSettings,
    "[obstacles.NAME]": rigid_body.ObstacleSettings,
    "plane = { ... } of an obstacle": rigid_body.PlaneSettings,
    "sphere = { ... }": rigid_body.Sphere,
    "cylinder = { ... }": rigid_body.Cylinder,
    "capsule = { ... }": rigid_body.Capsule,
}


def pages() -> dict[str, str]:
    """Content of each page by the name of its file."""
    return {
        "python.md": _python_page(),
        "environments.md": _joined(
            [ENVIRONMENTS, *(_class(getattr(taichisoft_gym, one)) for one in ENVIRONMENT_NAMES)]
        ),
        "hooks.md": _hooks_page(),
        "scenes.md": _scenes_page(),
        "figures.md": _figures_page(),
        "sofa.md": _sofa_page(),
    }


def _python_page() -> str:
    parts = [PYTHON]
    for title, names in SECTIONS.items():
        parts += [f"## {title}", *map(_public_name, names)]
    found = [thing for thing in vars(taichisoft.errors).values() if inspect.isclass(thing)]
    parts += ["## Errors", "All are in `taichisoft.errors`."]
    return _joined([*parts, *(_class(error) for error in found if issubclass(error, Exception))])


def _public_name(name: str) -> str:
    thing = getattr(taichisoft, name)
    if inspect.isclass(thing):
        return _class(thing)
    return _function(thing, "###") if inspect.isfunction(thing) else f"### {name}\n\n{_comment_below(name)}"


def _hooks_page() -> str:
    return _joined([HOOKS, *(_function(getattr(hookspecs, name), "##") for name in hook_names())])


def _sofa_page() -> str:
    older = {new: [] for new in ALIASES.values()}  # type: dict[str, list[str]]
    for old, new in ALIASES.items():
        older[new].append(old)
    kinds: dict[str, list[str]] = {}
    for name, known in known_types().items():
        meaning = inspect.cleandoc(known.translate.__doc__ or "").replace("\n", " ")
        kinds.setdefault(re.sub(r"^(Translate|Accept) ", "", meaning), []).extend([name, *older.get(name, [])])
    rows = [f"| {', '.join(f'`{name}`' for name in names)} | {meaning} |" for meaning, names in kinds.items()]
    without = ", ".join(f"`{name}`" for name in sorted(IGNORED))
    table = "\n".join(["| components | what becomes of them |", "|---|---|", *rows])
    return _joined(
        [SOFA, "## Understood", table, "## Without effect", f"They are listed at the end of loading: {without}."]
    )


def _figures_page() -> str:
    head = ("name", "in brackets", "unit", "in a condition", "in", "attribute")
    further = {one.name: QuantityKind(one.unit, "", "", one) for one in FIGURES if not one.meaning}
    rows = [head, ("---",) * len(head), *(_figure_row(name, kind) for name, kind in {**QUANTITIES, **further}.items())]
    return _joined([FIGURES_PAGE, "\n".join(f"| {' | '.join(cells)} |" for cells in rows)])


def _figure_row(name: str, kind: QuantityKind) -> tuple[str, ...]:
    figure, cells = kind.figure, (f"`{name}`", kind.key, kind.unit, kind.meaning)
    if figure is None or name != figure.name:
        return *cells, "", ""
    where = ", ".join(WHERE[part] for part in figure.recorded)
    return *cells, where, "" if figure.in_model else f"`{figure.field}`"


def _joined(parts: list[str]) -> str:
    return re.sub(r"\n{3,}", "\n\n", "\n\n".join(parts)).rstrip() + "\n"


def _function(function: Any, heading: str, name: str = "") -> str:
    """Heading with the signature, what the docstring says, and lists of arguments and errors."""
    signature = inspect.signature(function)
    arguments = [argument for argument in signature.parameters.values() if argument.name not in ("self", "cls")]
    text, sections = _parse(inspect.getdoc(function) or "")
    entries = sections.get("Args", {})
    if entries or (arguments and heading != "####"):  # a method's first line may say it all
        _compare(function.__qualname__, [argument.name for argument in arguments], entries)
    answer = "" if name or signature.return_annotation is None else f" -> {_type(signature.return_annotation)}"
    lines = [f"{heading} `{name or function.__name__}({', '.join(map(_argument, arguments))}){answer}`\n", text, ""]
    lines += [f"- `{argument}`: {meaning}" for argument, meaning in entries.items()]
    lines += [f"- returns: {meaning}" for meaning in sections.get("Returns", {}).values()]
    lines += [f"- raises `{error}`: {meaning}" for error, meaning in sections.get("Raises", {}).items()]
    return "\n".join(lines) + "\n"


def _argument(argument: inspect.Parameter) -> str:
    stars = {inspect.Parameter.VAR_POSITIONAL: "*", inspect.Parameter.VAR_KEYWORD: "**"}.get(argument.kind, "")
    default = "" if argument.default is argument.empty else f" = {argument.default!r}"
    return f"{stars}{argument.name}: {_type(argument.annotation)}{default}"


def _class(made: type) -> str:
    """Heading, docstring, how it is made, attributes and methods, without those of a base that is on this page."""
    own = [base for base in made.__mro__ if base.__module__.startswith(("taichisoft.", "taichisoft_gym."))]
    own = [base for base in own if base is not table.Table]
    shown = next((base for base in own[1:] if _is_on_page(base)), None)
    if shown is not None:
        own = [base for base in own if not issubclass(shown, base)]
    text = _parse(inspect.getdoc(made) or "")[0]
    entries: dict[str, str] = {}
    types: dict[str, str] = {}
    members: dict[str, Any] = {}
    for base in reversed(own):
        entries |= _parse(inspect.cleandoc(base.__doc__ or ""))[1].get("Attributes", {})
        types |= {name: _type(annotation) for name, annotation in inspect.get_annotations(base).items()}
        members |= {name: member for name, member in vars(base).items() if not name.startswith("_")}
    if dataclasses.is_dataclass(made):
        _compare(made.__name__, [one.name for one in dataclasses.fields(made) if not one.name.startswith("_")], entries)
    for name, member in members.items():
        if isinstance(member, property | cached_property):
            entries[name] = " ".join(inspect.cleandoc(member.__doc__ or "").split())
            made_by = member.func if isinstance(member, cached_property) else member.fget
            types[name] = _type(inspect.signature(made_by or made).return_annotation)
    if made is scene.Scene:
        text += "\n\nThe keys of [scenes.md](scenes.md) are attributes, too."
    if shown is not None and shown is not taichisoft.errors.TaichisoftError:
        text += f"\n\nA `{shown.__name__}`."
    lines = [f"### {made.__name__}\n", text, ""]
    makes = vars(made).get("__init__")
    if makes is not None and makes.__doc__ and made not in MADE_FOR_USERS:
        lines.append(_function(makes, "####", made.__name__))
    for (meaning, kind), names in _alike(entries, types):
        lines.append(f"- {', '.join(f'`{name}`' for name in names)}{f' (`{kind}`)' if kind else ''}: {meaning}")
    methods = [name for name, member in members.items() if isinstance(member, FunctionType | classmethod)]
    return "\n".join([*lines, "", *(_function(getattr(made, name), "####") for name in methods)])


def _is_on_page(thing: type) -> bool:
    return thing in vars(taichisoft.errors).values() or thing in [
        getattr(taichisoft, name) for names in SECTIONS.values() for name in names
    ]


def _alike(entries: dict[str, str], types: dict[str, str]) -> Any:
    """Groups of names that have one meaning and type, which stand in one line."""
    return [
        (about, list(names))
        for about, names in itertools.groupby(entries, lambda name: (entries[name], types.get(name, "")))
    ]


def _comment_below(name: str) -> str:
    """The string below an assignment at the top level of the module of hooks."""
    body = ast.parse(inspect.getsource(hookspecs)).body
    names = [ast.unparse(node.targets[0]) if isinstance(node, ast.Assign) else "" for node in body]
    below = body[names.index(name) + 1]
    assert isinstance(below, ast.Expr)
    return inspect.cleandoc(str(ast.literal_eval(below.value)))


def _parse(docstring: str) -> tuple[str, dict[str, dict[str, str]]]:
    """The text of a docstring without its sections, and the entries of each section by name; Returns has one."""
    text, *blocks = re.split(r"^(Args|Attributes|Returns|Raises):\n", docstring, flags=re.MULTILINE)
    sections: dict[str, dict[str, str]] = {}
    for title, block in zip(blocks[::2], blocks[1::2], strict=True):
        _, *found = (
            ["", "", block] if title == "Returns" else re.split(r"^    (\w[\w, ]*): ", block, flags=re.MULTILINE)
        )
        sections[title] = {}
        for names, meaning in zip(found[::2], found[1::2], strict=True):
            sections[title] |= dict.fromkeys(names.split(", "), " ".join(meaning.split()))
    return text.strip(), sections


def _compare(where: str, names: list[str], entries: dict[str, str]) -> None:
    if names != list(entries):
        raise ValueError(f"{where} has {', '.join(names)}; its docstring has {', '.join(entries) or 'none'}")


def _type(annotation: Any) -> str:
    """A type without the modules."""
    shown = annotation if isinstance(annotation, str) else inspect.formatannotation(annotation)
    return re.sub(r"\b(?:[a-z_]+\.)+(?=\w)", "", shown)


def _scenes_page() -> str:
    parts = [SCENES]
    titles = {made: title for title, made in TABLES.items()}
    for title, made in TABLES.items():
        meanings = key_descriptions(made)
        base = next((base for base in made.__mro__[1:] if base in titles), None)
        fields = {key: field for key, field in made.model_fields.items() if not base or key not in base.model_fields}
        rows = [_row(key, field, meanings[key]) for key, field in fields.items() if _has_row(field)]
        text = " ".join((made.__doc__ or "").split())
        head = ["| key | value, default | |\n|---|---|---|"] if rows else []
        link = [f"Has the keys of a [{titles[base]}](#{titles[base].replace(' ', '-')}), too.\n"] if base else []
        parts.append("\n".join([f"## {title}\n\n{text}\n", *link, *head, *rows]))
    return _joined(parts)


def _row(key: str, field: FieldInfo, meaning: str) -> str:
    if field.is_required():
        default = ", required"
    elif field.default is None:
        default = ""
    elif isinstance(field.default, bool):
        default = f", `{str(field.default).lower()}`"
    else:
        default = f", `{list(field.default) if isinstance(field.default, tuple) else field.default}`"
    text = " ".join(meaning.split()).replace("|", chr(92) + "|")
    return f"| `{key}` | {_kind(field.annotation)}{default.replace(', ``', ', empty')} | {text} |"


def _kind(annotation: Any) -> str:
    """A type in TOML's words."""
    if annotation in (float, int, str, bool):
        return {float: "number", int: "integer", str: "string", bool: "boolean"}[annotation]
    arguments = [argument for argument in get_args(annotation) if argument is not type(None)]
    origin = get_origin(annotation)
    if origin is tuple:
        kinds = [_kind(argument) for argument in arguments]
        alike = len(set(kinds)) == 1 and not kinds[0].startswith("[")
        return f"[{len(kinds)} {kinds[0]}s]" if alike else f"[{', '.join(kinds)}]"
    if origin is list:
        inner = _kind(arguments[0])
        return f"[any of {inner}]" if inner.startswith('"') else f"[{inner}, ...]"
    if origin is dict:
        return "table"
    if origin is UnionType:
        return " or ".join(map(_kind, arguments))
    if arguments and all(isinstance(argument, str) for argument in arguments):
        return ", ".join(f'"{argument}"' for argument in arguments)
    return _kind(arguments[0]) if arguments else "table"


def _has_row(field: FieldInfo) -> bool:
    """Whether a key must be there, or the reference has no heading of its own for what it holds."""
    inner = [field.annotation, *get_args(field.annotation)]
    listed = any(argument in TABLES.values() for argument in inner if isinstance(argument, type))
    return field.is_required() or not listed


if __name__ == "__main__":
    for name, text in pages().items():
        (FOLDER / name).write_text(text, encoding="utf-8")
        print(FOLDER / name, file=sys.stderr)
