"""The cases of a benchmark: the tables of cases.toml, checked; sweeps and peers become cases of their own."""

import fnmatch
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, ValidationError, model_validator

from taichisoft.base import read_toml
from taichisoft.errors import nearest
from taichisoft.scene import Positive, Table, first_problem
from taichisoft_benchmarks.errors import BenchmarkError

SHIPPED = Path(__file__).with_name("cases.toml")
QUICK_STEPS = 10

Count = Annotated[int, Field(strict=True, gt=0)]
Window = tuple[Annotated[int, Field(strict=True, ge=0)], Count]
Peer = Literal["mujoco", "mujoco_1000"]


class Case(Table):
    """The keys of all kinds of cases."""

    kind: str
    title: str
    threads: Annotated[int, Field(strict=True, ge=0)] = 0
    """Threads of the engine and of numpy; 0 takes all cores."""
    time_limit: Positive = 1200.0
    """Longest duration of one repetition [s]."""

    quick: ClassVar[dict[str, int]] = {}
    """Largest values of keys in a quick look."""

    def shortened(self) -> Any:
        """The case for a quick look."""
        return self.model_copy(update={key: min(getattr(self, key), most) for key, most in self.quick.items()})


class SceneCase(Case):
    """A case about a shipped scene."""

    scene: str
    """Name of a shipped scene."""
    finger: str
    """Name of the scene's soft body with the mesh; the others are like it."""
    mesh: str = "tutorial-coarse"
    """Name of a shipped mesh; --tutorial-meshes replaces the shipped meshes of the tutorial by the originals."""
    element_size: Positive | None = None
    """Largest element [mm] of a mesh by the project's own mesher, which takes the place of `mesh`."""
    overrides: list[str] = Field(default_factory=list)
    """Changes to the scene, written as for `taichisoft run --set`."""


class Simulated(Table):
    """A case whose steps are timed."""

    steps: Count
    windows: dict[str, Window] = Field(min_length=1)
    """Steps [first, last) by metric; the metric is the median of their times."""

    @model_validator(mode="after")
    def _check_windows(self) -> "Simulated":
        for metric, (first, last) in self.windows.items():
            if not first < last <= self.steps:
                raise ValueError(f"windows.{metric} = [{first}, {last}]: must rise and end within {self.steps} steps")
        return self

    def shortened(self) -> Any:
        """The same start of every window, and a few steps of it."""
        windows = {name: (first, min(last, first + QUICK_STEPS)) for name, (first, last) in self.windows.items()}
        return self.model_copy(update={"windows": windows, "steps": max(last for _, last in windows.values())})


class StepsCase(Simulated, SceneCase):
    """Time per step of a scene."""

    reduced: bool = False
    """Whether soft bodies move by modes, which the case makes when it runs for the first time; peers have all nodes."""
    peers: list[Peer] = Field(default_factory=list)
    """Other programs that do a part of the same job, each as a case NAME_PEER."""
    peer_steps: Count | None = None
    """Steps of the other programs, which stop before the base moves; windows that end later are left out."""


class PeerCase(StepsCase):
    """Time per step of a scene in another program; made from `peers`, not written in cases.toml."""

    peer: Peer


class ContactsCase(Simulated, Case):
    """Time per step of a soft mat that stands on a foot of `foot` x `foot` vertices; the mesh is always the same."""

    foot: Annotated[int, Field(strict=True, ge=2, le=28)]


class FactorisationCase(SceneCase):
    """The sparse Cholesky alone, alternating with CHOLMOD and SuperLU on the same matrix."""

    rounds: Count
    quick: ClassVar[dict[str, int]] = {"rounds": 5}


class StartCase(SceneCase):
    """Time from the start of Python to the first step of a scene."""

    cold: bool = False
    """Whether the cache of compiled kernels is empty."""


class MeshingCase(Case):
    """Time that gmsh takes for the tutorial's finger."""

    preset: str
    """Name of one of the finger's sizes."""


class RecordingCase(SceneCase):
    """Time that recording adds to the steps of a scene; runs alternate between without and with it."""

    steps: Count
    pairs: Count
    quick: ClassVar[dict[str, int]] = {"steps": QUICK_STEPS, "pairs": 1}


KINDS: dict[str, type[Case]] = {
    "steps": StepsCase,
    "contacts": ContactsCase,
    "factorisation": FactorisationCase,
    "start": StartCase,
    "meshing": MeshingCase,
    "recording": RecordingCase,
}


@dataclass(frozen=True)
class NamedCase:
    """A case to run.

    Attributes:
        name: unique name, such as "growth_nodes_400".
        group: table of the file that the case comes from, such as "growth_nodes".
        parameter: keys and values that distinguish it in its group; empty without a sweep.
        case: what to do.
    """

    name: str
    group: str
    parameter: dict[str, Any]
    case: Case


def read_cases(path: Path = SHIPPED) -> list[NamedCase]:
    """All cases of a file, in its order."""
    try:
        document = read_toml(path)
    except (ValueError, OSError) as error:
        raise BenchmarkError(f"{path}: not readable as TOML: {error}") from error
    return cases_from_dict(document, str(path))


def cases_from_dict(document: dict[str, Any], source: str = "cases") -> list[NamedCase]:
    """Cases from plain tables, as TOML gives them; `source` begins every error."""
    cases = [case for group, table in document.items() for case in _expand(group, table, source)]
    names = [case.name for case in cases]
    for name in names:
        if names.count(name) > 1:
            raise BenchmarkError(f"{source}: two cases are called '{name}'; rename a table or an entry of a sweep")
    return cases


def choose(cases: Sequence[NamedCase], patterns: Sequence[str]) -> list[NamedCase]:
    """The cases whose name or group fits one of the patterns (finger_*); all without patterns."""
    for pattern in patterns:
        if not any(_fits(case, pattern) for case in cases):
            valid = sorted({case.name for case in cases} | {case.group for case in cases})
            raise BenchmarkError(f"--case {pattern}: fits no case; {nearest(pattern, valid, 'there are')}")
    return [case for case in cases if not patterns or any(_fits(case, pattern) for pattern in patterns)]


def _fits(case: NamedCase, pattern: str) -> bool:
    return fnmatch.fnmatchcase(case.name, pattern) or fnmatch.fnmatchcase(case.group, pattern)


def _expand(group: str, table: Any, source: str) -> Iterator[NamedCase]:
    """The cases of a table: one, or one per entry of its sweep; each followed by its peers."""
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
            fields = {key: getattr(case, key) for key in StepsCase.model_fields if key != "reduced"}
            yield NamedCase(
                f"{name}_{peer}", f"{group}_{peer}", parameter, PeerCase(**{**fields, "peer": peer, "reduced": False})
            )


def _validate(group: str, table: dict[str, Any], source: str) -> Case:
    kind = table.get("kind")
    if kind not in KINDS:
        raise BenchmarkError(f"{source}: {group}.kind = {kind!r}: {nearest(str(kind), list(KINDS), 'valid kinds')}")
    try:
        return KINDS[kind].model_validate(table)
    except ValidationError as error:
        raise BenchmarkError(f"{source}: {first_problem(error, KINDS[kind], group)}") from error
