"""One mesh to be made: what of, how fine; and what came of it."""

import time
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from taichisoft.errors import MeshError
from taichisoft.meshes.volume_mesh import VolumeMesh
from taichisoft.plugin_system.geometry import Geometry
from taichisoft_meshing.geometry_file import make_geometry
from taichisoft_meshing.mesh_request import mesh_as_asked
from taichisoft_meshing.quality.check import cautions, faults, missed_limits
from taichisoft_meshing.quality.limits import QualityLimits, quality_limits
from taichisoft_meshing.quality.mesh_quality import MeshQuality, measure


@dataclass(frozen=True)
class MeshJob:
    """Plain data, so that it can be sent to another process.

    Attributes:
        kind: of geometry.
        tables: of the geometry, with what was overridden.
        file: that the tables are from; begins every error, and files that the tables name are looked for beside it.
        asked: `size` [mm], `preset` or `nodes`; empty for the geometry's own size.
    """

    kind: Any
    tables: Mapping[str, Any]
    file: Path
    asked: Mapping[str, Any]


@dataclass(frozen=True)
class MadeMesh:
    """A mesh with its figures.

    Attributes:
        job: what it was made from.
        geometry: as its kind understood it.
        mesh: fit to be read by a simulation.
        quality: its figures.
        limits: that the geometry file sets to them.
        remarks: what was warned of while it was made, and what its quality gives reason to, one line each.
        seconds: that gmsh took [s].
    """

    job: MeshJob
    geometry: Geometry
    mesh: VolumeMesh
    quality: MeshQuality
    limits: QualityLimits
    remarks: tuple[str, ...]
    seconds: float

    @property
    def problems(self) -> list[str]:
        """Faults and missed limits, one line each."""
        return faults(self.quality) + missed_limits(self.quality, self.limits)


def make_mesh(job: MeshJob, stage: Callable[[str], None] = lambda name: None) -> MadeMesh:
    """Make a mesh and measure it; `stage` is called with the name of each stage that begins.

    Raises:
        MeshError: something in the tables is not valid, or they cannot be meshed.
        PluginError: the plug-in of the kind failed.
    """
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        geometry = make_geometry(job.kind, job.tables, job.file)
        stage("meshing")
        start = time.perf_counter()
        mesh = mesh_as_asked(geometry, job.file, **job.asked)
        seconds = time.perf_counter() - start
    stage("measuring")
    quality = measure(mesh)
    said = dict.fromkeys(" ".join(str(warning.message).split()) for warning in warned)
    limits = quality_limits(job.tables, job.file)
    return MadeMesh(job, geometry, mesh, quality, limits, (*said, *cautions(quality)), seconds)


def require_fit(made: MadeMesh) -> None:
    """Raise MeshError, which names the first problem, when there is one."""
    if made.problems:
        first, *others = made.problems
        more = f" (and {len(others)} more)" if others else ""
        raise MeshError(f"{made.job.file}: {first}{more}; try another size, or --force writes the mesh all the same")
