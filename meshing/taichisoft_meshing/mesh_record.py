"""`mesh.json`: what a mesh was made from, and its figures."""

import hashlib
from collections.abc import Iterable
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

import taichisoft
from taichisoft_meshing.fingerprint import fingerprint
from taichisoft_meshing.geometry_file import find_kind
from taichisoft_meshing.mesh_job import MadeMesh, MeshJob
from taichisoft_meshing.quality.mesh_quality import MeshQuality


def mesh_record(made: MadeMesh, files: Iterable[Path]) -> dict[str, Any]:
    """Everything about a mesh but how long it took: equal meshes have equal records.

    Args:
        made: the mesh.
        files: that it was written to, with a hash of their content in the record.
    """
    job, mesh, quality = made.job, made.mesh, made.quality
    parameters = made.geometry.parameters
    surfaces = {surface.name: surface for surface in quality.surfaces}
    return {
        "kind": job.kind,
        "file": job.file.name,
        "parameters": job.tables if parameters is None else parameters,
        "asked": job.asked,
        "inputs_sha256": _hash_of_inputs(job),
        "versions": {"taichisoft": taichisoft.__version__, "gmsh": _gmsh_version()},
        "counts": {"nodes": len(mesh.nodes), "tetrahedra": len(mesh.elements)},
        "volumes_mm3": {
            "silicone": _rounded(quality.volumes.sum(), 12),
            **{name: _rounded(surface.volume, 12) for name, surface in surfaces.items() if surface.closed_by_name},
        },
        "groups": {
            "surfaces": {name: {"triangles": len(group)} for name, group in mesh.surface_groups.items()},
            "elements": {name: {"tetrahedra": len(group)} for name, group in mesh.element_groups.items()},
        },
        "quality": quality_record(quality),
        "limits": made.limits.model_dump(),
        "problems": made.problems,
        "remarks": made.remarks,
        "files_sha256": {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in files},
    }


def quality_record(quality: MeshQuality) -> dict[str, Any]:
    """The figures as plain values."""
    return {
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
        "surfaces": {
            surface.name: {
                "triangles": len(surface.triangles),
                "area_mm2": _rounded(surface.area),
                "closed": surface.open_edges == 0,
            }
            for surface in quality.surfaces
        },
        "inverted_elements": quality.inverted,
        "duplicate_nodes": quality.duplicate_nodes,
        "pieces": quality.components,
    }


def _hash_of_inputs(job: MeshJob) -> str | None:
    """As the cache of scenes' meshes has it; None where a plug-in has no source that could be part of it."""
    try:
        return fingerprint(find_kind(job.kind, job.file), {**job.tables, "kind": job.kind}, job.file.parent, job.asked)
    except OSError:
        return None


def _gmsh_version() -> str:
    try:
        return version("gmsh")
    except PackageNotFoundError:  # installed by other means than pip
        return "unknown"


def _spread(values: np.ndarray) -> dict[str, float]:
    return {
        "smallest": _rounded(values.min()),
        "median": _rounded(np.median(values)),
        "largest": _rounded(values.max()),
    }


def _rounded(value: float, digits: int = 6) -> float:
    """To significant digits: the last ones depend on the machine's arithmetic, and say nothing."""
    return float(f"{value:.{digits}g}")
