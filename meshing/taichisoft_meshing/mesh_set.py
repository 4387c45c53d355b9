"""The files of a mesh: one alone, or a folder with all formats, surfaces, a picture and the record `mesh.json`."""

import hashlib
import json
import os
import re
import shutil
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

import taichisoft
from taichisoft.base import atomic_file, deferred_signals, partial_path
from taichisoft.errors import MeshError
from taichisoft.mesh import VOLUME_SUFFIXES, SectionPlane, VolumeMesh, require_suffix, write_stl, write_volume_mesh
from taichisoft_meshing.cad_body import CadBody
from taichisoft_meshing.gmsh_session import gmsh_version
from taichisoft_meshing.mesh_job import MadeMesh, MeshJob
from taichisoft_meshing.mesh_quality import MeshQuality
from taichisoft_meshing.report_picture import draw_report
from taichisoft_meshing.wall_quality import SurfaceQuality

RECORD = "mesh.json"
PICTURE = "mesh-report.png"


def is_file(output: Path) -> bool:
    """Whether an output is one file: it ends like one (.msh), not like a number (wall-1.5), and is no folder."""
    if output.is_dir() or not re.fullmatch(r"\.[A-Za-z]\w*", output.suffix):
        return False
    require_suffix(output, "volume mesh", VOLUME_SUFFIXES)
    return True


def prepare(output: Path) -> None:
    """Make the folder of an output before the work begins, so that an error about it comes at once."""
    if not is_file(output) and output.exists() and not output.is_dir():
        raise MeshError(f"--output {output}: is a file; a folder, or a file ({', '.join(VOLUME_SUFFIXES)}) is needed")
    for folder in (output.parent, *([output] if output.is_dir() else [])):
        prepare_folder(folder, output)


def prepare_folder(folder: Path, output: Path | None = None) -> None:
    """Make a folder unless it is there; errors call it `output`, which the user named."""
    output = folder if output is None else output
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise MeshError(f"--output {output}: its folder cannot be made: {error.strerror or error}") from error
    if not os.access(folder, os.W_OK):
        raise MeshError(f"--output {output}: no permission to write in {folder}")


def write_output(made: MadeMesh, output: Path, section: SectionPlane | None = None) -> None:
    """Write a mesh to a file or folder, as `is_file` says; only a second signal stops it half-way.

    `section` is the plane that cuts the mesh open in the picture.
    """
    with deferred_signals() as stop_if_asked:
        if is_file(output):
            write_volume_mesh(made.mesh, output)
        else:
            write_set(made, output, section)
        stop_if_asked()


def write_set(made: MadeMesh, folder: Path, section: SectionPlane | None = None) -> None:
    """Write all files of a mesh, called like the folder, to a folder beside it, and move them when all are whole."""
    folder = folder.resolve()
    partial = partial_path(folder)
    try:
        partial.mkdir()
        write_files(made, partial, folder.name, section)
        move_set(partial, folder)
    except OSError as error:
        raise MeshError(f"{folder}: cannot be written: {error.strerror or error}") from error
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def write_files(made: MadeMesh, folder: Path, name: str, section: SectionPlane | None = None) -> None:
    """Write all files of a mesh to an empty folder."""
    mesh, quality = made.mesh, made.quality
    for suffix in VOLUME_SUFFIXES:
        write_volume_mesh(mesh, folder / f"{name}{suffix}")
    for surface in quality.surfaces:
        if surface.closed_by_name:
            write_stl(mesh.nodes, surface.triangles, folder / f"{name}-{surface.name}.stl")
    draw_report(mesh, quality, made.limits, name, folder / PICTURE, section)
    write_record(mesh_record(made, sorted(folder.iterdir())), folder / RECORD)


def move_set(partial: Path, folder: Path) -> None:
    """Move all files of one folder to another, which may have an older set.

    Files that only the older set has are removed: its record lists them. The record is moved last, so that it never
    stands beside files that it does not describe. Of several that move at once each waits for the one before it, so
    that the folder has one set whole.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with _alone_in(folder):
        outdated = _recorded_files(folder / RECORD)
        (folder / RECORD).unlink(missing_ok=True)
        files = sorted(partial.iterdir(), key=lambda file: file.name == RECORD)
        for file in files:
            file.replace(folder / file.name)
        for name in outdated - {file.name for file in files}:
            (folder / name).unlink(missing_ok=True)


@contextmanager
def _alone_in(folder: Path) -> Iterator[None]:
    """Hold the lock of a folder; where a file system has no locks, go on without.

    The lock is the operating system's on the folder itself: it leaves no file, and ends with the process.
    """
    try:
        import fcntl
    except ImportError:  # as on Windows
        yield
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        with suppress(OSError):  # some file systems of networks have no locks
            fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


def _recorded_files(record: Path) -> set[str]:
    """Names of the files that a record lists; empty without a valid record."""
    try:
        content: Any = json.loads(record.read_text(encoding="utf-8"))
        names = set(content["files_sha256"])
    except (OSError, ValueError, KeyError, TypeError):
        return set()
    return {name for name in names if Path(name).name == name}


def mesh_record(made: MadeMesh, files: Iterable[Path]) -> dict[str, Any]:
    """Everything about a mesh except the time that it took: equal meshes have equal records.

    Args:
        made: the mesh.
        files: files of the mesh, of which the record has hashes.
    """
    job, parameters = made.job, made.geometry.parameters
    return {
        "kind": job.kind,
        "file": job.file.name,
        "parameters": job.tables if parameters is None else parameters,
        "asked": job.request,
        "inputs_sha256": _hash_of_inputs(job),
        "versions": {"taichisoft": taichisoft.__version__, "gmsh": gmsh_version()},
        **mesh_figures(made.mesh, made.quality),
        "limits": made.limits.model_dump(),
        "problems": made.problems,
        "remarks": made.remarks,
        "files_sha256": {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in files},
    }


def mesh_figures(mesh: VolumeMesh, quality: MeshQuality) -> dict[str, Any]:
    """Counts, volumes, groups and quality of a mesh as plain values."""
    return {
        "counts": {"nodes": len(mesh.nodes), "tetrahedra": len(mesh.elements)},
        "volumes_mm3": {
            "silicone": _rounded(quality.volumes.sum(), 12),
            **{surface.name: _rounded(surface.volume, 12) for surface in quality.surfaces if surface.closed_by_name},
        },
        "groups": {
            "surfaces": {name: {"triangles": len(group)} for name, group in mesh.surface_groups.items()},
            "elements": {name: {"tetrahedra": len(group)} for name, group in mesh.element_groups.items()},
        },
        "quality": {
            "radius_ratio": _spread(quality.radius_ratios),
            "dihedral_angle_degrees": _spread(quality.dihedral_angles),
            "element_volume_mm3": _spread(quality.volumes),
            "shortest_edge_mm": _rounded(quality.edges.min()),
            "longest_edge_mm": _rounded(quality.edges.max()),
            "elements_across_walls": quality.elements_across_walls,
            "walls": [
                {
                    "between": list(wall.sides),
                    "thinnest_mm": _rounded(wall.thinnest),
                    "elements_across": wall.elements_across,
                    "share_one_element_thick": _rounded(wall.share_of_one),
                }
                for wall in quality.walls
            ],
            "surfaces": {surface.name: surface_figures(surface) for surface in quality.surfaces},
            "inverted_elements": quality.inverted,
            "duplicate_nodes": quality.duplicate_nodes,
            "pieces": quality.components,
        },
    }


def body_figures(body: CadBody) -> dict[str, Any]:
    """Solids, faces, cavities and openings of a body from CAD as plain values."""
    return {
        "extent_mm": [_rounded(length) for length in body.extent],
        "solids": [
            {"number": part.number, "name": part.name, "volume_mm3": _rounded(part.volume, 12)} for part in body.solids
        ],
        "faces": [
            {
                "number": face.number,
                "solids": list(face.solids),
                "area_mm2": _rounded(face.area),
                "centre_mm": face.centre.round(6).tolist(),
                "normal": None if face.normal is None else face.normal.round(6).tolist(),
            }
            for face in body.faces
        ],
        "flat_end": list(body.flat_end),
        "cavities_mm3": [_rounded(volume, 12) for volume in body.void_volumes],
        "openings": [
            {
                "face": part.beside,
                "centre_mm": part.centre.round(6).tolist(),
                "area_mm2": _rounded(part.area),
                "volume_mm3": _rounded(part.volume),
            }
            for part in body.openings
        ],
    }


def surface_figures(surface: SurfaceQuality) -> dict[str, Any]:
    """Figures of a surface as plain values."""
    return {
        "triangles": len(surface.triangles),
        "area_mm2": _rounded(surface.area),
        "closed": surface.open_edges == 0,
    }


def write_record(record: Mapping[str, Any], path: Path) -> None:
    """Write a record as JSON."""
    with atomic_file(path, MeshError) as partial:
        partial.write_text(json.dumps(record, indent=2, allow_nan=False, default=list) + "\n", encoding="utf-8")


def _hash_of_inputs(job: MeshJob) -> str | None:
    """The hash that the cache of scenes' meshes uses; None for a plug-in without source."""
    try:
        return job.fingerprint()
    except OSError:
        return None


def _spread(values: np.ndarray) -> dict[str, float]:
    return {
        "smallest": _rounded(values.min()),
        "median": _rounded(np.median(values)),
        "largest": _rounded(values.max()),
    }


def _rounded(value: float, digits: int = 6) -> float:
    """Round to significant digits: the last ones depend on the machine's arithmetic."""
    return float(f"{value:.{digits}g}")
