"""The variants of a sweep of meshes: every combination of the values that keys of a geometry file are given."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from pydantic import ValidationError

from taichisoft.errors import MeshError
from taichisoft.scenes.validation_errors import first_problem
from taichisoft_meshing.commands.options import overridden
from taichisoft_meshing.mesh_job import MeshJob
from taichisoft_studies.sampling import grid, grid_size
from taichisoft_studies.study_file import MOST, Range
from taichisoft_studies.value_texts import split_values, value_range


@dataclass(frozen=True)
class Variant:
    """One mesh of a sweep.

    Attributes:
        values: the values that replace those of the file, as text, by key.
        job: how it is made.
    """

    values: dict[str, str]
    job: MeshJob

    @property
    def name(self) -> str:
        """The name of its folder, for example "wall-1.5_body.width-20"."""
        return "_".join(f"{key}-{_for_a_file(value)}" for key, value in self.values.items())


def plan(job: MeshJob, varied: Sequence[str]) -> list[Variant]:
    """All combinations of "key=value,value,...", the last key's values changing fastest.

    Raises:
        MeshError: one does not look like that, a key or a value is there twice, or there are too many.
    """
    keys = [_key_and_values(text) for text in varied]
    names = [key for key, _ in keys]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise MeshError(f"--vary {twice}: is given twice; put its values into one list")
    count = math.prod(len(values) for _, values in keys)
    if count > MOST:
        raise MeshError(f"--vary: {count} combinations are more than the {MOST} that a sweep may have")
    variants = []
    for combination in itertools.product(*(values for _, values in keys)):
        chosen = dict(zip(names, combination, strict=True))
        tables = overridden(job.tables, [f"{name}={value}" for name, value in chosen.items()])
        variants.append(Variant(chosen, replace(job, tables=tables)))
    folders = [variant.name for variant in variants]
    if len(set(folders)) < len(folders):
        clash = next(name for name in folders if folders.count(name) > 1)
        raise MeshError(f"--vary: two variants would both be called '{clash}'")
    return variants


def _key_and_values(text: str) -> tuple[str, list[str]]:
    key, separator, values = text.partition("=")
    split = split_values(values)
    if not separator or not key.strip() or not all(split):
        raise MeshError(f"--vary {text}: must look like body.width=20,22,25")
    if len(split) == 1 and ":" in values and not values.startswith('"'):
        split = [repr(value) for value in grid(_range(text, values))]
    if len(set(split)) < len(split):
        raise MeshError(f"--vary {text}: the value {next(v for v in split if split.count(v) > 1)} is there twice")
    return key.strip(), split


def _range(text: str, values: str) -> Range:
    """The range "low:high:count"; `text` is the whole option, for the error."""
    try:
        found = Range(**value_range(text, values))
    except ValidationError as error:
        raise MeshError(f"--vary {text}: {first_problem(error, Range)}") from error
    if found.count is None:
        raise MeshError(f"--vary {text}: a range must look like 20:25:6, lowest, highest and count")
    if grid_size(found) > MOST:
        raise MeshError(f"--vary {text}: {grid_size(found)} values are more than the {MOST} that a sweep may have")
    return found


def _for_a_file(value: str) -> str:
    """Keep letters, digits, points and signs; a folder's name can hold no slash, and a shell no bracket."""
    return "".join(letter if letter.isalnum() or letter in ".+-" else "_" for letter in value).strip("_")
