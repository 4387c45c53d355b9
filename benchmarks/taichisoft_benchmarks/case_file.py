"""Reading cases.toml: sweeps and peers become cases of their own."""

import fnmatch
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from taichisoft.errors import nearest
from taichisoft.scenes.validation_errors import first_problem
from taichisoft_benchmarks.descriptors import KINDS, Case, PeerCase, StepsCase
from taichisoft_benchmarks.errors import BenchmarkError

SHIPPED = Path(__file__).with_name("cases.toml")


@dataclass(frozen=True)
class NamedCase:
    """A case to run.

    Attributes:
        name: unique, "growth_nodes_400".
        group: the table of the file that it comes from, "growth_nodes".
        parameter: the keys and values that distinguish it in its group; empty without a sweep.
        case: what to do.
    """

    name: str
    group: str
    parameter: dict[str, Any]
    case: Case


def read_cases(path: Path = SHIPPED) -> list[NamedCase]:
    """All cases of a file, in its order.

    Raises:
        BenchmarkError: the file is missing or no TOML, or something in it is not valid.
    """
    try:
        document = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, OSError) as error:
        raise BenchmarkError(f"{path}: not readable as TOML: {error}") from error
    return cases_from_dict(document, str(path))


def cases_from_dict(document: dict[str, Any], source: str = "cases") -> list[NamedCase]:
    """Cases from plain tables, as TOML gives them; `source` begins every error.

    Raises:
        BenchmarkError: something is not valid, with its key, value and what would be; or two cases have one name.
    """
    cases = [case for group, table in document.items() for case in _expand(group, table, source)]
    names = [case.name for case in cases]
    for name in names:
        if names.count(name) > 1:
            raise BenchmarkError(f"{source}: two cases are called '{name}'; rename a table or an entry of a sweep")
    return cases


def choose(cases: Sequence[NamedCase], patterns: Sequence[str]) -> list[NamedCase]:
    """Those whose name or group fits one of the patterns (finger_*); all without patterns.

    Raises:
        BenchmarkError: a pattern fits none.
    """
    for pattern in patterns:
        if not any(_fits(case, pattern) for case in cases):
            valid = sorted({case.name for case in cases} | {case.group for case in cases})
            raise BenchmarkError(f"--case {pattern}: fits no case; {nearest(pattern, valid, 'there are')}")
    return [case for case in cases if not patterns or any(_fits(case, pattern) for pattern in patterns)]


def _fits(case: NamedCase, pattern: str) -> bool:
    return fnmatch.fnmatchcase(case.name, pattern) or fnmatch.fnmatchcase(case.group, pattern)


def _expand(group: str, table: Any, source: str) -> Iterator[NamedCase]:
    if not isinstance(table, dict):
        raise BenchmarkError(f"{source}: {group} = {table!r}: must be a table, [{group}]")
    table = dict(table)
    sweep = table.pop("sweep", None)
    if sweep is None:
        yield from _with_peers(group, group, {}, _validate(group, table, source))
        return
    if not isinstance(sweep, dict) or not all(isinstance(changes, dict) for changes in sweep.values()) or not sweep:
        raise BenchmarkError(f"{source}: {group}.sweep = {sweep!r}: must be tables of keys by the entries' names")
    for label, changes in sweep.items():
        case = _validate(group, {**table, **changes}, source)
        yield from _with_peers(f"{group}_{label}", group, changes, case)


def _with_peers(name: str, group: str, parameter: dict[str, Any], case: Case) -> Iterator[NamedCase]:
    yield NamedCase(name, group, parameter, case)
    if isinstance(case, StepsCase):
        for peer in case.peers:
            fields = {key: getattr(case, key) for key in StepsCase.model_fields}
            yield NamedCase(f"{name}_{peer}", f"{group}_{peer}", parameter, PeerCase(**{**fields, "peer": peer}))


def _validate(group: str, table: dict[str, Any], source: str) -> Case:
    kind = table.get("kind")
    if kind not in KINDS:
        raise BenchmarkError(f"{source}: {group}.kind = {kind!r}: {nearest(str(kind), list(KINDS), 'valid kinds')}")
    case: Case = _check(KINDS[kind], table, group, source)
    return case


def _check(model: Any, table: Any, key: str, source: str) -> Any:
    try:
        return model.model_validate(table)
    except ValidationError as error:
        raise BenchmarkError(f"{source}: {first_problem(error, model, key)}") from error
