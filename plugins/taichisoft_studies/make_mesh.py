"""A run that ends at the mesh: one variant of a geometry, meshed into a folder."""

import json
import shutil
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from taichisoft.errors import TaichisoftError
from taichisoft_studies.unfinished import partial_folder


@dataclass(frozen=True)
class MeshRun:
    """A mesh to be made, as plain data that can be sent to another machine.

    Attributes:
        name: name of its folder, and of the files in it.
        folder: absolute path of the folder that holds the folders of all variants.
        geometry: the attributes of `taichisoft_meshing.mesh_job.MeshJob`, the file as text.
        force: whether a mesh that misses a limit is written all the same.
        plugins: paths of the plug-ins that it needs.
        time_limit: longest time that it may take [s].
    """

    name: str
    folder: str
    geometry: Mapping[str, Any]
    force: bool
    plugins: tuple[str, ...]
    time_limit: float

    def to_json(self) -> str:
        """As text, in one line."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> "MeshRun":
        """What `to_json` wrote."""
        values = json.loads(text)
        return cls(**{**values, "plugins": tuple(values["plugins"])})

    @property
    def place(self) -> Path:
        """Its folder."""
        return Path(self.folder) / self.name


def make_variant(run: MeshRun) -> dict[str, Any]:
    """Write a mesh to its folder, unless it lies there, and return its "problem", "figures" and "remarks"."""
    from taichisoft_meshing.mesh_job import MeshJob, make_mesh, require_fit
    from taichisoft_meshing.mesh_set import RECORD, move_set, write_files

    job = MeshJob(**{**run.geometry, "file": Path(run.geometry["file"])})
    partial = partial_folder(Path(run.folder), run.name)
    try:
        record = _record(run.place / RECORD)
        if record is not None and _is_of(record, job) and (run.force or not record["problems"]):
            return {"problem": "", "figures": _figures(record), "remarks": record["remarks"] + record["problems"]}
        made = make_mesh(job)
        if not run.force:
            require_fit(made, "--force writes the mesh all the same")
        shutil.rmtree(partial, ignore_errors=True)
        partial.mkdir(parents=True)
        write_files(made, partial, run.name)
        record = _record(partial / RECORD)
        assert record is not None
        move_set(partial, run.place)
        figures = {**_figures(record), "seconds": round(made.seconds, 2)}
        return {"problem": "", "figures": figures, "remarks": [*made.remarks, *made.problems]}
    except TaichisoftError as error:
        return {"problem": " ".join(str(error).split()), "figures": {}, "remarks": []}
    except Exception as error:  # a plug-in's mesh that cannot be measured, a disk that is full
        problem = f"{job.file}: {type(error).__name__}: {' '.join(str(error).split())}"
        return {"problem": problem, "figures": {}, "remarks": []}
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def mesh_failure(run: MeshRun, problem: str) -> dict[str, Any]:
    """The outcome of a mesh whose process was ended, and nothing left of it."""
    for partial in Path(run.folder).glob(f".{run.name}.*.partial"):
        shutil.rmtree(partial, ignore_errors=True)
    return {"problem": f"{run.geometry['file']}: {problem}", "figures": {}, "remarks": []}


def _record(path: Path) -> Any:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None


def _is_of(record: Any, job: Any) -> bool:
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
