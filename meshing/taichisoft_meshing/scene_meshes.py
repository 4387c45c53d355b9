"""Meshes for scenes that name a geometry file: made when they are first needed, and kept."""

import logging
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from taichisoft.base import warn_caller
from taichisoft.mesh import VolumeMesh
from taichisoft_meshing.geometry_file import read_tables
from taichisoft_meshing.mesh_cache import cache_folder, keep_mesh, kept_mesh
from taichisoft_meshing.mesh_job import MeshJob, require_fit
from taichisoft_meshing.mesh_process import make_mesh_apart

LOGGER = logging.getLogger("taichisoft.meshing")
DIGITS = 16  # of the hash, in the file name of a kept mesh


def mesh_for_scene(
    file: Path,
    size: float | None = None,
    preset: str | None = None,
    nodes: int | None = None,
    order: int | None = None,
    set: Mapping[str, Any] | None = None,
) -> VolumeMesh:
    """The mesh for a scene; the same request gives the same mesh, whether it is made now or was made before.

    Args:
        file: the geometry file.
        size: length of the largest element [mm].
        preset: name of one of the geometry's sizes.
        nodes: approximate number of nodes.
        order: 1 or 2, instead of the geometry's `mesh.order`.
        set: tables that replace the file's, key by key.
    """
    kind, tables = read_tables(file)
    possible = {"size": size, "preset": preset, "nodes": nodes}
    asked: dict[str, Any] = {key: value for key, value in possible.items() if value is not None}
    wish = "".join(f", {key} {value}" for key, value in asked.items())
    tables = merge_tables(tables, set or {})
    if order is not None:
        tables = merge_tables(tables, {"mesh": {"order": order}})
    job = MeshJob(kind, tables, file, asked)
    path = _cache_path(job)
    mesh = kept_mesh(path)
    if mesh is not None:
        LOGGER.info("mesh of %s%s: %d nodes, made before (%s)", file, wish, len(mesh.nodes), path)
    else:
        LOGGER.info("meshing %s%s", file, wish)
        start = time.perf_counter()
        made = make_mesh_apart(job)
        require_fit(made, "other limits in its [quality]")
        for remark in made.remarks:
            warn_caller(f"mesh of {file}: {remark}")
        mesh = keep_mesh(made.mesh, path)
        LOGGER.info("meshed %s%s: %d nodes in %.1f s", file, wish, len(mesh.nodes), time.perf_counter() - start)
    return replace(mesh, source=str(file))


def merge_tables(tables: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """The tables with all values of `changes` in their places, in tables within tables, too."""
    merged = dict(tables)
    for key, value in changes.items():
        below = merged.get(key)
        merged[key] = merge_tables(below, value) if isinstance(below, Mapping) and isinstance(value, Mapping) else value
    return merged


def _cache_path(job: MeshJob) -> Path | None:
    """The path of the kept mesh; None, with a warning, when its inputs cannot all be read."""
    try:
        return cache_folder() / f"{job.file.stem}-{job.fingerprint()[:DIGITS]}.msh"
    except OSError as error:
        warn_caller(f"{job.file}: the mesh is made again every time: {error}")
        return None
