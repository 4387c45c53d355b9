"""Scenes in the formats that plug-ins read, with their materials and additions; controllers and outputs by name."""

import copy
import dataclasses
import functools
import inspect
import operator
import types
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Union, get_args, get_origin, get_type_hints

import pydantic
import pydantic_core

from taichisoft.base.files import read_toml
from taichisoft.control.control import Controller
from taichisoft.errors import PluginError, SceneError, TaichisoftError, nearest
from taichisoft.running.hooks import find, provided
from taichisoft.running.plugins import failures_of
from taichisoft.running.session import Output, require_base
from taichisoft.scene import file as scene_tables
from taichisoft.scene.file import change_scene
from taichisoft.scene.scene import Scene
from taichisoft.scene.shipped import data_folder, find_file
from taichisoft.scene.soft_body import SoftBodySettings
from taichisoft.scene.table import first_problem, short_text

# Materials that plug-ins provide by name, filled into a scene's tables in place of their names.


def fill_in_materials(document: dict[str, Any]) -> None:
    """Replace names of plug-ins' materials in soft bodies and regions by the materials; other names stay."""
    named = [table for table in _tables(document) if isinstance(table.get("material"), str)]
    if not named:
        return  # without names, no plug-in is loaded
    materials = provided("material")
    for table in named:
        if table["material"] in materials:
            table["material"] = dict(materials[table["material"]])


def _tables(document: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Tables of soft bodies and regions; values that are not tables are refused later, with their keys."""
    bodies = document.get("soft_bodies")
    for body in bodies.values() if isinstance(bodies, dict) else ():
        regions = body.get("regions") if isinstance(body, dict) else None
        tables = [body, *(regions if isinstance(regions, list) else [])]
        yield from (table for table in tables if isinstance(table, dict))


# A scene whose soft bodies move by modes, found in a folder.

SUFFIX = ".npz"
# Keys in which copies of a body may differ: where they are, how they look, and what is not part of their elasticity.
OWN_KEYS = {"rotation", "translation", "velocity", "colour", "axes", "tip"}
OWN_KEYS |= {"collides", "self_contact", "reduced", "cavities", "cables"}


def with_reduced_bodies(scene: Scene, folder: Path, key: str = "--reduced") -> Scene:
    """Let every soft body that has a file of modes move by them.

    Args:
        scene: the scene.
        folder: with a file BODY.npz for each shape of body, or the name of a shipped one; a body without a file takes
            that of a body which it is a copy of.
        key: what names the folder, for messages.

    Raises:
        SceneError: no such folder, or none of its files is that of a soft body.
    """
    if not folder.is_dir():
        shipped = {path.name: path for path in (data_folder() / "reduced").glob("*")}
        if str(folder) not in shipped:
            raise SceneError(
                f"{key} {folder}: no such folder, and no shipped one ({', '.join(sorted(shipped))}); "
                f"`taichisoft reduce SCENE -o {folder}` writes it"
            )
        folder = shipped[str(folder)]
    files = {name: folder / f"{name}{SUFFIX}" for name in scene.soft_bodies}
    own = {name: file.resolve() for name, file in files.items() if file.is_file()}
    if not own:
        present = ", ".join(sorted(file.name for file in folder.glob(f"*{SUFFIX}"))) or "none"
        valid = ", ".join(f"{name}{SUFFIX}" for name in scene.soft_bodies) or "none: the scene has no soft bodies"
        raise SceneError(f"{key} {folder}: has no modes of a soft body ({valid}); files there: {present}")
    bodies = {}
    for name, body in scene.soft_bodies.items():
        originals = (other for other in (name, *own) if other in own and _is_copy(scene.soft_bodies[other], body))
        original = next(originals, None)
        bodies[name] = body if original is None else body.model_copy(update={"reduced": str(own[original])})
    return scene.model_copy(update={"soft_bodies": bodies})


def _is_copy(first: SoftBodySettings, second: SoftBodySettings) -> bool:
    return first.model_dump(exclude=OWN_KEYS) == second.model_dump(exclude=OWN_KEYS)


# Tables that a scene's controller adds to it, such as the links of the arm that carries the gripper.


def add_tables_of_controller(document: dict[str, Any], source: str, folder: Path) -> None:
    """Add the tables of the plug-in that belongs to the scene's controller; what the scene itself has stays.

    Args:
        document: tables of the scene, which are changed.
        source: name of the document, with which every error begins.
        folder: folder in which the plug-in looks for files first.
    """
    controller = document.get("controller")
    name = controller.get("name") if isinstance(controller, dict) else None
    if not isinstance(name, str):
        return  # refused later, with its key
    additions = provided("scene addition")
    if name not in additions:
        return
    settings = controller.get("settings", {}) if isinstance(controller, dict) else {}
    try:
        with failures_of(f"what the controller '{name}' adds to the scene failed"):
            tables = additions[name](settings, folder)
    except PluginError:
        raise
    except TaichisoftError as error:
        raise SceneError(f"{source}: {error}") from error
    for key, added in tables.items():
        present = document.setdefault(key, {})
        if isinstance(present, Mapping):
            document[key] = {**present, **{name: table for name, table in added.items() if name not in present}}


# Validation of a controller's settings against the arguments of its factory, before a run.

PREFIX = "controller.settings"
NUMBER = int | float
NAMED = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)


def checked_arguments(factory: Callable[..., Any], settings: Mapping[str, Any]) -> dict[str, Any]:
    """Validate settings, and return the arguments for the factory of a controller.

    The settings are the factory's arguments by name, or the fields of its only argument if that is annotated with a
    dataclass or a pydantic model. Each must be of the annotated type, as TOML and JSON write it: a list for a tuple,
    text for a path, but not text for a number. Without an annotation, a numeric default requires a number.
    """
    arguments = inspect.signature(factory).parameters
    named = {name: argument for name, argument in arguments.items() if argument.kind in NAMED}
    kinds = {name: _kind(argument, factory) for name, argument in named.items()}
    if len(arguments) == len(named) == 1:
        ((name, kind),) = kinds.items()
        if dataclasses.is_dataclass(kind) or _is_model(kind):
            return {name: _checked_fields(kind, settings)}
    if not any(argument.kind is argument.VAR_KEYWORD for argument in arguments.values()):
        _refuse_unknown(settings, list(named))
    for name, argument in named.items():
        if argument.default is argument.empty and name not in settings:
            raise SceneError(f"{PREFIX}.{name}: this key is missing")
    return {name: _checked_argument(name, kinds.get(name, Any), value) for name, value in settings.items()}


def _checked_fields(kind: Any, settings: Mapping[str, Any]) -> Any:
    if dataclasses.is_dataclass(kind):
        _refuse_unknown(settings, [field.name for field in dataclasses.fields(kind) if field.init])
    elif kind.model_config.get("extra") != "allow":
        _refuse_unknown(settings, [field.alias or name for name, field in kind.model_fields.items()])
    return _checked(pydantic.TypeAdapter(kind), PREFIX, dict(settings))


def _checked_argument(name: str, kind: Any, value: Any) -> Any:
    key = f"{PREFIX}.{name}"
    kinds = get_args(kind) if get_origin(kind) in (Union, types.UnionType) else ()
    if type(None) in kinds and value is not None:  # the error then names the required type
        kind = functools.reduce(operator.or_, (part for part in kinds if part is not type(None)))
    try:
        adapter = pydantic.TypeAdapter(kind)
    except (pydantic.PydanticSchemaGenerationError, pydantic.PydanticUserError):  # not a data type
        return value
    try:
        return _checked(adapter, key, value)
    except SceneError as error:
        if get_origin(kind) not in (Union, types.UnionType):
            raise
        valid = "a number" if kind == NUMBER else inspect.formatannotation(kind)
        raise SceneError(f"{key} = {short_text(value)}: must be {valid}") from error


def _refuse_unknown(settings: Mapping[str, Any], valid: list[str]) -> None:
    for key in settings:
        if key not in valid:
            raise SceneError(f"{PREFIX}.{key}: unknown key; {nearest(key, valid, 'valid keys')}")


def _kind(argument: inspect.Parameter, factory: Callable[..., Any]) -> Any:
    """Type of an argument; Any without an annotation, or if only type checkers can resolve it."""
    if argument.annotation is argument.empty:
        is_number = isinstance(argument.default, int | float) and not isinstance(argument.default, bool)
        return NUMBER if is_number else Any
    function = factory.func if isinstance(factory, functools.partial) else factory
    function = inspect.unwrap(function.__init__ if isinstance(function, type) else function)  # type: ignore[misc]
    annotated = types.SimpleNamespace(__annotations__={argument.name: argument.annotation})
    try:
        hints = get_type_hints(annotated, getattr(function, "__globals__", {}), include_extras=True)
    except (NameError, AttributeError, TypeError, SyntaxError):
        return Any
    return hints[argument.name]


def _checked(adapter: "pydantic.TypeAdapter[Any]", key: str, value: Any) -> Any:
    try:
        return adapter.validate_python(value, strict=True)
    except pydantic.ValidationError as error:
        problem = error
    try:
        return adapter.validate_json(pydantic_core.to_json(value, inf_nan_mode="constants"), strict=True)
    except pydantic.ValidationError as error:
        problem = error
    except pydantic_core.PydanticSerializationError:  # an object that cannot be in a file
        pass
    raise SceneError(first_problem(problem, pydantic.BaseModel, key)) from problem


def _is_model(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, pydantic.BaseModel)


# Construction of the controller and the outputs of a run, which plug-ins provide by name.


def make_controller(scene: Scene) -> Controller:
    """Make the controller that a scene names, with the settings of the scene.

    Args:
        scene: scene with a `[controller]`.

    Raises:
        SceneError: the scene has no controller, or its settings are not valid.
        PluginError: no plug-in provides the controller, or it cannot be made.
    """
    if scene.controller is None:
        raise SceneError("there is no [controller]; name one with --controller")
    name, settings = scene.controller.name, scene.controller.settings
    factory = find("controller", name)
    with failures_of(f"controller '{name}' cannot be made"):
        made: Controller = factory(**checked_arguments(factory, settings))
    return require_base(made, Controller)


def make_output(name: str, folder: str | Path, **settings: Any) -> Output:
    """Make an output by its name, such as "recording".

    Args:
        name: name under which a plug-in provides the output.
        folder: output folder of the run, into which the output may write.
        settings: further arguments of the output.

    Raises:
        PluginError: no plug-in provides it, or it cannot be made.
    """
    factory = find("output", name)
    with failures_of(f"output '{name}' cannot be made"):
        made: Output = factory(Path(folder), **settings)
    return require_base(made, Output)


# Scenes in the formats that plug-ins read; TOML is the engine's own.

TOML = ".toml"


def load_scene(
    name: str | Path,
    overrides: Sequence[str] = (),
    controller: str | None = None,
    reader_settings: Mapping[str, Any] | None = None,
    goal: str | None = None,
) -> Scene:
    """Read a scene by path or by the name of a shipped scene; relative file names in it become absolute paths.

    The file is TOML unless a plug-in reads files with its suffix.

    Args:
        name: path or name.
        overrides: "key.key=value" with TOML values, applied before inheritance and validation.
        controller: name of a controller that replaces the scene's own and its settings.
        reader_settings: arguments of the plug-in's reader of this format, by name.
        goal: kind of goal that replaces the scene's own, or "none".

    Raises:
        SceneError: the file is missing or cannot be read, or the scene or a setting is not valid.
        PluginError: the plug-in that reads the format failed.
    """
    if isinstance(overrides, str) or not isinstance(overrides, Sequence):
        raise SceneError(f'overrides = {overrides!r}: must be a list of texts, such as ["contact.friction=0.3"]')
    path = _find_scene(name)
    document = _read_tables(path, reader_settings or {})
    change_scene(document, overrides, controller, goal)
    fill_in_materials(document)
    source = " with --set ".join([str(path), *overrides])  # the error may be in the file or in an override
    add_tables_of_controller(document, source, path.parent)
    return scene_tables.scene_from_dict(document, source, folder=path.parent)


def scene_from_dict(document: Mapping[str, Any], source: str = "scene", folder: Path | None = None) -> Scene:
    """Make a scene from plain tables, as parsed from TOML; it may name materials of plug-ins, as in `load_scene`.

    Args:
        document: tables of the scene by key; relative file names in it become absolute paths.
        source: name of the document, with which every error message begins.
        folder: folder in which files are searched first; None: the current folder.

    Raises:
        SceneError: a value is not valid; the message has the key, the value and the valid values.
        PluginError: two plug-ins provide the same material, or a material is not valid.
    """
    tables = copy.deepcopy(dict(document))  # the caller's document is not changed
    fill_in_materials(tables)
    add_tables_of_controller(tables, source, folder or Path())
    return scene_tables.scene_from_dict(tables, source, folder)


def _find_scene(name: str | Path) -> Path:
    try:
        return find_file(name, "scenes", (TOML,), error=SceneError)
    except SceneError:
        suffixes = list(_scene_readers())  # loaded only now: a TOML file needs no plug-in
        if not suffixes:
            raise
        return find_file(name, "scenes", (TOML, *suffixes), error=SceneError)


def _read_tables(path: Path, settings: Mapping[str, Any]) -> dict[str, Any]:
    """Read the tables of a scene by a plug-in for the file's suffix, or else as TOML."""
    suffix = path.suffix.lower()
    reader = _scene_readers().get(suffix) if suffix != TOML else None
    _check_settings(path, reader, settings)
    if reader is None:
        try:
            return read_toml(path)
        except (ValueError, OSError) as error:
            raise SceneError(f"{path}: not readable as TOML: {error}") from error
    with failures_of(f"{path}: scene reader '{suffix}' failed"):
        tables = reader(path, **settings)
    if not isinstance(tables, Mapping):
        raise PluginError(f"{path}: scene reader '{suffix}' returned {tables!r}; must be a mapping of tables")
    return copy.deepcopy(dict(tables))  # overrides change the tables


def _check_settings(path: Path, reader: Callable[..., Any] | None, settings: Mapping[str, Any]) -> None:
    valid = list(inspect.signature(reader).parameters)[1:] if reader is not None else []
    for name in settings:
        if name not in valid:
            raise SceneError(
                f"{path}: {name} has no effect on a {path.suffix} scene; {nearest(name, valid, 'settings')}"
            )


def _scene_readers() -> Mapping[str, Any]:
    readers = provided("scene reader")
    for suffix in readers:
        if suffix == TOML or suffix != f".{suffix.strip('.').lower()}":
            problem = "TOML is read without a plug-in" if suffix == TOML else "must look like '.yaml', in small letters"
            raise PluginError(f"scene reader '{suffix}': {problem}")
    return readers
