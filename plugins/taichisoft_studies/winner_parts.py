"""The drawing of a winner: the geometry of its run as parts that can be made."""

from pathlib import Path

from taichisoft.errors import MeshError
from taichisoft.scenes.file import scene_from_toml
from taichisoft_meshing.commands.mould import write_parts
from taichisoft_meshing.geometry_file import read_tables
from taichisoft_meshing.scene_meshes import laid_over
from taichisoft_studies.run_job import RunJob

WALL = 6.0
"""Thickness of the mould [mm]."""


def write_winner(job: RunJob, folder: Path) -> list[str]:
    """Write the parts of every soft body that is meshed from a geometry with a mould: STEP, STL, mould and core.

    Args:
        job: run of the winner.
        folder: gets a folder for each geometry.

    Returns:
        A line for each body: where its parts are, or why there are none.
    """
    lines = []
    done: set[str] = set()
    for name, body in scene_from_toml(job.scene, job.source).soft_bodies.items():
        file = Path(body.mesh.file)
        source = f"{file} {body.mesh.request.get('set')}"
        if file.suffix.lower() != ".toml" or source in done:
            continue
        done.add(source)
        kind, tables = read_tables(file)
        output = folder / name
        try:
            output.mkdir(parents=True, exist_ok=True)
            write_parts(kind, laid_over(tables, body.mesh.request.get("set", {})), file, output, WALL)
            lines.append(f"{name}: drawing and mould in {output}")
        except MeshError as error:
            lines.append(f"{name}: no drawing: {error}")
    return lines
