"""Errors of pydantic as one line for the user: key, value, and what would be valid."""

import re
from collections.abc import Sequence
from typing import Any, get_args, get_origin

from pydantic import BaseModel, Tag, ValidationError

from taichisoft.errors import nearest

LONGEST_VALUE = 80  # of a value that is shown: a line must stay readable when the value is a whole table


def first_problem(error: ValidationError, table: type[BaseModel], prefix: str = "") -> str:
    """One line for the first problem, and how many more there are.

    Args:
        error: error of checking data against `table`.
        table: table in which the valid keys are looked up.
        prefix: text before every key, for data that is itself part of something ("controller.settings").
    """
    problems = error.errors()
    # A misspelt key that must be there gives two problems, of which the unknown key is the cause.
    problem = min(problems, key=lambda found: found["type"] != "extra_forbidden")
    more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
    return _describe(problem, problems, table, prefix) + more


def _describe(problem: Any, problems: Sequence[Any], table: type[BaseModel], prefix: str) -> str:
    path = problem["loc"]
    # Where a key takes values of several kinds, pydantic names the kind; the tables give them names in brackets.
    location = tuple(part for part in path if not str(part).startswith("<"))
    named = location[:-1] if location[-1:] == ("[key]",) else location  # the entry, of whose name pydantic speaks
    key = ".".join([prefix] * bool(prefix) + [str(part) for part in named])
    value = f"{key} = {short_text(problem['input'])}"
    match problem["type"]:
        case "extra_forbidden":
            return f"{key}: unknown key; {nearest(str(location[-1]), _valid_keys(table, path[:-1]), 'valid keys')}"
        case "string_pattern_mismatch" if location[-1] == "[key]":  # pydantic's mark for the name of an entry
            name, table_key = problem["input"], ".".join(str(part) for part in location[:-2])
            if not name.isprintable():
                return f"{table_key} has a {name!r}: a name must not contain control characters"
            return f"{table_key} has a '{name}': a name must not be empty nor contain any of . | /"
        case "string_too_long" if location[-1] == "[key]":
            table_key, most = ".".join(str(part) for part in location[:-2]), problem["ctx"]["max_length"]
            return f"{table_key} has a '{problem['input'][:20]}...': a name must not be longer than {most} characters"
        case "literal_error" if location[-1:] == ("[key]",):
            valid = [part.strip("' ") for part in re.split(", | or ", problem["ctx"]["expected"])]
            return f"{key}: unknown name; {nearest(problem['input'], valid, 'valid names')}"
        case "missing" if isinstance(location[-1], int):  # the entries that a list of fixed length lacks
            absent = [found for found in problems if found["type"] == "missing" and found["loc"][:-1] == path[:-1]]
            given = len(problem["input"])
            parent = key.rpartition(".")[0]
            return f"{parent} = {short_text(problem['input'])}: has {given} values; {given + len(absent)} are needed"
        case "missing":
            return f"{key}: this key is missing"
        case "too_long" if "max_length" in problem["ctx"]:
            return f"{value}: has {problem['ctx']['actual_length']} values; {problem['ctx']['max_length']} are needed"
        case "too_short":
            return f"{value}: at least {problem['ctx']['min_length']} is needed"
        case "model_type" | "dict_type":
            in_list = any(isinstance(part, int) for part in location)
            return f"{value}: must be a table" + ("" if in_list else f", [{key}]")
        case "list_type" | "tuple_type":
            return f"{value}: must be a list"
        case "value_error":  # a rule of the table's own, mostly between several keys: the message names the values
            return f"{key + ': ' if key else ''}{problem['msg'].removeprefix('Value error, ')}"
        case _:
            return f"{value}: {problem['msg'][0].lower()}{problem['msg'][1:]}"


def short_text(value: Any) -> str:
    """A value as a line shows it."""
    text = repr(value)
    return text if len(text) <= LONGEST_VALUE else text[: LONGEST_VALUE - 3] + "..."


def _valid_keys(table: type[BaseModel], path: Sequence[Any]) -> list[str]:
    """The keys of the table that `path` leads to."""
    annotation: Any = table
    for part in path:
        annotation = _inside(annotation, part)
    found = next((inner for inner in (annotation, *get_args(annotation)) if _is_table(inner)), None)
    return list(found.model_fields) if found is not None else []


def _inside(annotation: Any, part: Any) -> Any:
    """The type of a table's field or of any entry of a dictionary or list; None when there is none."""
    if _is_table(annotation):
        return annotation.model_fields[part].annotation if part in annotation.model_fields else None
    if any(isinstance(mark, Tag) and mark.tag == part for mark in getattr(annotation, "__metadata__", ())):
        return get_args(annotation)[0]
    if get_origin(annotation) in (dict, list):
        return get_args(annotation)[-1]
    return next((found for inner in get_args(annotation) if (found := _inside(inner, part)) is not None), None)


def _is_table(annotation: Any) -> bool:
    return isinstance(annotation, type) and issubclass(annotation, BaseModel)
