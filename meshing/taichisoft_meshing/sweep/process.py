"""The process that makes one variant of a sweep: a crash of gmsh, or its memory, stays its own."""

import signal
import sys
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path

from taichisoft.errors import TaichisoftError
from taichisoft_meshing.mesh_job import MeshJob, make_mesh, require_fit
from taichisoft_meshing.mesh_set import write_files


@dataclass(frozen=True)
class Outcome:
    """What became of a variant.

    Attributes:
        problem: one line; empty when the mesh was made.
        figures: by column of the summary; empty when there is none.
        remarks: one line each.
    """

    problem: str
    figures: dict[str, float | int | None]
    remarks: tuple[str, ...] = ()


def make_variant(job: MeshJob, folder: Path, name: str, force: bool, answer: Connection) -> None:
    """Write all files of a mesh, called `name`, to an empty folder, and answer with an `Outcome`.

    To be run in a process of its own, which leaves it to the one that started it to heed Ctrl and c.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        answer.send(_outcome(job, folder, name, force))
    except Exception as error:  # a plug-in's mesh that cannot be measured, a disk that is full
        answer.send(Outcome(f"{job.file}: {type(error).__name__}: {' '.join(str(error).split())}", {}))


def _outcome(job: MeshJob, folder: Path, name: str, force: bool) -> Outcome:
    from taichisoft.plugin_system.commands import load_requested

    try:
        load_requested(sys.argv[1:])  # the kind may be one of a plug-in that the command line named
        made = make_mesh(job)
        if not force:
            require_fit(made, "--force writes the mesh all the same")
        write_files(made, folder, name)
    except TaichisoftError as error:
        return Outcome(" ".join(str(error).split()), {})
    quality = made.quality
    cavities = {surface.name: surface.volume for surface in quality.surfaces if surface.of_cavity}
    figures = {
        "nodes": quality.node_count,
        "tetrahedra": len(quality.volumes),
        "silicone_mm3": round(float(quality.volumes.sum()), 6),
        **{f"{name}_mm3": round(volume, 6) for name, volume in cavities.items()},
        "smallest_radius_ratio": round(float(quality.radius_ratios.min()), 4),
        "elements_across_walls": quality.elements_across_walls,
        "seconds": round(made.seconds, 2),
    }
    return Outcome("", figures, (*made.remarks, *made.problems))
