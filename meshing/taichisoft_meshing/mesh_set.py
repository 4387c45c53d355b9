"""Writing a mesh to one file, or to a folder with all formats, surfaces, a record and a picture."""

import json
import os
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from taichisoft.base import deferred_signals, partial_path
from taichisoft.errors import MeshError
from taichisoft.mesh import VOLUME_SUFFIXES, SectionPlane, require_suffix, write_stl, write_volume_mesh
from taichisoft_meshing.mesh_job import MadeMesh
from taichisoft_meshing.mesh_record import mesh_record, write_record
from taichisoft_meshing.report_picture import draw_report

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
