"""The variants of a sweep of meshes, how each is made, and the table of their figures."""

import csv
import json
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

from rich.table import Table

from taichisoft.base import atomic_file, plain
from taichisoft.errors import MeshError, TaichisoftError
from taichisoft_meshing.mesh_commands import overridden
from taichisoft_meshing.mesh_job import MeshJob, make_mesh, require_fit
from taichisoft_meshing.mesh_set import RECORD, move_set, write_files
from taichisoft_studies.run_job import partial_folder
from taichisoft_studies.study_file import Values, combinations, toml_value

SUMMARY = "summary.csv"
NOT_PRINTED = ("tetrahedra", "folder", "problem")


@dataclass(frozen=True)
class Variant:
    """One mesh of a sweep.

    Attributes:
        values: the values that replace the file's values, as text, by key.
        job: the request for the mesh.
    """

    values: dict[str, str]
    job: MeshJob

    @property
    def name(self) -> str:
        """The name of its folder, for example "wall-1.5_body.width-20": without what a path or a shell would read."""
        return "_".join(
            f"{key}-{''.join(letter if letter.isalnum() or letter in '.+-' else '_' for letter in value).strip('_')}"
            for key, value in self.values.items()
        )


def plan(job: MeshJob, varied: Mapping[str, Values]) -> list[Variant]:
    """All combinations of the values of keys, the last key's values changing fastest."""
    variants = []
    for chosen in combinations(varied, None, 0):
        texts = {key: value if isinstance(value, str) else toml_value(value) for key, value in chosen.items()}
        tables = overridden(job.tables, [f"{key}={toml_value(value)}" for key, value in chosen.items()])
        variants.append(Variant(texts, replace(job, tables=tables)))
    names = [variant.name for variant in variants]
    clash = next((name for index, name in enumerate(names) if name in names[:index]), None)
    if clash is not None:
        raise MeshError(f"--vary: two variants would both be called '{clash}'")
    return variants


@dataclass(frozen=True)
class MeshRun:
    """A mesh to be made, as plain data that can be sent to another machine.

    Attributes:
        name: name of its folder, and of the files in it.
        folder: absolute path of the folder that holds the folders of all variants.
        job: the request for the mesh, with an absolute path of its file.
        force: whether a mesh that misses a limit is written all the same.
        plugins: paths of the plug-ins that it needs.
        time_limit: longest time that it may take [s].
    """

    name: str
    folder: str
    job: MeshJob
    force: bool
    plugins: tuple[str, ...]
    time_limit: float
    needs_engine: ClassVar = False

    def make(self) -> dict[str, Any]:
        """Write the mesh to its folder, unless it is there, and return its "problem", "figures" and "remarks"."""
        place, partial = Path(self.folder) / self.name, partial_folder(Path(self.folder), self.name)
        try:
            record = _read_record(place / RECORD)
            if record is not None and _is_of(record, self.job) and (self.force or not record["problems"]):
                return _outcome(_figures(record), [*record["remarks"], *record["problems"]])
            made = make_mesh(self.job)
            if not self.force:
                require_fit(made, "--force writes the mesh all the same")
            shutil.rmtree(partial, ignore_errors=True)
            partial.mkdir(parents=True)
            write_files(made, partial, self.name)
            record = _read_record(partial / RECORD)
            assert record is not None
            move_set(partial, place)
            figures = {**_figures(record), "seconds": round(made.seconds, 2)}
            return _outcome(figures, [*made.remarks, *made.problems])
        except TaichisoftError as error:
            return _outcome(problem=" ".join(str(error).split()))
        except Exception as error:  # a plug-in's mesh that cannot be measured, a disk that is full
            return _outcome(problem=f"{self.job.file}: {type(error).__name__}: {' '.join(str(error).split())}")
        finally:
            shutil.rmtree(partial, ignore_errors=True)

    def lost(self, status: str, message: str) -> dict[str, Any]:
        """The outcome of a mesh whose process was lost."""
        self.clean()
        return _outcome(problem=f"{self.job.file}: {status}: {message}")

    def clean(self) -> None:
        """Remove what unfinished attempts at the mesh have left."""
        for partial in Path(self.folder).glob(f".{self.name}.*.partial"):
            shutil.rmtree(partial, ignore_errors=True)


def _outcome(figures: Mapping[str, Any] = {}, remarks: Sequence[str] = (), problem: str = "") -> dict[str, Any]:
    return {"problem": problem, "figures": dict(figures), "remarks": list(remarks)}


def _read_record(path: Path) -> Any:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None


def _is_of(record: Any, job: MeshJob) -> bool:
    """Whether a record is that of this very mesh."""
    try:
        return record["inputs_sha256"] is not None and record["inputs_sha256"] == job.fingerprint()
    except (KeyError, TypeError, OSError):
        return False


def _figures(record: Any) -> dict[str, Any]:
    """What the summary of a sweep says about a mesh."""
    counts, volumes, quality = record["counts"], record["volumes_mm3"], record["quality"]
    return {
        **counts,
        **{f"{name}_mm3": volume for name, volume in volumes.items() if name != "outer"},
        "smallest_radius_ratio": quality["radius_ratio"]["smallest"],
        "elements_across_walls": quality["elements_across_walls"],
    }


def summary_rows(variants: Sequence[Variant], outcomes: Sequence[Mapping[str, Any]]) -> list[dict[str, str]]:
    """A row for each variant: the values that were varied, the figures, the folder, and the problem if it failed."""
    columns = dict.fromkeys(column for outcome in outcomes for column in outcome["figures"])
    rows = []
    for variant, outcome in zip(variants, outcomes, strict=True):
        values = [(column, outcome["figures"].get(column)) for column in columns]
        figures = {column: "" if value is None else f"{value:.10g}" for column, value in values}
        folder = "" if outcome["problem"] else variant.name
        rows.append({**variant.values, **figures, "folder": folder, "problem": outcome["problem"]})
    return rows


def write_summary(rows: Sequence[Mapping[str, str]], folder: Path) -> Path:
    """Write the rows to a CSV file."""
    path = folder / SUMMARY
    with atomic_file(path, MeshError) as partial, partial.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    return path


def summary_table(rows: Sequence[Mapping[str, str]], title: str) -> Table:
    """The rows as a table for the terminal; problems are printed in lines of their own."""
    columns = [column for column in rows[0] if column not in NOT_PRINTED]
    table = Table(title=plain(title))
    for column in columns:
        words = column.replace("_mm3", " [mm³]").replace("_", " ")
        table.add_column(plain(words), justify="right", min_width=max(len(plain(row[column])) for row in rows))
    table.add_column("", min_width=len("failed"))
    for row in rows:
        table.add_row(*(plain(row[column]) for column in columns), "failed" if row["problem"] else "")
    return table
