"""Validation of a controller's settings against the arguments of its factory, before a run."""

import dataclasses
import functools
import inspect
import operator
import types
from collections.abc import Callable, Mapping
from typing import Any, Union, get_args, get_origin, get_type_hints

import pydantic
import pydantic_core

from taichisoft.errors import SceneError, nearest
from taichisoft.scenes.validation_errors import first_problem, short_text

PREFIX = "controller.settings"
NUMBER = int | float
NAMED = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)


def checked_arguments(factory: Callable[..., Any], settings: Mapping[str, Any]) -> dict[str, Any]:
    """Validate settings, and return the arguments for the factory of a controller.

    The settings are the factory's arguments by name, or the fields of its only argument if that is annotated with a
    dataclass or a pydantic model. Each must be of the annotated type, as TOML and JSON write it: a list for a tuple,
    text for a path, but not text for a number. Without an annotation, a numeric default requires a number.

    Raises:
        SceneError: a key is unknown or missing, or a value is of another type.
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
    """Make an object of a dataclass or a pydantic model with these fields."""
    if dataclasses.is_dataclass(kind):
        _refuse_unknown(settings, [field.name for field in dataclasses.fields(kind) if field.init])
    elif kind.model_config.get("extra") != "allow":
        _refuse_unknown(settings, [field.alias or name for name, field in kind.model_fields.items()])
    return _checked(pydantic.TypeAdapter(kind), PREFIX, dict(settings))


def _checked_argument(name: str, kind: Any, value: Any) -> Any:
    key = f"{PREFIX}.{name}"
    kinds = get_args(kind) if get_origin(kind) in (Union, types.UnionType) else ()
    if type(None) in kinds and value is not None:  # the error then names the required type
        kind = functools.reduce(operator.or_, (one for one in kinds if one is not type(None)))
    try:
        adapter = pydantic.TypeAdapter(kind)
    except (pydantic.PydanticSchemaGenerationError, pydantic.PydanticUserError):  # not a data type
        return value
    try:
        return _checked(adapter, key, value)
    except SceneError as error:
        if get_origin(kind) not in (Union, types.UnionType):
            raise
        wanted = "a number" if kind == NUMBER else inspect.formatannotation(kind)
        raise SceneError(f"{key} = {short_text(value)}: must be {wanted}") from error


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
    """Convert a value to the adapter's type.

    Raises:
        SceneError: the value is of another type.
    """
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
