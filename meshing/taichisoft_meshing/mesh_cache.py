"""Meshes that were made for scenes, kept in the user's cache folder, and the command that shows and clears it."""

import os
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from taichisoft.base import SUFFIX, checksum_file, is_as_kept, keep_checksum, say, warn_caller
from taichisoft.base import cache_folder as users_cache_folder
from taichisoft.errors import MeshError, TaichisoftError

if TYPE_CHECKING:
    from taichisoft.mesh import VolumeMesh

FOLDER_VARIABLE = "TAICHISOFT_CACHE"


def cache_folder() -> Path:
    """The folder of kept meshes: `meshes` in the folder that TAICHISOFT_CACHE names, or in the user's cache folder."""
    own = os.environ.get(FOLDER_VARIABLE)
    return (Path(own).expanduser() if own else users_cache_folder()) / "meshes"


def kept_mesh(path: Path | None) -> "VolumeMesh | None":
    """Read the mesh that was kept at a path.

    None if it is absent, or, with a warning, if it cannot be read or has changed.
    """
    from taichisoft.mesh import read_volume_mesh

    if path is None or not path.is_file():
        return None
    if not is_as_kept(path):
        if checksum_file(path).exists():  # otherwise another process is writing it, or was stopped while it did
            warn_caller(f"{path}: has changed since it was written, by its checksum; it is made again")
        return None
    try:
        return read_volume_mesh(path)
    except MeshError as error:
        warn_caller(f"{error}; it is made again")
        return None


def keep_mesh(mesh: "VolumeMesh", path: Path | None) -> "VolumeMesh":
    """Keep a mesh, whole or not at all, so that several processes may keep the same one at a time.

    A folder that cannot be written costs no more than a warning, and without a path nothing is kept.

    Returns:
        The mesh as it is read from a file, in which triangles may stand in another order: so a run gives the same
        bits whether its mesh was made in it or before.
    """
    if path is not None:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            kept = _through_file(mesh, path)
            keep_checksum(path)
            return kept
        except (OSError, TaichisoftError) as error:
            why = error.strerror if isinstance(error, OSError) and error.strerror else error
            warn_caller(
                f"the mesh cannot be kept in {path.parent} ({why}) and is made again every time; "
                f"{FOLDER_VARIABLE} can name another folder"
            )
    with tempfile.TemporaryDirectory() as folder:
        return _through_file(mesh, Path(folder) / "mesh.msh")


def _through_file(mesh: "VolumeMesh", path: Path) -> "VolumeMesh":
    from taichisoft.mesh import read_volume_mesh, write_volume_mesh

    write_volume_mesh(mesh, path)
    return read_volume_mesh(path)


def mesh_cache(
    clear: Annotated[bool, typer.Option("--clear", help="Delete them all; scenes make again what they need.")] = False,
) -> None:
    """Show where the meshes that scenes asked for are kept, and how large they are."""
    folder = cache_folder()
    kept = sorted(folder.glob("*.msh"))
    size = sum(path.stat().st_size for path in kept)
    about = f"{len(kept)} mesh{'es' * (len(kept) != 1)}, {size / 1e6:.1f} MB, in {folder}"
    if clear:
        try:
            for path in [*kept, *folder.glob(f"*{SUFFIX}"), *folder.glob(".*.partial")]:
                path.unlink(missing_ok=True)
        except OSError as error:
            raise MeshError(f"{folder}: cannot be cleared: {error.strerror or error}") from error
    say(f"{'deleted ' * clear}{about}")
