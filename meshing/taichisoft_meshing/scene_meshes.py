"""Meshes for scenes that name a geometry file: made when they are first needed, and kept."""

import logging
import time
import warnings
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from taichisoft.errors import MeshError
from taichisoft.meshes.volume_mesh import VolumeMesh
from taichisoft_meshing.fingerprint import fingerprint
from taichisoft_meshing.geometry_file import find_kind, read_tables
from taichisoft_meshing.mesh_cache import cache_folder, not_kept, read_entry, write_entry
from taichisoft_meshing.mesh_job import MeshJob, make_mesh

LOGGER = logging.getLogger("taichisoft.meshing")
DIGITS = 16  # of the hash, in the name of what is kept


def mesh_for_scene(
    file: Path,
    size: float | None = None,
    preset: str | None = None,
    nodes: int | None = None,
    set: Mapping[str, Any] | None = None,
) -> VolumeMesh:
    """The mesh that a scene asks for; the same request gives the same mesh, made now or before.

    Args:
        file: the geometry file.
        size: largest element [mm].
        preset: name of one of the geometry's sizes.
        nodes: how many to come near to.
        set: tables that are laid over those of the file.

    Raises:
        MeshError: the file, the request or the mesh is not valid.
        PluginError: the plug-in of its kind failed.
    """
    kind, tables = read_tables(file)
    tables = laid_over(tables, set or {})
    possible = {"size": size, "preset": preset, "nodes": nodes}
    asked: dict[str, Any] = {key: value for key, value in possible.items() if value is not None}
    wish = "".join(f", {key} {value}" for key, value in asked.items())
    entry = _entry(kind, tables, file, asked)
    mesh = read_entry(entry) if entry is not None else None
    if mesh is not None:
        LOGGER.info("mesh of %s%s: %d nodes, made before (%s)", file, wish, len(mesh.nodes), entry)
    else:
        LOGGER.info("meshing %s%s", file, wish)
        start = time.perf_counter()
        made = _fit_mesh(MeshJob(kind, tables, file, asked))
        mesh = write_entry(made, entry) if entry is not None else not_kept(made)
        LOGGER.info("meshed %s%s: %d nodes in %.1f s", file, wish, len(mesh.nodes), time.perf_counter() - start)
    return replace(mesh, source=str(file))


def laid_over(tables: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """The tables with every value that `changes` has, tables within tables included."""
    merged = dict(tables)
    for key, value in changes.items():
        below = merged.get(key)
        merged[key] = laid_over(below, value) if isinstance(below, Mapping) and isinstance(value, Mapping) else value
    return merged


def _fit_mesh(job: MeshJob) -> VolumeMesh:
    """Make a mesh that meets the limits of its file, and warn of what a user should know about it.

    Raises:
        MeshError: it cannot be made, or is not fit to simulate.
        PluginError: the plug-in of its kind failed.
    """
    made = make_mesh(job)
    if made.problems:
        more = f" (and {len(made.problems) - 1} more)" if len(made.problems) > 1 else ""
        raise MeshError(f"{job.file}: {made.problems[0]}{more}; try another size, or other limits in its [quality]")
    for remark in made.remarks:
        warnings.warn(f"mesh of {job.file}: {remark}", stacklevel=3)
    return made.mesh


def _entry(kind: Any, tables: Mapping[str, Any], file: Path, asked: Mapping[str, Any]) -> Path | None:
    """Where the mesh is kept; None, with a warning, when it cannot be told what it is made from."""
    try:
        made_from = fingerprint(find_kind(kind, file), {**tables, "kind": kind}, file.parent, asked)
    except OSError as error:
        warnings.warn(f"{file}: the mesh is made anew every time: {error}", stacklevel=3)
        return None
    return cache_folder() / f"{file.stem}-{made_from[:DIGITS]}.msh"
